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

/// A map waits until it is off by so much (share of its step), then goes so far beyond the sun: less than it may
/// be off by, or it would come back as the sun rests.
const LATE: f64 = 0.6;
const BEYOND: f64 = 0.5;

/// A step may move the shadow of what is so far away (meters), towards the sun, by a texel: coarse maps go in larger
/// steps, up to so many times what is asked for, and no larger than so (radians).
const DISTANCE: f64 = 10.0;
const LARGEST: f64 = 4.0;
const LIMIT: f64 = 1.0_f64.to_radians();

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

    /// The frame for a map whose texels are finer than those that it could wait with, if it is too far off for them.
    pub fn frame_for(
        &mut self,
        inputs: &PlanInputs,
        seen: DVec3,
        texel: DVec2,
    ) -> Option<LightFrame> {
        let is_close = self.error(inputs.light.z)? <= step(inputs, texel);
        (!is_close).then(|| self.frame(inputs, seen, Some(0.0)))
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

/// The step in which a map of such texels (meters) follows the sun (radians): as asked for, or larger for coarse ones.
fn step(inputs: &PlanInputs, texel: DVec2) -> f64 {
    // A view's faces turn with the sun.
    if inputs.config.fit == CascadeFit::Faces {
        return ROUNDING;
    }
    let asked = f64::from(inputs.config.sun_step).to_radians();
    let texel = texel.min_element();
    let unseen = if texel.is_finite() {
        texel / DISTANCE
    } else {
        0.0
    };
    let most = LIMIT.min(LARGEST * asked);
    unseen.min(most).max(asked).max(ROUNDING)
}

/// Which cascades follow the sun in this frame, and how far beyond it (radians): those that have waited long
/// enough, the one farthest off first and no other in the same frame, unless it is off by a whole step. Off by
/// how much is counted in steps, which are not the same for all.
pub(super) fn due(
    inputs: &PlanInputs,
    history: &[CascadeHistory; MAX_CASCADES],
) -> [Option<f64>; MAX_CASCADES] {
    let steps = history.each_ref().map(|kept| step(inputs, kept.texel()));
    let late: [f64; MAX_CASCADES] = core::array::from_fn(|index| {
        let error = history[index].sun.error(inputs.light.z).unwrap_or(0.0);
        error / steps[index]
    });
    let latest = (0..MAX_CASCADES)
        .filter(|index| history[*index].held.is_some())
        .max_by(|a, b| late[*a].total_cmp(&late[*b]))
        .unwrap_or(0);
    core::array::from_fn(|index| {
        let late = late[index];
        let is_due = late > 1.0 || index == latest && late > LATE;
        // A sun that has jumped need not go on.
        let beyond = if late > 2.0 {
            0.0
        } else {
            BEYOND * steps[index]
        };
        is_due.then_some(beyond)
    })
}
