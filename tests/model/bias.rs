//! The sufficient bias: no less will do, and no more is needed.

use bevy::math::{DMat4, DVec2, DVec3};
use bevy_pssm::geometry::{
    bias::{LEAST_SLOPE, MOST_TEXELS, MapDerivatives, TAP_REACH, automatic, sufficient},
    fit::{self, LookupReach},
    light_frame::LightFrame,
    slice::ViewVolume,
    warp::WarpFrame,
};
use glam::{DMat3, UVec2};
use proptest::prelude::*;

fn view(eye: DVec3) -> ViewVolume {
    let half = DVec2::new(0.75, 0.5);
    ViewVolume {
        eye,
        axes: DMat3::IDENTITY,
        min: [DVec2::ZERO, -half],
        max: [DVec2::ZERO, half],
        near: 0.0,
        far: f64::INFINITY,
    }
}

/// A stable map, or one warped by a share of what the classical rule says.
fn map(eye: DVec3, to_light: DVec3, warp: f64) -> DMat4 {
    let view = view(eye);
    let slice = view.slice(2.0, 40.0).expect("it is not empty");
    let light = LightFrame::new(to_light).expect("a direction");
    if warp == 0.0 {
        let map = fit::stable(
            &slice,
            &light,
            UVec2::splat(512),
            LookupReach { texels: 5.0 },
        );
        return map.clip_from_world(&light);
    }
    let frame = WarpFrame::of_view(&view, light.z).expect("a frame");
    let body = slice.vertices();
    let strength = warp * frame.lispsm_strength(2.0, 40.0);
    frame.clip_from_world(&body, strength)
}

fn ndc(map: &DMat4, point: DVec3) -> DVec3 {
    map.project_point3(point)
}

/// Where the light's ray through a place in the map meets a plane.
fn on_plane(map: &DMat4, at: DVec2, point: DVec3, normal: DVec3) -> Option<DVec3> {
    let world_from_ndc = map.inverse();
    let [a, b] = [0.25, 0.75].map(|z| world_from_ndc.project_point3(at.extend(z)));
    let along = (b - a).normalize();
    let t = (point - a).dot(normal) / along.dot(normal);
    t.is_finite().then(|| a + t * along)
}

proptest! {
    #[test]
    fn a_plane_needs_exactly_the_sufficient_bias(
        light in prop::array::uniform3(-1.0..1.0_f64),
        turn in prop::array::uniform3(-1.0..1.0_f64),
        eye in prop::array::uniform3(-300.0..300.0_f64),
        depth in 3.0..35.0_f64,
        warp in prop_oneof![Just(0.0), 0.05..1.0_f64],
        reach in prop::array::uniform2(0.5..6.0_f64),
    ) {
        let (to_light, turn) = (DVec3::from(light), DVec3::from(turn));
        prop_assume!(to_light.length() > 0.1);
        let to_light = to_light.normalize();
        // Towards the light, at any slope up to some 89°.
        let normal = (to_light + 20.0 * turn).normalize();
        let normal = normal * normal.dot(to_light).signum();
        prop_assume!(normal.dot(to_light) > 0.017);
        let (eye, size) = (DVec3::from(eye), DVec2::splat(512.0));
        let map = map(eye, to_light, warp);
        let point = eye + DVec3::new(0.2, -0.1, -1.0) * depth;
        let slope = MapDerivatives::at(&map, point)
            .and_then(|map| map.depth_slope(normal))
            .expect("it is lit");
        let reach = DVec2::from(reach);
        let bias = sufficient(slope, reach, size);

        // The depths that a lookup at the point reads, at the corners of its reach.
        let here = ndc(&map, point);
        let worst = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            .into_iter()
            .filter_map(|(x, y)| {
                let at = here.truncate() + DVec2::new(x, y) * 2.0 * reach / size;
                on_plane(&map, at, point, normal)
            })
            // Reverse z: greater is nearer to the light.
            .map(|neighbor| ndc(&map, neighbor).z - here.z)
            .fold(0.0, f64::max);
        let tolerance = 1e-6 * bias.max(1e-6);
        prop_assert!((worst - bias).abs() <= tolerance, "{worst} needed, {bias} given");
    }
}

#[test]
fn planes_across_the_light_have_no_slope_unwarped_and_edge_on_ones_a_bounded_one() {
    let map = map(DVec3::ZERO, DVec3::Y, 0.0);
    let point = DVec3::new(0.3, -1.0, -9.0);
    let here = MapDerivatives::at(&map, point).expect("it is in the map");
    let flat = here.depth_slope(DVec3::Y).expect("it faces the light");
    assert!(flat.length() < 1e-12, "{flat}");
    assert!(sufficient(flat, DVec2::ONE, DVec2::ONE) < 1e-12);
    // From edge-on to the last slope that counts, nothing changes.
    let edge_on = here.depth_slope(DVec3::X).expect("it has a direction");
    assert!(edge_on.is_finite());
    let nearly = DVec3::new(1.0, 1.0 / 128.0, 0.0);
    let nearly = here.depth_slope(nearly).expect("it is lit");
    approx::assert_relative_eq!(edge_on.length(), nearly.length(), max_relative = 1e-3);
    assert_eq!(here.depth_slope(DVec3::ZERO), None);
    assert_eq!(MapDerivatives::at(&DMat4::ZERO, point), None);
}

#[test]
fn the_automatic_bias_is_a_taps_reach_and_at_least_that_of_walls() {
    let size = DVec2::splat(512.0);
    let map = map(DVec3::ZERO, DVec3::Y, 0.0);
    let point = DVec3::new(0.3, -1.0, -9.0);
    let here = MapDerivatives::at(&map, point).expect("it is in the map");
    let per_meter = here.z.length();
    let texel = here.texel(size).max_element();
    let bias = |normal| {
        let bias = automatic(&map, point, normal, DVec3::Y, size).expect("it is lit");
        (bias.depth / per_meter / texel, bias.offset / texel)
    };
    // Facing the light: what a wall needs. Steep, along an axis of the map: the slope's own.
    let (depth, offset) = bias(DVec3::Y);
    approx::assert_relative_eq!(depth, LEAST_SLOPE, max_relative = 1e-3);
    assert_eq!(offset, 0.0);
    let along = here.x.normalize();
    let (depth, offset) = bias(along * 2.0 + DVec3::Y);
    approx::assert_relative_eq!(depth, 2.0 * TAP_REACH, max_relative = 1e-3);
    assert_eq!(offset, 0.0);
    // Too steep for depth alone: both together clear the plane as depth would, and the offset
    // stays below two texels in any direction.
    for steepness in [4.0, 20.0, 100.0, 1000.0] {
        let normal = along * steepness + DVec3::Y;
        let (depth, offset) = bias(normal);
        approx::assert_relative_eq!(depth, f64::from(MOST_TEXELS), max_relative = 1e-9);
        let sine = normal.normalize().y.max(1.0 / 128.0);
        let needed = TAP_REACH * f64::min(steepness, 128.0);
        approx::assert_relative_eq!(depth + offset / sine, needed, max_relative = 1e-3);
        let diagonal = along + here.y.normalize();
        assert!(bias(diagonal * steepness + DVec3::Y).1 < 2.0);
    }
    // Far out, positions are coarser than texels.
    let far_out = DVec3::new(1e6, 0.0, 0.0);
    let far = automatic(&map, far_out, DVec3::Y, DVec3::Y, size).expect("it is lit");
    assert!(far.depth / per_meter > 0.2, "{}", far.depth / per_meter);
}
