//! How maps follow a sun that moves: in steps, one map after the other, and turning about what is seen.

use glam::{DQuat, DVec2, DVec3};

use super::{CascadeHistory, PlanInputs};
use crate::{
    config::{CascadeFit, MAX_CASCADES, TexelGrid},
    geometry::light_frame::{LightFrame, angle_between},
};

/// Faster suns jump (radians from frame to frame, or from what maps are drawn for).
const CUT: f64 = 0.1;

/// Directions are as good as the same (radians).
const ROUNDING: f64 = 1e-12;

/// Maps that follow a sun go so far beyond it (share of a step): less than it may be off by, or they would come
/// back as it rests.
const BEYOND: f64 = 0.4;

/// The light's frame that a cascade's map is laid in.
#[derive(Debug, Default, Clone, PartialEq)]
pub(super) struct FollowedSun {
    /// Its origin as seen from where texel grids are anchored.
    frame: Option<LightFrame>,
    /// Of the map that was laid in it last (meters).
    pub texel: DVec2,
}

impl FollowedSun {
    /// How far it is behind or ahead of the sun (radians).
    fn error(&self, to_light: DVec3) -> Option<f64> {
        let frame = self.frame.as_ref()?;
        Some(angle_between(frame.z, to_light)).filter(|error| *error <= CUT)
    }

    /// The frame for the map over what is seen, in which it follows the sun `beyond` (radians) where it is;
    /// or stays, without.
    pub fn frame(&mut self, inputs: &PlanInputs, seen: DVec3, beyond: Option<f64>) -> LightFrame {
        let to_light = inputs.light.z;
        let at = inputs.light.origin;
        let frame = match (self.frame, self.error(to_light)) {
            (Some(frame), Some(error)) => beyond.map_or(frame, |beyond| {
                let ahead = ahead(frame.z, to_light, error, beyond);
                self.turned(inputs, frame, seen - at, ahead)
            }),
            _ => fresh(inputs, seen - at),
        };
        self.frame = Some(frame);
        frame.at(at + frame.origin)
    }

    /// The frame after a turn of the sun, about a point: then little of what is seen there moves.
    fn turned(
        &self,
        inputs: &PlanInputs,
        frame: LightFrame,
        point: DVec3,
        to_light: DVec3,
    ) -> LightFrame {
        if frame.z == to_light {
            return frame;
        }
        let frame = frame.at(self.anchor(&frame, point));
        let lowest = if frame.is_grounded {
            LOWEST_KEPT
        } else {
            LOWEST
        };
        let grounded = is_grounded(inputs)
            .then(|| LightFrame::grounded(to_light, lowest))
            .flatten();
        let turned = match grounded {
            Some(grounded) => Some(grounded.at(frame.origin)),
            // Nothing that it could follow.
            None if frame.is_grounded => None,
            None => frame.following(to_light),
        };
        turned.unwrap_or_else(|| fresh(inputs, point))
    }

    /// The origin of the same grid that lies next to a point: whole texels from the one it has, and on the
    /// point's level.
    fn anchor(&self, frame: &LightFrame, point_ws: DVec3) -> DVec3 {
        if !(self.texel.is_finite() && self.texel.min_element() > 0.0) {
            return frame.origin;
        }
        let offset_ls = frame.light_from_world(point_ws).truncate();
        let whole_ls = (offset_ls / self.texel).round() * self.texel;
        let across_ws = frame.origin + frame.world_from_light() * whole_ls.extend(0.0);
        // Along the light nothing moves over the map.
        let along = if frame.is_grounded {
            (point_ws.y - across_ws.y) / frame.z.y
        } else {
            frame.z.dot(point_ws - across_ws)
        };
        across_ws + frame.z * along
    }
}

/// Below this sine of its elevation (8°), a sun's maps do not stand on the ground; those that do, do so down
/// to 6°.
const LOWEST: f64 = 0.139;
const LOWEST_KEPT: f64 = 0.105;

fn is_grounded(inputs: &PlanInputs) -> bool {
    inputs.config.grid == TexelGrid::Ground
}

/// A frame that follows none, from where grids are anchored.
fn fresh(inputs: &PlanInputs, point: DVec3) -> LightFrame {
    let grounded = is_grounded(inputs).then(|| LightFrame::grounded(inputs.light.z, LOWEST));
    match grounded.flatten() {
        Some(grounded) => grounded.at(point.y * DVec3::Y),
        None => inputs.light.at(DVec3::ZERO),
    }
}

/// As far beyond a direction as said, on the way from another that is off by `error`.
fn ahead(from: DVec3, to: DVec3, error: f64, beyond: f64) -> DVec3 {
    if beyond == 0.0 {
        return to;
    }
    let axis = from.cross(to).normalize_or_zero();
    DQuat::from_axis_angle(axis, error + beyond) * from
}

/// Which cascades follow the sun in this frame, and how far beyond it (radians): those off by more than half
/// a step, the farthest first and no other in the same frame, unless it is off by a whole one.
pub(super) fn due(
    inputs: &PlanInputs,
    history: &[CascadeHistory; MAX_CASCADES],
) -> [Option<f64>; MAX_CASCADES] {
    // A view's faces turn with the sun.
    let step = if inputs.config.fit == CascadeFit::Faces {
        0.0
    } else {
        f64::from(inputs.config.sun_step).to_radians()
    };
    let errors = history
        .each_ref()
        .map(|kept| kept.sun.error(inputs.light.z).unwrap_or(0.0));
    let least = step.max(ROUNDING);
    let farthest = (0..MAX_CASCADES)
        .filter(|index| history[*index].held.is_some())
        .max_by(|a, b| errors[*a].total_cmp(&errors[*b]))
        .unwrap_or(0);
    core::array::from_fn(|index| {
        let error = errors[index];
        let is_due = error > least || index == farthest && error > 0.5 * least;
        // A sun that has jumped need not go on.
        let beyond = if error > 2.0 * step {
            0.0
        } else {
            BEYOND * step
        };
        is_due.then_some(beyond)
    })
}
