//! Warped maps: where they put what, and what they must not do.

use bevy::math::{DMat3, DVec2, DVec3, UVec2};
use bevy_pssm::{
    MapWarp,
    geometry::{
        bias::MapDerivatives,
        body::ConvexBody,
        fit::LookupReach,
        slice::{BodyVertex, Slice, ViewVolume},
        warp::WarpFrame,
    },
    plan::warp_frame,
};
use proptest::prelude::*;

const REFERENCE: &str = include_str!("../reference/lispsm_matrix.csv");

fn view(tan: DVec2) -> ViewVolume {
    ViewVolume {
        eye: DVec3::ZERO,
        axes: DMat3::IDENTITY,
        min: [DVec2::ZERO, -tan],
        max: [DVec2::ZERO, tan],
        near: 0.0,
        far: f64::INFINITY,
    }
}

#[test]
fn maps_equal_the_reference() {
    let mut rows = 0;
    for line in REFERENCE.lines().skip(1) {
        let columns: Vec<&str> = line.split(',').collect();
        let number = |index: usize| columns[index].parse::<f64>().unwrap();
        let vector = |index: usize| DVec3::from_array([0, 1, 2].map(|i| number(index + i)));
        let forward = vector(4).normalize();
        let right = forward.cross(vector(7)).normalize();
        let (near, far) = (number(12), number(13));
        let view = ViewVolume {
            eye: vector(1),
            axes: DMat3::from_cols(right, right.cross(forward), -forward),
            ..view(DVec2::new(number(10), number(11)))
        };

        let frame = WarpFrame::of_view(&view, -vector(14)).unwrap();
        let strength = frame.lispsm_strength(near, far);
        approx::assert_relative_eq!(strength, number(17).recip(), max_relative = 1e-9);
        let body = view.slice(near, far).unwrap().vertices();
        let clip = frame.clip_from_world(&body, strength) * vector(19).extend(1.0);
        let found = [clip.x / clip.w, clip.y / clip.w, clip.w];
        for (found, expected) in found.into_iter().zip([22, 23, 24].map(number)) {
            let tolerance = 1e-8 * (1.0 + expected.abs());
            assert!((found - expected).abs() <= tolerance, "{line}: {found}");
        }
        rows += 1;
    }
    assert_eq!(rows, 168);
}

fn direction() -> impl Strategy<Value = DVec3> {
    [-1.0..1.0, -1.0..1.0, -1.0..1.0_f64]
        .prop_map(DVec3::from_array)
        .prop_filter_map("a direction", DVec3::try_normalize)
}

fn slice() -> impl Strategy<Value = (ViewVolume, Slice, f64)> {
    (0.1..2.0_f64, 0.3..3.0_f64, 0.01..10.0_f64, 1.01..5e3_f64).prop_map(
        |(tan, aspect, near, ratio)| {
            let view = view(DVec2::new(tan * aspect, tan));
            let slice = view.slice(near, near * ratio).unwrap();
            (view, slice, near)
        },
    )
}

/// The worst error along the warp, and the storage factor.
fn error(frame: &WarpFrame, body: &[BodyVertex], strength: f64) -> [f64; 2] {
    let worst = frame.worst_aliasing(body, strength).unwrap();
    [worst.z, worst.storage()]
}

proptest! {
    /// The 32/27 is not proven: a failure here would be news, not necessarily a mistake.
    #[test]
    fn minimax_is_never_worse_than_no_warp(
        (view, slice, _) in slice(),
        to_light in direction(),
    ) {
        let frame = WarpFrame::of_view(&view, to_light).unwrap();
        let body = slice.vertices();
        let [along, storage] = error(&frame, &body, frame.minimax_strength(&body));
        let [along_unwarped, storage_unwarped] = error(&frame, &body, 0.0);
        prop_assert!(along <= along_unwarped * (1.0 + 1e-9));
        prop_assert!(storage <= storage_unwarped * (32.0 / 27.0 + 1e-9));
    }

    #[test]
    fn no_strength_is_better_along_the_warp_than_minimax(
        (view, slice, near) in slice(),
        to_light in direction(),
        strength in 0.0..2.0_f64,
    ) {
        let frame = WarpFrame::of_view(&view, to_light).unwrap();
        let body = slice.vertices();
        let [best, _] = error(&frame, &body, frame.minimax_strength(&body));
        let [other, _] = error(&frame, &body, strength / near);
        prop_assert!(best <= other * (1.0 + 1e-9));
    }

    #[test]
    fn light_stays_parallel_and_depth_in_order(
        (view, slice, near) in slice(),
        to_light in direction(),
        strength in 0.0..2.0_f64,
        towards_light in 0.0..100.0_f64,
    ) {
        let frame = WarpFrame::of_view(&view, to_light).unwrap();
        let body = slice.vertices();
        let map = frame.clip_from_world(&body, strength / near);
        for vertex in body {
            let clip = map * vertex.position.extend(1.0);
            prop_assert!(clip.w >= 1.0 - 1e-9);
            let ndc = clip.truncate() / clip.w;
            prop_assert!(ndc.truncate().abs().max_element() <= 1.0 + 1e-9);
            prop_assert!((-1e-9..=1.0 + 1e-9).contains(&ndc.z));

            let caster = vertex.position + towards_light * near * frame.z;
            let moved = map * caster.extend(1.0);
            prop_assert!((moved.w / clip.w - 1.0).abs() < 1e-9);
            let moved = moved.truncate() / moved.w;
            prop_assert!((moved - ndc).truncate().abs().max_element() < 1e-7);
            prop_assert!(moved.z >= ndc.z);
        }
    }
}

/// As the light turns from the view direction to straight above, in steps of a thousandth of a
/// degree, for any side from which it may come.
#[test]
fn minimax_strength_is_continuous_down_to_zero() {
    let view = view(DVec2::new(0.8, 0.6));
    let (near, far) = (1.0, 1000.0);
    let body = view.slice(near, far).unwrap().vertices();
    for azimuth in [0.0, 0.3, 0.8, 1.5] {
        let across = DVec3::new(f64::sin(azimuth), f64::cos(azimuth), 0.0);
        let strength = |step: i32| {
            let angle = (f64::from(step) * 1e-3).to_radians();
            let to_light = angle.cos() * DVec3::Z + angle.sin() * across;
            let frame = WarpFrame::of_view(&view, to_light).unwrap();
            frame.minimax_strength(&body) * near
        };
        let all: Vec<f64> = (0..=90_000).map(strength).collect();
        assert_eq!(all[..30].iter().copied().fold(0.0, f64::max), 0.0);
        assert!(all[90_000] > 0.02);
        for (step, pair) in all.windows(2).enumerate() {
            let change = (pair[1] - pair[0]).abs();
            assert!(change < 1e-4, "azimuth {azimuth}, step {step}: {pair:?}");
        }
    }
}

#[test]
fn directions_that_are_none_have_no_frame() {
    let view = view(DVec2::ONE);
    assert_eq!(WarpFrame::of_view(&view, DVec3::ZERO), None);
    assert_eq!(WarpFrame::of_view(&view, DVec3::NAN), None);
    assert_eq!(WarpFrame::new(DVec3::ZERO, DVec3::X, DVec3::X), None);
    let parallel = WarpFrame::of_view(&view, DVec3::Z).unwrap();
    assert_eq!(parallel.y, DVec3::Y);
    assert_eq!(parallel.lispsm_strength(1.0, 9.0), 0.0);
}

/// As the light turns from straight above to the view's direction, the guarded strength costs a hundredth, or
/// is the one with the least error.
#[test]
fn guarded_strengths_cost_a_hundredth_at_most() {
    let view = view(DVec2::new(0.8, 0.6));
    let body = view.slice(1.0, 20.0).unwrap().vertices();
    let mut limited = 0;
    for degrees in 1..=90 {
        let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
        let frame = WarpFrame::of_view(&view, DVec3::new(0.0, sin, cos)).unwrap();
        let strengths = [
            frame.minimax_strength(&body),
            frame.guarded_minimax_strength(&body),
        ];
        let share = |strength| error(&frame, &body, strength)[1] / error(&frame, &body, 0.0)[1];
        let [least_error, guarded] = strengths.map(share);
        if least_error <= 1.01 {
            assert_eq!(strengths[0], strengths[1], "{degrees}");
        } else {
            limited += 1;
            approx::assert_relative_eq!(guarded, 1.01, max_relative = 1e-6);
        }
    }
    assert!((10..80).contains(&limited), "{limited}");
}

/// Lookups that reach beyond a body up or down a slope find depths in its map.
#[test]
fn maps_have_a_guard_along_the_light() {
    let view = view(DVec2::new(0.8, 0.6));
    let (near, far, size) = (1.0, 100.0, UVec2::splat(512));
    let reach = LookupReach { texels: 6.0 };
    let body = view.slice(near, far).unwrap().vertices();
    for to_light in [DVec3::Y, DVec3::new(0.3, 0.8, 0.5)] {
        let frame = WarpFrame::of_view(&view, to_light).unwrap();
        for strength in [0.0, frame.lispsm_strength(near, far)] {
            let (map, _) = frame.guarded_map(&body, strength, size, reach);
            for vertex in body {
                let here = MapDerivatives::at(&map, vertex.position).unwrap();
                let texel = here.texel(size.as_dvec2()).max_element();
                let rise = reach.texels * texel * frame.z;
                for point in [vertex.position + rise, vertex.position - rise] {
                    let depth = map.project_point3(point).z;
                    assert!((-1e-9..=1.0 + 1e-9).contains(&depth), "{to_light}: {depth}");
                }
            }
        }
    }
}

/// Where nothing that is farther looks smaller, there is nothing to make up for.
#[test]
fn orthographic_views_are_not_warped() {
    let half = DVec2::new(40.0, 30.0);
    let view = ViewVolume {
        min: [-half, DVec2::ZERO],
        max: [half, DVec2::ZERO],
        ..view(DVec2::ONE)
    };
    let body = ConvexBody::of_slice(&view.slice(5.0, 50.0).unwrap());
    for warp in [
        MapWarp::Lispsm,
        MapWarp::Lloyd { eta: 0.0 },
        MapWarp::Trapezoid { focus: 0.4 },
        MapWarp::Strength(1.0),
    ] {
        let (_, strength) = warp_frame(warp, DVec3::NEG_Z, &view, DVec3::Y, &body).unwrap();
        assert_eq!(strength, 0.0, "{warp:?}");
    }
}
