//! View volumes read off Bevy's projections, and helpers for other tests.

use bevy::{
    camera::{OrthographicProjection, PerspectiveProjection, Projection},
    math::{DAffine3, DQuat, DVec2, DVec3, Mat4, Quat, Rect, Vec3, Vec4},
};
use bevy_pssm::geometry::{body::ConvexBody, slice::ViewVolume};
use proptest::prelude::*;

pub fn perspective(fov: f32, aspect_ratio: f32) -> Projection {
    Projection::Perspective(PerspectiveProjection {
        fov,
        aspect_ratio,
        near: 0.1,
        far: 2000.0,
        ..Default::default()
    })
}

pub fn volume(projection: &Projection, eye: Vec3, turn: Quat) -> ViewVolume {
    volume_through(&projection.get_clip_from_view(), eye, turn, 1.0)
}

/// By any matrix, of Bevy's kind, of a camera of any scale.
pub fn volume_through(clip_from_view: &Mat4, eye: Vec3, turn: Quat, scale: f32) -> ViewVolume {
    // As a game has it: positions and rotations in f32.
    let rotation = bevy::math::Affine3A::from_rotation_translation(turn, eye);
    let axes = rotation.matrix3 * scale;
    let world_from_view = DAffine3 {
        matrix3: bevy::math::DMat3::from_cols(
            axes.x_axis.as_dvec3(),
            axes.y_axis.as_dvec3(),
            axes.z_axis.as_dvec3(),
        ),
        translation: rotation.translation.as_dvec3(),
    };
    ViewVolume::new(world_from_view, clip_from_view).expect("a sound camera")
}

/// The place in world space at so much of the picture's half width and height, and so deep.
pub fn in_picture(view: &ViewVolume, at: DVec2, depth: f64) -> DVec3 {
    let lo = view.min[0] + depth * view.min[1];
    let hi = view.max[0] + depth * view.max[1];
    let at = 0.5 * (lo + hi) + 0.5 * (hi - lo) * at;
    view.eye + view.axes * at.extend(-depth)
}

/// Whether a camera sees a point that nothing hides.
pub fn sees(view: &ViewVolume, point: DVec3) -> bool {
    let local = view.axes.inverse() * (point - view.eye);
    let depth = -local.z;
    let lo = view.min[0] + depth * view.min[1];
    let hi = view.max[0] + depth * view.max[1];
    let at = local.truncate();
    depth > view.nearest() && depth < view.far && at.cmpgt(lo).all() && at.cmplt(hi).all()
}

pub fn any_turn() -> impl Strategy<Value = Quat> {
    (0.0..core::f32::consts::TAU, -1.5..1.5_f32, -0.5..0.5_f32).prop_map(|(yaw, pitch, roll)| {
        Quat::from_euler(bevy::math::EulerRot::YXZ, yaw, pitch, roll)
    })
}

pub fn any_direction() -> impl Strategy<Value = DVec3> {
    (-1.0..1.0_f64, 0.0..core::f64::consts::TAU).prop_map(|(y, a)| {
        let r = (1.0 - y * y).sqrt();
        DVec3::new(r * a.cos(), y, r * a.sin())
    })
}

/// Off its axis.
fn orthographic() -> Projection {
    Projection::Orthographic(OrthographicProjection {
        area: Rect::new(-3.0, -2.0, 5.0, 4.0),
        near: -10.0,
        ..OrthographicProjection::default_3d()
    })
}

#[test]
fn slice_corners_are_those_of_bevys_projections() {
    for projection in [perspective(1.1, 1.6), orthographic()] {
        let view = volume(&projection, Vec3::ZERO, Quat::IDENTITY);
        let slice = view.slice(5.0, 50.0).expect("not empty");
        for corner in projection.get_frustum_corners(-5.0, -50.0) {
            let nearest = slice
                .corners
                .iter()
                .map(|found| found.distance(corner.as_dvec3()))
                .fold(f64::INFINITY, f64::min);
            assert!(nearest < 1e-4, "{corner} is missing from {slice:?}");
        }
    }
}

#[test]
fn slices_of_mirrored_cameras_fill_the_picture() {
    let mut off_axis = perspective(1.1, 1.6).get_clip_from_view();
    off_axis.z_axis += Vec4::new(0.3, -0.2, 0.0, 0.0);
    for lens in [off_axis, orthographic().get_clip_from_view()] {
        for mirror in [Vec3::new(-1.0, 1.0, 1.0), Vec3::new(1.0, -1.0, 1.0)] {
            let lens = Mat4::from_scale(mirror) * lens;
            let view = volume_through(&lens, Vec3::ZERO, Quat::IDENTITY, 1.0);
            let is_perspective = lens.row(3).w == 0.0;
            assert_eq!(view.is_perspective(), is_perspective, "{mirror}");
            assert!(view.image_height(10.0) > 0.0, "{mirror}");
            for corner in view.slice(5.0, 50.0).expect("not empty").corners {
                let ndc = lens.project_point3(corner.as_vec3());
                let off = (ndc.truncate().abs() - 1.0).abs().max_element();
                assert!(off < 1e-5, "{mirror}: {corner} is at {ndc}");
            }
        }
    }
}

/// As on screens that are held upright, and drawn lying.
#[test]
fn slices_of_turned_pictures_hold_all_that_is_seen() {
    for lens in [perspective(1.1, 1.6), orthographic()] {
        let lens = lens.get_clip_from_view();
        for (degrees, is_square) in [(90.0_f32, true), (-90.0, true), (30.0, false)] {
            let turned = Mat4::from_rotation_z(degrees.to_radians()) * lens;
            let view = volume_through(&turned, Vec3::ZERO, Quat::IDENTITY, 1.0);
            let body = ConvexBody::of_slice(&view.slice(5.0, 50.0).expect("not empty"));
            let world = turned.inverse();
            for corner in [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]] {
                let along =
                    [0.2, 0.8].map(|z| world.project_point3(Vec3::new(corner[0], corner[1], z)));
                let way = (along[1] - along[0]).as_dvec3();
                for depth in [5.0, 20.0, 50.0] {
                    let way = way / way.z * (-depth - f64::from(along[0].z));
                    let seen = along[0].as_dvec3() + way;
                    let beyond = body.planes().map(|it| it.normal.dot(seen) - it.distance);
                    let beyond = beyond.fold(f64::MIN, f64::max);
                    assert!(beyond < 1e-3, "{degrees}: {seen} by {beyond}");
                }
            }
            let area = |view: &ViewVolume| {
                let [a, b, c] =
                    [0, 1, 3].map(|it| view.slice(5.0, 50.0).expect("not empty").corners[it]);
                a.distance(b) * a.distance(c)
            };
            let upright = volume_through(&lens, Vec3::ZERO, Quat::IDENTITY, 1.0);
            let share = area(&view) / area(&upright);
            assert!(
                (share < 1.0 + 1e-5) == is_square,
                "{degrees}: {share} of the area"
            );
        }
    }
}

/// Where a slice is wider than long, the sphere around its far end is the smallest.
#[test]
fn wide_slices_have_the_sphere_of_their_far_end() {
    let view = volume(&perspective(1.5, 1.6), Vec3::ZERO, Quat::IDENTITY);
    let slice = view.slice(1.0, 1000.0).expect("not empty");
    let half_diagonal = 0.5 * slice.corners[4].distance(slice.corners[6]);
    approx::assert_relative_eq!(slice.radius, half_diagonal, max_relative = 1e-9);
}

#[test]
fn slices_end_at_the_cameras_planes() {
    let view = volume(&perspective(1.0, 1.0), Vec3::ZERO, Quat::IDENTITY);
    assert!((view.near - 0.1).abs() < 1e-6);
    // Bevy draws beyond a perspective camera's `far`.
    assert_eq!(view.far, f64::INFINITY);
    assert!(view.slice(2000.0, 30_000.0).is_some());

    let orthographic = Projection::Orthographic(OrthographicProjection {
        near: 2.0,
        far: 2000.0,
        ..OrthographicProjection::default_3d()
    });
    let view = volume(&orthographic, Vec3::ZERO, Quat::IDENTITY);
    assert!((view.near - 2.0).abs() < 1e-3 && (view.far - 2000.0).abs() < 1e-1);
    assert!(view.slice(2001.0, 3000.0).is_none());
    let slice = view.slice(1900.0, 5000.0).expect("not empty");
    let deepest = slice.corners.iter().map(|c| -c.z).fold(0.0, f64::max);
    assert!((deepest - 2000.0).abs() < 1e-1);
}

#[test]
fn oblique_near_planes_hide_nothing() {
    for normal in [
        Vec4::new(0.0, 1.0, 0.0, 0.5),
        Vec4::new(0.3, 0.9, -0.2, 40.0),
        Vec4::new(0.0, 0.1, -0.99, -3.0),
    ] {
        let mirror = Projection::Perspective(PerspectiveProjection {
            near_clip_plane: normal,
            ..Default::default()
        });
        let view = volume(&mirror, Vec3::ZERO, Quat::IDENTITY);
        assert_eq!((view.near, view.far), (0.0, f64::INFINITY), "{normal}");
        assert!(view.slice(0.0, 1.0).is_some());
    }
}

#[test]
fn degenerate_cameras_have_no_volume() {
    let good = perspective(1.0, 1.0).get_clip_from_view();
    let identity = DAffine3::IDENTITY;
    let nan = DAffine3::from_translation(DVec3::new(f64::NAN, 0.0, 0.0));
    let flat = DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0));
    assert!(ViewVolume::new(nan, &good).is_none());
    assert!(ViewVolume::new(flat, &good).is_none());
    assert!(ViewVolume::new(identity, &Mat4::ZERO).is_none());
    assert!(ViewVolume::new(identity, &(good * f32::NAN)).is_none());
    let mut turned_round = OrthographicProjection::default_3d();
    core::mem::swap(&mut turned_round.near, &mut turned_round.far);
    let turned_round = Projection::Orthographic(turned_round);
    assert!(ViewVolume::new(identity, &turned_round.get_clip_from_view()).is_none());
    assert!(ViewVolume::new(identity, &good).is_some());
}

proptest! {
    /// As for the two eyes of a headset, whose pictures need not be even.
    #[test]
    fn a_volume_around_two_holds_both(
        turn in any_turn(),
        aside in (-2.0..2.0_f32, -2.0..2.0_f32),
        even in (0.2..1.6_f32, 0.2..1.6_f32),
        aspect in 0.5..2.0_f32,
        is_orthographic in any::<bool>(),
    ) {
        let lens = |fov| if is_orthographic { orthographic() } else { perspective(fov, aspect) };
        let at = Vec3::new(10.0, 20.0, 30.0);
        let one = volume(&lens(even.0), at, turn);
        let there = at + turn * Vec3::new(aside.0, aside.1, 0.0);
        let mut other = volume(&lens(even.1), there, turn);
        other.max[1] *= if is_orthographic { 1.0 } else { 1.3 };
        let both = one.around(&other).expect("side by side");
        prop_assert_eq!((both.eye, both.axes), (one.eye, one.axes));
        prop_assert_eq!(both.is_perspective(), !is_orthographic);
        let mut spare = f64::INFINITY;
        for view in [one, other] {
            let seen = view.slice(view.nearest(), view.far.min(500.0)).expect("not empty");
            for corner in seen.corners {
                let depth = both.depth_of(corner);
                let at = both.axes.inverse() * (corner - both.eye);
                let [low, high] = [both.min, both.max].map(|[at_eye, growth]| at_eye + depth * growth);
                let rounding = 1e-5 * (1.0 + depth.abs());
                prop_assert!(depth > both.nearest() - rounding && depth < both.far + rounding);
                prop_assert!(at.truncate().cmpge(low - rounding).all(), "{at} {low} at {depth}");
                prop_assert!(at.truncate().cmple(high + rounding).all(), "{at} {high} at {depth}");
                spare = spare.min((high - at.truncate()).x);
            }
        }
        prop_assert!(spare < 0.1, "{spare} to spare");
    }

    /// Slices are by depth: of what is turned or ahead, other points are as deep.
    #[test]
    fn no_volume_is_around_views_of_other_depths(
        turn in any_turn(),
        cant in prop_oneof![-0.6..-0.001_f32, 0.001..0.6_f32],
        axis in 0..3_usize,
        ahead in prop_oneof![-2.0..-0.01_f32, 0.01..2.0_f32],
    ) {
        let lens = perspective(1.0, 1.5);
        let at = Vec3::new(10.0, 20.0, 30.0);
        let one = volume(&lens, at, turn);
        let canted = turn * Quat::from_axis_angle(Vec3::AXES[axis], cant);
        prop_assert_eq!(one.around(&volume(&lens, at, canted)), None);
        let there = at + turn * Vec3::new(0.1, 0.0, ahead);
        prop_assert_eq!(one.around(&volume(&lens, there, turn)), None);
        prop_assert_eq!(one.around(&volume(&orthographic(), at, turn)), None);
    }

    /// Of whatever scale a camera is, its slice is the one of a camera whose planes are scaled instead.
    #[test]
    fn scaled_cameras_have_scaled_slices(scale in -9.0..6.0_f64, turn in any_turn()) {
        let scale = 10.0_f64.powf(scale);
        let lens = perspective(0.9, 1.6).get_clip_from_view();
        let rotation = DQuat::from_xyzw(turn.x.into(), turn.y.into(), turn.z.into(), turn.w.into());
        let rotation = rotation.normalize();
        let of = |scale: f64| {
            let place = DAffine3::from_scale_rotation_translation(DVec3::splat(scale), rotation, DVec3::ZERO);
            let view = ViewVolume::new(place, &lens);
            view.and_then(|view| view.slice(1.0, 10.0))
        };
        let (scaled, unscaled) = (of(scale).expect("a camera"), of(1.0).expect("a camera"));
        let share = scaled.radius / (scale * unscaled.radius);
        prop_assert!((share - 1.0).abs() < 1.0 / 2048.0, "{} {}", scale, share);
        for corner in scaled.corners {
            prop_assert!(corner.distance(scaled.center) <= scaled.radius * (1.0 + 1.0 / 2048.0));
        }
    }

    #[test]
    fn the_bounding_sphere_holds_its_slice(
        turn in any_turn(),
        fov in 0.2..2.6_f32,
        aspect in 0.3..3.5_f32,
        near in 0.2..500.0_f64,
        length in 0.1..1500.0_f64,
    ) {
        let view = volume(&perspective(fov, aspect), Vec3::new(10.0, 20.0, 30.0), turn);
        let slice = view.slice(near, near + length).expect("not empty");
        for corner in slice.corners {
            prop_assert!(corner.distance(slice.center) <= slice.radius * (1.0 + 1e-6));
        }
    }

    #[test]
    fn a_turned_camera_keeps_the_radius_bit_for_bit(a in any_turn(), b in any_turn(), near in 0.2..100.0_f64) {
        let projection = perspective(1.0, 1.5);
        let radius = |turn| {
            volume(&projection, Vec3::new(5e4, 0.0, -3e4), turn).slice(near, 10.0 * near).map(|s| s.radius)
        };
        prop_assert_eq!(radius(a), radius(b));
    }
}

#[test]
fn double_precision_keeps_directions_apart() {
    let turned = DQuat::from_rotation_y(1e-9) * DVec3::Z;
    let frame = bevy_pssm::geometry::light_frame::LightFrame::new(turned).expect("a direction");
    assert!((frame.z - turned).length() < 1e-15);
}
