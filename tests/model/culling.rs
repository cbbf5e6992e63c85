//! The caster hull: never loses what can throw a shadow into the slice.

use bevy::math::{Affine3A, DMat3, DVec3, Mat3A, Quat, Vec3, Vec3A};
use bevy_pssm::geometry::{
    body::ConvexBody,
    coarse::{CoarseHull, CoarseSweep, FourSpheres},
    hull::CasterHull,
    oriented_box::OrientedBox,
    slice::Slice,
};
use proptest::prelude::*;

use crate::views::{any_direction, any_turn, perspective, volume};

fn slice(turn: Quat, near: f64, far: f64) -> Slice {
    volume(&perspective(1.05, 1.6), Vec3::new(30.0, 10.0, -20.0), turn)
        .slice(near, far)
        .expect("not empty")
}

/// A point of the slice, from weights of its corners.
fn inside(slice: &Slice, weights: [f64; 8]) -> DVec3 {
    let total: f64 = weights.iter().sum();
    slice
        .corners
        .iter()
        .zip(weights)
        .map(|(corner, w)| *corner * (w / total))
        .sum()
}

proptest! {
    #[test]
    fn casters_on_the_way_to_the_light_are_kept(
        turn in any_turn(),
        to_light in any_direction(),
        near in 0.0..200.0_f64,
        length in 0.5..600.0_f64,
        weights in prop::array::uniform8(1e-6..1.0_f64),
        way in 0.0..3000.0_f64,
        half in prop::array::uniform3(1e-3..20.0_f64),
        spin in any_turn(),
        // Where in the box the ray passes.
        hit in prop::array::uniform3(-1.0..1.0_f64),
    ) {
        let slice = slice(turn, near, near + length);
        let hull = CasterHull::new(&ConvexBody::of_slice(&slice), to_light, 0.0);
        let axes = DMat3::from_quat(spin.as_dquat().normalize()) * DMat3::from_diagonal(half.into());
        let on_ray = inside(&slice, weights) + to_light * way;
        let center = on_ray - axes * DVec3::from(hit);
        let bounds = OrientedBox { center, half_axes: axes };
        prop_assert!(hull.intersects_box(&bounds));
        prop_assert!(hull.intersects_sphere(center, DVec3::from(half).length()));
    }

    #[test]
    fn casters_behind_or_beside_everything_are_dropped(
        turn in any_turn(),
        to_light in any_direction(),
        radius in 0.1..20.0_f64,
    ) {
        let slice = slice(turn, 1.0, 100.0);
        let hull = CasterHull::new(&ConvexBody::of_slice(&slice), to_light, 0.0);
        let axes = DMat3::from_diagonal(DVec3::splat(radius));
        let beyond = slice.center - to_light * (slice.radius + 10.0 * radius);
        let bounds = OrientedBox { center: beyond, half_axes: axes };
        prop_assert!(!hull.intersects_box(&bounds));
        let side = to_light.any_orthonormal_vector();
        let beside = slice.center + side * (slice.radius + 10.0 * radius) + to_light * 50.0;
        let bounds = OrientedBox { center: beside, half_axes: axes };
        prop_assert!(!hull.intersects_box(&bounds));
    }

    #[test]
    fn the_margin_moves_every_plane_out(turn in any_turn(), to_light in any_direction(), margin in 0.0..9.0_f64) {
        let slice = slice(turn, 1.0, 50.0);
        let plain = CasterHull::new(&ConvexBody::of_slice(&slice), to_light, 0.0);
        let wide = CasterHull::new(&ConvexBody::of_slice(&slice), to_light, margin);
        prop_assert_eq!(plain.planes.len(), wide.planes.len());
        for (a, b) in plain.planes.iter().zip(&wide.planes) {
            prop_assert!((b.distance - a.distance - margin).abs() < 1e-9);
        }
        let body = ConvexBody::of_slice(&slice);
        prop_assert!(wide.contains(&body, margin) && !wide.contains(&body, margin + 1e-6));
    }
}

proptest! {
    /// However far from the origin, and however near to a sweep's edge.
    #[test]
    fn what_is_far_in_f32_is_far(
        origin in 0.0..7.0_f64,
        towards in any_direction(),
        to_light in any_direction(),
        size in -2.0..4.0_f64,
        beside in any_direction(),
        share in prop_oneof![4 => 0.99999..1.00001_f64, 1 => 0.0..3.0],
        radius in 0.0..2.0_f64,
        along in prop_oneof![Just(0.0), 0.0..1e3_f64],
    ) {
        let half = DVec3::splat(10_f64.powf(size));
        let center = 10_f64.powf(origin) * towards;
        let body = ConvexBody::of_box(center - half, center + half);
        let sweep = CasterHull::new(&body, to_light, 0.0).sweep;
        let radius = radius * half.x;
        let beside = if along > 0.0 { beside.reject_from(to_light).normalize() } else { beside };
        let at = center + share * (half.length() + radius) * beside + along * half.x * to_light;
        let is_far = |growth: f32| {
            let spheres = four_spheres(at.as_vec3a(), Vec3A::X * radius as f32 * growth);
            CoarseSweep::new(&sweep).are_far(&spheres) == 0b1111
        };
        if is_far(1.0 + f32::EPSILON) {
            prop_assert!(sweep.is_far(at, radius), "far in f32 only");
        }
        // It is of use, too.
        let spare = 1e-5 * (10_f64.powf(origin) + half.x + radius);
        if along == 0.0 && sweep.is_far(at, radius + spare) {
            prop_assert!(is_far(1.0), "far, but not in f32");
        }
    }
}

/// As large as a vector is long, at some place.
fn four_spheres(translation: Vec3A, stick: Vec3A) -> FourSpheres {
    let world_from_local = Affine3A {
        matrix3: Mat3A::from_cols(stick, Vec3A::ZERO, Vec3A::ZERO),
        translation,
    };
    FourSpheres::new([&world_from_local; 4], [Vec3A::ZERO; 4], [Vec3A::X; 4])
}

#[test]
fn what_is_no_number_is_far_from_nothing_in_f32() {
    let body = ConvexBody::of_box(-DVec3::ONE, DVec3::ONE);
    let hull = CasterHull::new(&body, DVec3::Y, 0.0);
    let at = |translation| Affine3A {
        translation,
        ..Affine3A::IDENTITY
    };
    let nowhere = Vec3A::new(0.0, f32::INFINITY, 0.0);
    let [far, none, infinite] = [Vec3A::X * 1e9, Vec3A::NAN, nowhere].map(at);
    let test = |hull: &CasterHull, halves| {
        let spheres = FourSpheres::new([&far, &none, &infinite, &far], [Vec3A::ZERO; 4], halves);
        let are_far = CoarseSweep::new(&hull.sweep).are_far(&spheres);
        assert_eq!(are_far, CoarseHull::new(hull).are_outside(&spheres));
        are_far
    };
    assert_eq!(test(&hull, [Vec3A::ONE; 4]), 0b1001);
    // Lengths that have no square in `f32`.
    let sun = CasterHull::new(&body, DVec3::X, 0.0).sweep;
    let [beside, reach] = [Vec3A::new(1.84e19, 3e18, 0.0), Vec3A::Y * 4e18];
    assert_eq!(
        CoarseSweep::new(&sun).are_far(&four_spheres(beside, reach)),
        0
    );
    let endless = [Vec3A::NAN, Vec3A::ONE, Vec3A::ONE, Vec3A::INFINITY];
    assert_eq!(test(&hull, endless), 0);
    assert_eq!(test(&CasterHull::default(), [Vec3A::ONE; 4]), 0);
}

/// As in scenes whose transforms have been applied to their vertices.
#[test]
fn boxes_far_from_their_meshes_origins_are_told_apart_in_f32() {
    let body = ConvexBody::of_box(-DVec3::ONE, DVec3::ONE);
    let hull = CasterHull::new(&body, DVec3::Y, 0.0);
    let centers = [0.0, 5.0, -1000.0, 1.0].map(|x| Vec3A::X * x);
    let spheres = FourSpheres::new([&Affine3A::IDENTITY; 4], centers, [Vec3A::ONE; 4]);
    assert_eq!(CoarseSweep::new(&hull.sweep).are_far(&spheres), 0b0110);
    assert_eq!(CoarseHull::new(&hull).are_outside(&spheres), 0b0110);
}

proptest! {
    /// Boxes as they stand in the world, sheared and mirrored ones too.
    #[test]
    fn what_is_outside_in_f32_is_outside(
        origin in 0.0..6.0_f64,
        towards in any_direction(),
        to_light in any_direction(),
        size in -2.0..3.0_f64,
        beside in any_direction(),
        share in prop_oneof![4 => 0.999..1.001_f64, 1 => 0.0..3.0],
        scale in -2.0..4.0_f32,
        axes in prop::array::uniform9(-2.0_f32..2.0),
        local in prop::array::uniform3(-1.0_f32..1.0),
        apart in 0.0..3.0_f32,
        extents in prop::array::uniform3(0.0_f32..1.0),
    ) {
        let half = DVec3::splat(10_f64.powf(size));
        let center = 10_f64.powf(origin) * towards;
        let body = ConvexBody::of_box(center - half, center + half);
        let hull = CasterHull::new(&body, to_light, 0.0);
        // As in scenes whose transforms have been applied to their vertices.
        let local = 10_f32.powf(apart) * Vec3A::from_array(local);
        let extents = Vec3A::from_array(extents);
        let axes = 10_f32.powf(scale) * Mat3A::from_cols_array(&axes);
        let reach = f64::from((axes.abs() * extents).length());
        let at = center + share * (half.length() + reach) * beside;
        let world_from_local = Affine3A {
            matrix3: axes,
            translation: at.as_vec3a() - axes * local,
        };
        let axes = DMat3::from_cols(axes.x_axis.as_dvec3(), axes.y_axis.as_dvec3(), axes.z_axis.as_dvec3());
        let bounds = OrientedBox {
            center: axes * local.as_dvec3() + world_from_local.translation.as_dvec3(),
            half_axes: axes * DMat3::from_diagonal(extents.as_dvec3()),
        };
        let is_inside = hull.intersects_box(&bounds);
        let mut aside = world_from_local;
        aside.translation += Vec3A::splat(3e8);
        let four = FourSpheres::new([&aside, &aside, &world_from_local, &aside], [local; 4], [extents; 4]);
        let far = CoarseSweep::new(&hull.sweep).are_far(&four);
        let outside = CoarseHull::new(&hull).are_outside(&four);
        prop_assert!(!is_inside || (far | outside) & 0b100 == 0, "far in f32 only: {far:b}, {outside:b}");
        // They are of use, too.
        if to_light.abs_diff_eq(DVec3::splat(0.577), 0.5) {
            return Ok(());
        }
        prop_assert_eq!(far & outside & 0b1011, 0b1011);
    }

    /// Sticks that point at a plane of the hull and touch it, or nearly: their spheres are no larger than they are.
    #[test]
    fn what_touches_is_not_outside_in_f32(
        origin in 0.0..6.0_f64,
        towards in any_direction(),
        to_light in any_direction(),
        size in -2.0..3.0_f64,
        length in -2.0..7.0_f64,
        apart in -1e-6..1e-6_f64,
        local in prop_oneof![Just(0.0), 0.0..1e3_f32],
    ) {
        let half = DVec3::splat(10_f64.powf(size));
        let center = 10_f64.powf(origin) * towards;
        let body = ConvexBody::of_box(center - half, center + half);
        let hull = CasterHull::new(&body, to_light, 0.0);
        let length = 10_f64.powf(length);
        for plane in &hull.planes {
            let on_plane = center + plane.normal * (plane.distance - plane.normal.dot(center));
            let at = on_plane + plane.normal * length * (1.0 + apart);
            let stick = (plane.normal * length).as_vec3a();
            let world_from_local = Affine3A {
                matrix3: Mat3A::from_cols(stick, Vec3A::ZERO, Vec3A::ZERO),
                translation: at.as_vec3a() - stick * local,
            };
            let bounds = OrientedBox {
                center: world_from_local.translation.as_dvec3() + stick.as_dvec3() * f64::from(local),
                half_axes: DMat3::from_cols(stick.as_dvec3(), DVec3::ZERO, DVec3::ZERO),
            };
            if !hull.intersects_box(&bounds) {
                continue;
            }
            let center = Vec3A::X * local;
            let spheres = FourSpheres::new([&world_from_local; 4], [center; 4], [Vec3A::X; 4]);
            prop_assert_eq!(CoarseHull::new(&hull).are_outside(&spheres), 0, "outside of a plane in f32 only");
            prop_assert_eq!(CoarseSweep::new(&hull.sweep).are_far(&spheres), 0, "far in f32 only");
        }
    }
}

#[test]
fn spheres_count_where_they_reach_the_hull() {
    let hull = CasterHull::new(&ConvexBody::of_box(-DVec3::ONE, DVec3::ONE), DVec3::Y, 0.0);
    let beside = DVec3::new(1.5, 40.0, 0.0);
    assert!(hull.intersects_sphere(beside, 0.6));
    assert!(!hull.intersects_sphere(beside, 0.4));
}

/// A quarter of a turn about z takes what is long along y to x.
#[test]
fn turned_boxes_count_where_they_reach_the_hull() {
    let hull = CasterHull::new(&ConvexBody::of_box(-DVec3::ONE, DVec3::ONE), DVec3::Y, 0.0);
    let turned = |half: DVec3| OrientedBox {
        center: DVec3::new(4.0, 40.0, 0.0),
        half_axes: DMat3::from_cols(DVec3::Y, DVec3::NEG_X, DVec3::Z) * DMat3::from_diagonal(half),
    };
    assert!(hull.intersects_box(&turned(DVec3::new(1.0, 4.0, 1.0))));
    assert!(!hull.intersects_box(&turned(DVec3::new(4.0, 1.0, 1.0))));
}

#[test]
fn boxes_that_are_not_numbers_are_kept() {
    let hull = CasterHull::new(
        &ConvexBody::of_slice(&slice(Quat::IDENTITY, 1.0, 9.0)),
        DVec3::Y,
        0.0,
    );
    assert!(hull.intersects_box(&OrientedBox {
        center: DVec3::NAN,
        half_axes: DMat3::IDENTITY
    }));
    assert!(hull.intersects_sphere(DVec3::NAN, 1.0));
    assert!(hull.intersects_sphere(1e9 * DVec3::X, f64::NAN));
    assert!(hull.intersects_sphere(1e9 * DVec3::X, f64::INFINITY));
}

#[test]
fn spheres_hold_sheared_boxes() {
    for sheared in [0.0, 0.5, -3.0, 100.0] {
        let bounds = OrientedBox {
            center: DVec3::ZERO,
            half_axes: DMat3::from_cols(
                DVec3::X,
                DVec3::new(sheared, 1.0, 0.0),
                DVec3::new(0.0, -sheared, 2.0),
            ),
        };
        let signs = [-1.0, 1.0];
        let corners = signs
            .iter()
            .flat_map(|x| signs.map(|y| DVec3::new(*x, y, 1.0)));
        for corner in corners {
            assert!((bounds.half_axes * corner).length() <= bounds.radius() * (1.0 + 1e-12));
        }
    }
}

#[test]
fn a_hull_has_few_planes() {
    for to_light in [
        DVec3::Y,
        DVec3::Z,
        DVec3::X,
        DVec3::new(0.3, 0.8, 0.5).normalize(),
    ] {
        let planes = CasterHull::new(
            &ConvexBody::of_slice(&slice(Quat::IDENTITY, 1.0, 9.0)),
            to_light,
            0.0,
        )
        .planes
        .len();
        assert!((4..=12).contains(&planes), "{planes}");
    }
}
