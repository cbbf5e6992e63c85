//! Stable maps: constant size and orientation, moved by whole texels.

use bevy::math::{DMat3, DVec2, DVec3, Mat4, Quat, UVec2, Vec3};
use bevy_pssm::{
    CascadeFit, MapSize, MapWarp, ParallelSplitShadows, SplitScheme,
    geometry::{
        fit::{self, LookupReach, MapBox},
        hysteresis::Slack,
        light_frame::LightFrame,
        oriented_box::OrientedBox,
        receivers::Receivers,
        slice::ViewVolume,
    },
    plan::{CascadePlan, CasterChanges, PlanHistory, PlanInputs, plan_cascades},
};
use proptest::prelude::*;

use crate::views::{any_direction, any_turn, perspective, volume};

const REACH: LookupReach = LookupReach { texels: 6.0 };

fn config(map_size: u32) -> ParallelSplitShadows {
    ParallelSplitShadows {
        far: 800.0,
        map_size: MapSize::Same(map_size),
        ..Default::default()
    }
}

fn plan(config: &ParallelSplitShadows, eye: Vec3, turn: Quat, to_light: DVec3) -> Vec<CascadePlan> {
    let view = volume(&perspective(1.05, 1.333), eye, turn);
    plan_for(config, &view, to_light, REACH)
}

fn plan_for(
    config: &ParallelSplitShadows,
    view: &ViewVolume,
    to_light: DVec3,
    reach: LookupReach,
) -> Vec<CascadePlan> {
    let inputs = PlanInputs {
        view,
        light: &LightFrame::new(to_light).expect("a direction"),
        config,
        reach,
        receivers: &Receivers::everywhere(view),
        image_height: 1080.0,
        changes: &CasterChanges::At(Vec::new()),
    };
    plan_cascades(&inputs, &mut PlanHistory::default())
}

/// A pseudo-random walk: small moves and turns, the same in every run.
struct Walk(u64);

impl Walk {
    fn next(&mut self) -> f32 {
        self.0 = self
            .0
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        ((self.0 >> 40) as f32 / (1 << 24) as f32) * 2.0 - 1.0
    }
}

/// Walks 2,000 steps and checks every cascade's `f64` and `f32` matrices against the first.
fn walk_from(start: Vec3, map_size: u32) {
    let config = config(map_size);
    let to_light = DVec3::new(0.3, 0.7, -0.45);
    let (mut eye, mut yaw, mut pitch) = (start, 0.3_f32, -0.2_f32);
    let first = plan(
        &config,
        eye,
        Quat::from_euler(bevy::math::EulerRot::YXZ, yaw, pitch, 0.0),
        to_light,
    );
    let mut walk = Walk(42);
    let mut shifted = 0;
    for _ in 0..2000 {
        eye += 0.4 * Vec3::new(walk.next(), walk.next(), walk.next());
        yaw += 0.02 * walk.next();
        pitch = (pitch + 0.02 * walk.next()).clamp(-1.2, 1.2);
        let turn = Quat::from_euler(bevy::math::EulerRot::YXZ, yaw, pitch, 0.0);
        for (a, b) in first.iter().zip(plan(&config, eye, turn, to_light)) {
            let a = a.map.as_ref().expect("a map");
            let b = b.map.expect("a map");
            for column in 0..3 {
                let bits =
                    |m: &bevy::math::DMat4| m.col(column).truncate().to_array().map(f64::to_bits);
                assert_eq!(bits(&a.clip_from_world), bits(&b.clip_from_world));
            }
            let texels_per_ndc = 0.5 * f64::from(map_size);
            let shift = (b.clip_from_world.w_axis - a.clip_from_world.w_axis) * texels_per_ndc;
            for texels in [shift.x, shift.y] {
                assert!(
                    (texels - texels.round()).abs() < 1e-6,
                    "moved by {texels} texels"
                );
                shifted += usize::from(texels.abs() > 0.5);
            }
            // With a power of two the texel grid is exact in f32 too, which the GPU works in.
            if map_size.is_power_of_two() {
                let shift = (b.clip_from_world.as_mat4().w_axis
                    - a.clip_from_world.as_mat4().w_axis)
                    * texels_per_ndc as f32;
                assert_eq!((shift.x, shift.y), (shift.x.round(), shift.y.round()));
            }
        }
    }
    assert!(
        shifted > 1000,
        "the walk was too short to move the maps: {shifted}"
    );
}

#[test]
fn maps_move_by_whole_texels_at_the_origin() {
    walk_from(Vec3::ZERO, 2048);
}

#[test]
fn maps_move_by_whole_texels_at_50_km() {
    walk_from(Vec3::new(50_000.0, 300.0, -50_000.0), 2048);
}

#[test]
fn maps_of_odd_sizes_move_by_whole_texels() {
    walk_from(Vec3::new(1000.0, 5.0, 40.0), 1500);
    walk_from(Vec3::new(50_000.0, 5.0, 40.0), 777);
}

proptest! {
    #[test]
    fn maps_cover_their_slices_with_room_for_filters(
        turn in any_turn(),
        to_light in any_direction(),
        x in -1e5..1e5_f32,
        z in -1e5..1e5_f32,
        size in 128_u32..4096,
        tight in any::<bool>(),
    ) {
        let fit = if tight { CascadeFit::Tight } else { CascadeFit::Stable };
        let config = ParallelSplitShadows { fit, ..config(size) };
        let eye = Vec3::new(x, 50.0, z);
        let view = volume(&perspective(1.05, 1.333), eye, turn);
        for cascade in plan(&config, eye, turn, to_light) {
            let slice = view.slice(cascade.near, cascade.far).expect("not empty");
            let map = cascade.map.expect("a map");
            let guard = 2.0 * REACH.texels / f64::from(size) - 1e-9;
            for corner in slice.corners {
                let ndc = map.clip_from_world.project_point3(corner);
                prop_assert!(ndc.truncate().abs().max_element() <= 1.0 - guard.min(0.49), "{ndc}");
                prop_assert!((0.0..=1.0).contains(&ndc.z), "{ndc}");
            }
        }
    }

    #[test]
    fn published_matrices_agree(turn in any_turn(), to_light in any_direction()) {
        for cascade in plan(&config(2048), Vec3::new(100.0, 50.0, -300.0), turn, to_light) {
            let map = cascade.map.expect("a map");
            let composed = map.clip_from_cascade * map.world_from_cascade.inverse();
            prop_assert!(composed.abs_diff_eq(map.clip_from_world, 1e-7), "{composed} {}", map.clip_from_world);
            prop_assert!(map.clip_from_world.determinant() > 0.0, "the orientation must be kept");
        }
    }

    #[test]
    fn neighboring_cascades_meet_without_a_gap(
        turn in any_turn(), blend in 0.0..0.5_f32, cascades in 2_u32..=4,
    ) {
        let config = ParallelSplitShadows { blend, cascades, ..config(1024) };
        let plans = plan(&config, Vec3::ZERO, turn, DVec3::Y);
        for pair in plans.windows(2) {
            prop_assert!(pair[1].near <= pair[0].far);
            prop_assert_eq!(pair[1].near, pair[0].blend_start);
        }
        prop_assert_eq!(plans[plans.len() - 1].far, 800.0);
    }
}

/// Wherever in a texel the grid begins, though the slice's sphere is touched along an axis of the map.
#[test]
fn what_snapping_moves_a_map_by_is_in_its_guard() {
    let view = volume(&perspective(1.05, 1.333), Vec3::ZERO, Quat::IDENTITY);
    let slice = view.slice(1.0, 50.0).expect("not empty");
    let x = (slice.corners[4] - slice.center).normalize();
    let z = x.any_orthonormal_vector();
    let y = z.cross(x);
    // Texels of 0.4 m.
    for step in 0..64 {
        let origin = 0.01 * f64::from(step) * x;
        let is_grounded = false;
        let light = LightFrame {
            x,
            y,
            z,
            origin,
            is_grounded,
        };
        let map = fit::stable(&slice, &light, UVec2::splat(256), REACH, Slack(0.0));
        let spare = map.spare(slice.corners.iter().copied(), &light, REACH);
        assert!(spare.min_element() >= -1e-9, "{step}: {spare}");
    }
}

/// A box is laid about points in whole texels, as near as those allow.
#[test]
fn maps_are_laid_about_points_in_whole_texels() {
    let map = MapBox {
        center: DVec3::new(0.5, 0.25, 0.0),
        half: DVec3::splat(64.0),
        texel: DVec2::new(1.0, 0.5),
    };
    let light = LightFrame::new(DVec3::new(0.3, 0.7, -0.45)).expect("a direction");
    for step in 0..100 {
        let middle_ls = 0.37 * f64::from(step) * DVec3::new(1.0, -0.8, 0.3);
        let points = [-1.0, 1.0].map(|side| {
            let point_ls = middle_ls + side * DVec3::new(3.0, 2.0, 1.0);
            light.origin + light.world_from_light() * point_ls
        });
        let laid = map.about(points.into_iter(), &light);
        let off = (laid.center - middle_ls).abs();
        assert!(
            off.cmple(DVec3::new(0.5, 0.25, 0.5) + 1e-9).all(),
            "{step}: {off}"
        );
        let moved = (laid.center - map.center) / map.texel.extend(1.0);
        assert!(moved.abs_diff_eq(moved.round(), 1e-9), "{step}: {moved}");
        assert_eq!((laid.half, laid.texel), (map.half, map.texel));
    }
}

/// Maps that lie whole texels apart round otherwise in `f32`, as the GPU places what it draws: what was drawn for one is not,
/// to the bit, what would be drawn for the other.
#[test]
fn maps_whole_texels_apart_are_not_the_same_to_the_bit() {
    let size = 2048.0;
    let map = |texels: f64| MapBox {
        center: DVec3::new(0.37 * texels, 0.0, 0.0),
        half: DVec3::splat(0.37 * 0.5 * size),
        texel: DVec2::splat(0.37),
    };
    let light = LightFrame::new(DVec3::new(0.3, 0.7, -0.45)).expect("a direction");
    let [here, there] = [0.0, 301.0].map(|texels| map(texels).clip_from_world(&light).as_mat4());
    // Of a texel, as rasterizers count.
    let place = |clip_from_world: &Mat4, corner: Vec3| {
        let ndc = clip_from_world.project_point3(corner);
        (256.0 * size as f32 * (0.5 * ndc.x + 0.5)).round()
    };
    let mut apart = 0;
    let corners = 10_000;
    for step in 0..corners {
        let [x, z] = [0.618_034, 0.754_877].map(|share| (share * step as f32).fract() - 0.5);
        let corner = Vec3::new(300.0 * x, 3.0, 300.0 * z);
        let moved = place(&here, corner) - place(&there, corner);
        apart += usize::from(moved != 256.0 * 301.0);
    }
    let share = apart as f64 / f64::from(corners);
    assert!((0.001..0.5).contains(&share), "{share}");
}

/// Texels have corners: those of the outermost that a filter reads are in the hull.
#[test]
fn casters_in_every_texel_that_is_read_matter() {
    let view = volume(&perspective(1.05, 1.333), Vec3::ZERO, Quat::IDENTITY);
    let reach = LookupReach { texels: 1.0 };
    for to_light in [DVec3::Y, DVec3::new(0.3, 0.7, -0.45), DVec3::Z] {
        let light = LightFrame::new(to_light).expect("a direction");
        for cascade in plan_for(&config(256), &view, to_light, reach) {
            let slice = view.slice(cascade.near, cascade.far).expect("not empty");
            let map = cascade.map.expect("a map");
            let farthest = (reach.texels + 0.999) * map.texel;
            for (x, y) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
                let off = x * farthest.x * light.x + y * farthest.y * light.y;
                let meets = |corner: &DVec3| {
                    map.hull_now.intersects_box(&OrientedBox {
                        center: *corner + off,
                        half_axes: DMat3::ZERO,
                    })
                };
                assert!(slice.corners.iter().all(meets), "{to_light} {off}");
            }
        }
    }
}

#[test]
fn the_last_cascade_to_be_seen_fades() {
    let config = ParallelSplitShadows {
        splits: SplitScheme::Geometric {
            gamma: 3.0,
            bias: 700.0,
        },
        blend: 0.0,
        fade: 0.25,
        ..config(1024)
    };
    let plans = plan(&config, Vec3::ZERO, Quat::IDENTITY, DVec3::Y);
    let seen: Vec<_> = plans
        .iter()
        .filter(|cascade| cascade.map.is_some())
        .collect();
    assert!(seen.len() < plans.len(), "planes should fall together here");
    let last = seen[seen.len() - 1];
    assert_eq!(last.far, 800.0);
    assert!(last.blend_start < 800.0, "{}", last.blend_start);
}

#[test]
fn endless_biases_give_no_map_rather_than_infinite_ones() {
    let reach = LookupReach {
        texels: f64::INFINITY,
    };
    let view = volume(&perspective(1.0, 1.0), Vec3::ZERO, Quat::IDENTITY);
    for fit in [
        CascadeFit::Stable,
        CascadeFit::Tight,
        CascadeFit::Warped(MapWarp::Minimax),
    ] {
        let config = ParallelSplitShadows { fit, ..config(512) };
        for cascade in plan_for(&config, &view, DVec3::Y, reach) {
            assert_eq!(cascade.map, None);
        }
    }
}

#[test]
fn light_frames_are_orthonormal_right_handed_and_need_a_direction() {
    for to_light in [
        DVec3::Y,
        DVec3::NEG_Y,
        DVec3::X,
        DVec3::Z,
        DVec3::new(1e-4, 1.0, 1e-5),
    ] {
        let frame = LightFrame::new(to_light).expect("a direction");
        let matrix = frame.world_from_light();
        approx::assert_relative_eq!(matrix.determinant(), 1.0, epsilon = 1e-12);
        assert!((matrix.transpose() * matrix).abs_diff_eq(DMat3::IDENTITY, 1e-12));
    }
    assert_eq!(LightFrame::new(DVec3::ZERO), None);
    assert_eq!(LightFrame::new(DVec3::splat(f64::NAN)), None);
    assert_eq!(LightFrame::new(DVec3::splat(f64::INFINITY)), None);
}
