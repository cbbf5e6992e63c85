//! Along what a map is warped and how strongly, by what is set.

use glam::DVec3;

use crate::{
    config::{MapWarp, WarpAxis},
    geometry::{body::ConvexBody, slice::ViewVolume, warp::WarpFrame},
};

/// The direction, in world space, along which a warp over what is seen of a body runs. `None` if the
/// camera has none.
pub fn warp_direction(axis: WarpAxis, view: &ViewVolume, seen: &ConvexBody) -> Option<DVec3> {
    match axis {
        WarpAxis::View => view.forward(),
        // An orthographic camera may stand in the middle of what it sees.
        WarpAxis::BodyCenter => (seen.centroid() - view.eye)
            .try_normalize()
            .or_else(|| view.forward()),
    }
}

/// The frame and the strength (1/meters) of a warp along a direction, over what is seen of a body;
/// directions are in world space. `None` if light or camera have no direction.
pub fn warp_frame(
    warp: MapWarp,
    direction: DVec3,
    view: &ViewVolume,
    to_light: DVec3,
    seen: &ConvexBody,
) -> Option<(WarpFrame, f64)> {
    let frame = WarpFrame::along_or_up(view, direction, to_light)?;
    let vertices = seen.vertices(view);
    let depths = seen.corners.iter().map(|corner| view.depth_of(*corner));
    let (near, far) = depths.fold((f64::INFINITY, f64::NEG_INFINITY), |(near, far), depth| {
        (near.min(depth), far.max(depth))
    });
    let strength = match warp {
        MapWarp::Minimax => frame.guarded_minimax_strength(&vertices),
        // Nothing that is farther looks smaller, or it does from the eye on: no warp, or no bounds.
        _ if !view.is_perspective() || near <= 0.0 => 0.0,
        MapWarp::Lispsm => frame.lispsm_strength(near, far),
        MapWarp::Lloyd { eta } => frame.lloyd_strength(f64::from(eta), near, far),
        MapWarp::Trapezoid { focus } => {
            frame.trapezoid_strength(view, &vertices, near, far, f64::from(focus))
        }
        MapWarp::Strength(share) => f64::from(share) * frame.sine / near,
    };
    Some((frame, if strength.is_finite() { strength } else { 0.0 }))
}
