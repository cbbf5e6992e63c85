//! How maps follow a sun that moves: in steps, one map after the other, and turning about what is seen.

use glam::{DQuat, DVec2, DVec3};

use super::{CascadeHistory, PlanInputs};
use crate::{
    config::{CascadeFit, MAX_CASCADES},
    geometry::light_frame::{LightFrame, angle_between},
};

/// Faster suns jump (radians from frame to frame, or from what maps are drawn for).
const CUT: f64 = 0.1;

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
        let fresh = inputs.light.at(DVec3::ZERO);
        let frame = match (self.frame, self.error(to_light)) {
            (Some(frame), Some(error)) => beyond.map_or(frame, |beyond| {
                if error == 0.0 {
                    return frame;
                }
                let ahead = ahead(frame.z, to_light, error, beyond);
                let turned = self.about(frame, seen - at).following(ahead);
                turned.unwrap_or(fresh)
            }),
            _ => fresh,
        };
        self.frame = Some(frame);
        frame.at(at + frame.origin)
    }

    /// The same grid, anchored next to a point: what turns about that moves little of what is seen.
    fn about(&self, frame: LightFrame, point: DVec3) -> LightFrame {
        let cell = self.texel.extend(self.texel.max_element());
        if cell.min_element() <= 0.0 {
            return frame;
        }
        let whole = (frame.light_from_world(point) / cell).round() * cell;
        frame.at(frame.origin + frame.world_from_light() * whole)
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
    let farthest = (0..MAX_CASCADES)
        .max_by(|a, b| errors[*a].total_cmp(&errors[*b]))
        .unwrap_or(0);
    core::array::from_fn(|index| {
        let error = errors[index];
        let is_due = error > step || index == farthest && error > 0.5 * step;
        is_due.then_some(0.5 * step)
    })
}
