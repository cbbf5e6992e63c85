//! The automatic bias: planes need no more than rounding, walls and bends their parts.

use bevy::math::{DMat4, DVec2, DVec3};
use bevy_pssm::geometry::{
    bias::{
        BEND_RECIPROCAL, MapDerivatives, STEEPEST_SLOPE, TEXEL_ROUNDING, WALL_SLOPE, automatic,
    },
    fit::{self, LookupReach},
    hysteresis::Slack,
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
            Slack(0.0),
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

#[test]
fn planes_across_the_light_have_no_slope_unwarped_and_edge_on_ones_a_bounded_one() {
    let map = map(DVec3::ZERO, DVec3::Y, 0.0);
    let point = DVec3::new(0.3, -1.0, -9.0);
    let here = MapDerivatives::at(&map, point).expect("it is in the map");
    let flat = here.depth_slope(DVec3::Y).expect("it faces the light");
    assert!(flat.length() < 1e-12, "{flat}");
    // From edge-on to the last slope that counts, nothing changes.
    let edge_on = here.depth_slope(DVec3::X).expect("it has a direction");
    assert!(edge_on.is_finite());
    let nearly = DVec3::new(1.0, 1.0 / 128.0, 0.0);
    let nearly = here.depth_slope(nearly).expect("it is lit");
    approx::assert_relative_eq!(edge_on.length(), nearly.length(), max_relative = 1e-3);
    assert_eq!(here.depth_slope(DVec3::ZERO), None);
    assert_eq!(MapDerivatives::at(&DMat4::ZERO, point), None);
}

proptest! {
    /// Each texel of a plane is found at the depth that the bias says, whatever the slope.
    #[test]
    fn texels_of_a_plane_need_rounding_alone(
        light in prop::array::uniform3(-1.0..1.0_f64),
        turn in prop::array::uniform3(-1.0..1.0_f64),
        depth in 3.0..35.0_f64,
        warp in prop_oneof![Just(0.0), 0.05..1.0_f64],
        offset in prop::array::uniform2(-6.0..6.0_f64),
    ) {
        let (to_light, turn) = (DVec3::from(light), DVec3::from(turn));
        prop_assume!(to_light.length() > 0.1);
        let to_light = to_light.normalize();
        let normal = (to_light + 20.0 * turn).normalize();
        let normal = normal * normal.dot(to_light).signum();
        // Steeper ones have an offset as well.
        prop_assume!(normal.dot(to_light) > 0.1);
        let size = DVec2::splat(512.0);
        let map = map(DVec3::ZERO, to_light, warp);
        let point = DVec3::new(0.2, -0.1, -1.0) * depth;
        let bias = automatic(&map, point, normal, to_light, size).expect("it is lit");
        let (here, offset) = (ndc(&map, point), DVec2::from(offset));
        let at = here.truncate() + 2.0 * offset / size;
        let texel = on_plane(&map, at, point, normal).expect("it meets the plane");
        let rise = ndc(&map, texel).z - here.z;
        let tolerance = 1e-6 * bias.most();
        let plane = bias.slope.dot(offset);
        prop_assert!((plane - rise).abs() <= tolerance, "{plane} for {rise}");
        // No less, and no more than what a single depth for all texels would have to be.
        let given = bias.at(offset) - bias.rounding;
        prop_assert!(given >= rise - tolerance && given <= rise + bias.most() + tolerance);
        if offset.abs().max_element() <= 1.0 {
            prop_assert!(given <= bias.most() + tolerance);
        }
    }
}

#[test]
fn the_automatic_bias_has_parts_for_walls_and_bends() {
    let size = DVec2::splat(512.0);
    let map = map(DVec3::ZERO, DVec3::Y, 0.0);
    let point = DVec3::new(0.3, -1.0, -9.0);
    let here = MapDerivatives::at(&map, point).expect("it is in the map");
    let per_meter = here.z.length();
    let texel = here.texel(size).max_element();
    let of = |normal| automatic(&map, point, normal, DVec3::Y, size).expect("it is lit");
    let texels = |depth: f64| depth / per_meter / texel;
    // Facing the light: what a wall rises, all of it from half a texel on, and nothing at the point.
    let flat = of(DVec3::Y);
    approx::assert_relative_eq!(texels(flat.at(DVec2::X)), WALL_SLOPE, max_relative = 1e-3);
    approx::assert_relative_eq!(flat.at(DVec2::X), flat.at(0.5 * DVec2::NEG_Y));
    assert_eq!(flat.at(DVec2::ZERO), flat.rounding);
    // Steep, along an axis of the map: uphill the plane's own rise and its bend, downhill a wall.
    let along = here.x.normalize();
    for steepness in [4.0, 12.0] {
        let steep = of(along * steepness + DVec3::Y);
        let uphill = DVec2::new(-0.5, 0.0);
        let bend = (1.0 + steepness * steepness) / f64::from(BEND_RECIPROCAL);
        let rounding = texels(steep.rounding);
        approx::assert_relative_eq!(rounding, TEXEL_ROUNDING * steepness, max_relative = 1e-2);
        let expected = (0.5 * (steepness + bend)).min(steepness) + rounding;
        approx::assert_relative_eq!(texels(steep.at(uphill)), expected, max_relative = 1e-3);
        let bent = 0.5 * (bend - steepness);
        let expected = WALL_SLOPE.max(bent).min(0.5 * steepness) + rounding;
        approx::assert_relative_eq!(texels(steep.at(-uphill)), expected, max_relative = 1e-3);
        assert_eq!(steep.offset, 0.0);
    }
    // On a gentle slope, uphill, a wall is no higher a texel away than half a texel.
    let gentle = of(along + DVec3::Y);
    for away in [0.5, 1.0] {
        let rise = gentle.at(away * DVec2::NEG_X) - gentle.rounding;
        approx::assert_relative_eq!(texels(rise), WALL_SLOPE, max_relative = 1e-3);
    }
    // Nearly edge-on: slope and offset together clear the plane as a greater slope would, and the
    // offset stays below a texel.
    for steepness in [20.0, 100.0, 1e6] {
        let normal = along * steepness + DVec3::Y;
        let steep = of(normal);
        let (rise, offset) = (texels(steep.slope.length()), steep.offset / texel);
        approx::assert_relative_eq!(rise, f64::from(STEEPEST_SLOPE), max_relative = 1e-6);
        let sine = normal.normalize().y.max(1.0 / 128.0);
        let needed = steepness.min(128.0);
        approx::assert_relative_eq!(rise + offset / sine, needed, max_relative = 1e-3);
        assert!(offset < 1.0, "{offset}");
    }
    // Far out, positions are coarser than texels.
    let far_out = DVec3::new(1e6, 0.0, 0.0);
    let far = automatic(&map, far_out, DVec3::Y, DVec3::Y, size).expect("it is lit");
    assert!(
        far.rounding / per_meter > 0.2,
        "{}",
        far.rounding / per_meter
    );
    // On a slope what moves them across the light moves them along it, too.
    let steepness = 4.0;
    let normal = along * steepness + DVec3::Y;
    let steep = automatic(&map, far_out, normal, DVec3::Y, size).expect("it is lit");
    let of_positions = steep.rounding - TEXEL_ROUNDING * steepness * texel * per_meter;
    let expected = (1.0 + steepness) * far.rounding;
    approx::assert_relative_eq!(of_positions, expected, max_relative = 1e-3);
}
