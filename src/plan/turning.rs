//! Whether a view keeps turning quickly: maps with more to spare are then drawn less often.

use super::PlanHistory;
use crate::{
    config::{MAX_CASCADES, MapFit},
    geometry::{
        hysteresis::{Hold, Kept},
        light_frame::angle_between,
        slice::ViewVolume,
    },
};

/// Of the angle that a view has turned by, what still counts after a frame.
const KEPT: f64 = 0.992;

/// A view turns quickly from so much on (radians): eight tenths of a degree per frame that are kept up, or more
/// than a right angle within few frames.
const QUICK: f64 = 1.75;

/// It does so no more below this.
const SLOW: f64 = 0.2;

/// Steps that the extent of a steady map then has to spare at least.
const MARGIN: f64 = 3.0;

/// How much a view has turned of late (radians).
#[derive(Debug, Default, Clone, Copy, PartialEq)]
pub(super) struct Turning {
    angle: f64,
    is_quick: bool,
}

impl Turning {
    /// Follows a view from frame to frame. Whether it has begun, or ceased, to turn quickly.
    fn follow(&mut self, last: &ViewVolume, view: &ViewVolume) -> bool {
        let (Some(before), Some(now)) = (last.forward(), view.forward()) else {
            return false;
        };
        let turned = angle_between(before, now);
        self.angle = KEPT * self.angle + turned;
        if turned == 0.0 && self.angle < SLOW {
            // At rest, nothing changes any more.
            self.angle = 0.0;
        }
        let was_quick = self.is_quick;
        self.is_quick = self.angle > if was_quick { SLOW } else { QUICK };
        self.is_quick != was_quick
    }

    /// How the extents of steady maps are held.
    fn hold(&self) -> Hold {
        let margin = if self.is_quick {
            MARGIN
        } else {
            Hold::LONG.margin
        };
        Hold {
            margin,
            ..Hold::LONG
        }
    }
}

impl PlanHistory {
    /// Follows a view. Steady maps get other extents as soon as it turns quickly, and when it does so no more.
    pub(super) fn follow_turn(&mut self, last: &ViewVolume, view: &ViewVolume) {
        let Some(config) = &self.config else {
            return;
        };
        let is_steady = |index| config.fit.of_cascade(index).next() == Some(MapFit::Steady);
        if !(0..MAX_CASCADES).any(is_steady) || !self.turning.follow(last, view) {
            return;
        }
        let held = Kept::with(self.turning.hold());
        for (index, cascade) in self.cascades.iter_mut().enumerate() {
            if is_steady(index) {
                cascade.extent = [held; 2];
            }
        }
    }
}
