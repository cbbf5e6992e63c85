//! Whether the view has jumped since the last plan: then nothing is worth holding on to. What goes on as it did before
//! has not.

use glam::{DMat3, DQuat, DVec3};

use super::{PlanInputs, split::split_planes};
use crate::geometry::slice::ViewVolume;

/// Faster turns are cuts (cosine of ten degrees from frame to frame).
const LEAST_COSINE: f64 = 0.984_807_753;

/// Faster moves are cuts (share of the depth of the first slice, as set or as it was, from frame to
/// frame).
const MOST_MOVE: f64 = 0.5;

/// Faster zooms are cuts (times from frame to frame).
const MOST_ZOOM: f64 = 1.25;

/// The same view from another origin.
pub(super) fn relative_to(view: &ViewVolume, origin: DVec3) -> ViewVolume {
    ViewVolume {
        eye: view.eye - origin,
        ..*view
    }
}

/// What turns faster does not go on: what it sees is always something else (cosine of half a right angle from frame to
/// frame).
const LEAST_GOING_ON: f64 = core::f64::consts::FRAC_1_SQRT_2;

/// The view to which what moved and turned one view to the other goes on. `None` if it was so much that each sees something
/// else, or they have no directions.
pub(super) fn goes_on(
    inputs: &PlanInputs,
    before: &ViewVolume,
    last: &ViewVolume,
) -> Option<ViewVolume> {
    let (from, to) = (before.forward()?, last.forward()?);
    let is_far = from.dot(to) < LEAST_GOING_ON || before.eye.distance(last.eye) > inputs.far();
    let turn = DQuat::from_rotation_arc(from, to);
    (!is_far).then(|| ViewVolume {
        eye: last.eye + (last.eye - before.eye),
        axes: DMat3::from_quat(turn) * last.axes,
        ..*last
    })
}

/// Whether one view follows on the other by a cut. Both from the grids' origin; `first_plane` is where the
/// first slice ended in the other.
pub(super) fn is_cut(
    inputs: &PlanInputs,
    last: &ViewVolume,
    view: &ViewVolume,
    first_plane: f64,
) -> bool {
    let (Some(before), Some(now)) = (last.forward(), view.forward()) else {
        return true;
    };
    before.dot(now) < LEAST_COSINE || is_elsewhere(inputs, last, view, first_plane)
}

/// Whether one view is from somewhere else than the other, or through another lens, whatever their directions.
pub(super) fn is_elsewhere(
    inputs: &PlanInputs,
    last: &ViewVolume,
    view: &ViewVolume,
    first_plane: f64,
) -> bool {
    let cascades = inputs.config.cascades as usize;
    let planes = split_planes(&inputs.config.splits, inputs.near(), inputs.far(), cascades);
    let depth = planes[1].max(first_plane.min(inputs.far()));
    let zoom = (view.image_height(depth) / last.image_height(depth))
        .ln()
        .abs();
    last.eye.distance(view.eye) > MOST_MOVE * depth || zoom.is_nan() || zoom > MOST_ZOOM.ln()
}
