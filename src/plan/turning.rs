//! Whether a view keeps turning: maps then serve for what it has seen on the way and, if it turns quickly, have
//! more to spare, so that they are drawn less often. And whether it zooms: then they have nothing to spare.

use super::{
    PlanHistory, PlanInputs,
    cut::is_elsewhere,
    layout::{KeptRange, MOST_LATE_STEPS, split_range},
    split::split_planes,
};
use crate::{
    config::{MAX_CASCADES, MapFit},
    geometry::{
        hysteresis::{Hold, Slack},
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

/// Steps that the extent of a steady map then has to spare.
const MARGIN: f64 = 3.0;

/// A view turns once it has turned by so much (radians) where it is, without coming to look at something.
const TURNS: f64 = 0.1;

/// It goes on turning once it has done so by that much (radians: half a right angle).
const GOING_ON: f64 = 0.79;

/// When one steady map has to grow as a view turns, all get as many steps to spare as make them this many times larger,
const WIDER: f64 = 1.35;

/// and those that have to grow all the same so many.
const MUCH_WIDER: f64 = 1.65;

/// It looks at something while it turns by less than this in a frame (radians: a tenth of a degree),
const IDLE: f64 = 0.00175;

/// in so many frames in a row.
const IDLE_FRAMES: u32 = 10;

/// What has been seen on the way counts no more where the first slice ends, or would end, at so small a share of the
/// depth.
const NEARER: f64 = 0.25;

/// A view zooms for so many frames after it has last shown more or less.
const ZOOM_FRAMES: u32 = 30;

/// By less (a share of what it shows) it does not: lenses may breathe, and numbers are rounded.
const LEAST_ZOOM: f64 = 1e-3;

/// How extents are held meanwhile, closely: what is enlarged shows its texels.
const ZOOMING: Hold = Hold {
    steps: 2.0,
    margin: 0.0,
    headroom: 0,
    ..Hold::LONG
};

/// How steady maps are widened.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Widening {
    /// Of those, too, that need not grow.
    pub of_all: bool,
    /// That they have to spare then.
    pub steps: u32,
}

/// How much a view has turned of late (radians), and whether it zooms.
#[derive(Debug, Default, Clone, Copy, PartialEq)]
pub(super) struct Turning {
    angle: f64,
    is_quick: bool,
    /// For how many frames in a row it has hardly turned, up to [`IDLE_FRAMES`].
    idle: u32,
    /// The view from which on it has been turning, and by how much (radians).
    since: Option<ViewVolume>,
    way: f64,
    /// All steady maps have been widened since then.
    has_widened: bool,
    /// Depth at which the first slice ended when extents were let go of, or bounded, for the last time (meters).
    first_plane: f64,
    /// The view that showed more or less, for the last time, and for how many frames it still zooms.
    lens: Option<ViewVolume>,
    zooms: u32,
}

impl Turning {
    /// Follows a view from frame to frame.
    fn follow(
        &mut self,
        inputs: &PlanInputs,
        last: &ViewVolume,
        view: &ViewVolume,
        first_plane: f64,
    ) {
        let (Some(before), Some(now)) = (last.forward(), view.forward()) else {
            return;
        };
        let turned = angle_between(before, now);
        self.angle = KEPT * self.angle + turned;
        if turned == 0.0 && self.angle < SLOW {
            // At rest, nothing changes any more.
            self.angle = 0.0;
        }
        self.is_quick = self.angle > if self.is_quick { SLOW } else { QUICK };
        self.idle = if turned < IDLE {
            IDLE_FRAMES.min(self.idle + 1)
        } else {
            0
        };
        let lens = self.lens.get_or_insert(*last);
        let zoom = view.image_height(first_plane) / lens.image_height(first_plane);
        if (zoom - 1.0).abs() > LEAST_ZOOM {
            *lens = *view;
            self.zooms = ZOOM_FRAMES;
        } else {
            self.zooms = self.zooms.saturating_sub(1);
        }
        let since = self.since.get_or_insert(*last);
        if self.idle < IDLE_FRAMES && !is_elsewhere(inputs, since, view, first_plane) {
            self.way = GOING_ON.min(self.way + turned);
        } else {
            self.way = 0.0;
            self.since = None;
            self.has_widened = false;
        }
    }

    /// Whether what is seen is soon something else, so that what has been seen counts as well.
    fn goes_on(&self) -> bool {
        self.way >= GOING_ON
    }

    /// How steady maps are to be widened of which some have had to grow, or are new.
    pub fn widen(&mut self, slack: Slack) -> Option<Widening> {
        if self.way < TURNS || self.zooms > 0 {
            return None;
        }
        let of_all = !core::mem::replace(&mut self.has_widened, true);
        let times = if of_all { WIDER } else { MUCH_WIDER };
        let has = if self.is_quick { MARGIN as u32 } else { 0 };
        // More would be too many as soon as the view stops.
        let steps = slack.steps_within(times).min(Hold::LONG.steps as u32);
        let steps = steps.saturating_sub(has);
        Some(Widening { of_all, steps })
    }

    /// How the extents of steady maps are held.
    fn extents(&self) -> Hold {
        if self.zooms > 0 {
            return ZOOMING;
        }
        let margin = if self.is_quick {
            MARGIN
        } else {
            Hold::LONG.margin
        };
        Hold {
            steps: self.steps(Hold::LONG.steps),
            margin,
            ..Hold::LONG
        }
    }

    /// How extents are held whose slices have become others, the first one ending at `first_plane` (meters): while the
    /// view turns, unless much too large; while it goes on turning, unless all is much nearer.
    pub fn other_slices(&mut self, first_plane: f64) -> Option<Hold> {
        if self.goes_on() && first_plane > NEARER * self.first_plane {
            return Some(self.extents());
        }
        self.first_plane = first_plane;
        if self.angle <= SLOW {
            self.has_widened = false;
            return None;
        }
        let extents = self.extents();
        Some(Hold {
            steps: extents.steps.min(Hold::LONG.steps),
            ..extents
        })
    }

    /// The same of those of which nothing is seen: while it goes on turning.
    pub fn unseen_slices(&self) -> Option<Hold> {
        self.goes_on().then(|| self.extents())
    }

    /// How the depths are that splits of steady maps are spread over.
    pub fn depths(&self) -> Hold {
        Hold {
            steps: self.steps(2.0),
            // What is enlarged shows its texels, and what is much too coarse goes as soon as a quick turn ends.
            lag: if self.zooms > 0 || self.is_quick {
                0
            } else {
                MOST_LATE_STEPS
            },
            margin: 0.0,
            headroom: 0,
            ..Hold::LONG
        }
    }

    /// So many steps too large, or as large as for anything that has been seen in a turn.
    fn steps(&self, steps: f64) -> f64 {
        if self.goes_on() { f64::INFINITY } else { steps }
    }
}

impl PlanHistory {
    /// However a view goes on turning, nothing is held of what is much farther than all that is seen now.
    pub(super) fn let_go_of_what_is_far(&mut self, inputs: &PlanInputs) {
        let Some(held) = self.range.filter(|_| self.turning.goes_on()) else {
            return;
        };
        let config = inputs.config;
        // Fewer slices may be in use.
        let first_plane = |[near, far]: [f64; 2]| {
            split_planes(&config.splits, near, far, config.cascades as usize)[1]
        };
        let seen = split_range(inputs, self.range, &mut KeptRange::default());
        if first_plane(seen) < NEARER * first_plane(held) {
            self.kept_range = KeptRange::with(self.turning.depths());
            for cascade in &mut self.cascades {
                cascade.forget_slice(None);
            }
        }
    }

    /// Follows a view. Steady maps are held in another way while it keeps turning, have more to spare as soon as
    /// it turns quickly, and no more than before when it has stopped.
    pub(super) fn follow_turn(
        &mut self,
        inputs: &PlanInputs,
        last: &ViewVolume,
        view: &ViewVolume,
    ) {
        let Some(config) = &self.config else {
            return;
        };
        let is_steady = |index| config.fit.of_cascade(index).next() == Some(MapFit::Steady);
        if !(0..MAX_CASCADES).any(is_steady) {
            return;
        }
        let before = self.turning;
        self.turning.follow(inputs, last, view, self.first_plane);
        let now = self.turning;
        self.kept_range.hold_as(now.depths());
        for (index, cascade) in self.cascades.iter_mut().enumerate() {
            if !is_steady(index) {
                continue;
            }
            for extent in &mut cascade.extent {
                extent.hold_as(now.extents());
                if before.has_widened && !now.has_widened || now.zooms > 0 {
                    extent.settle();
                }
                match (now.is_quick != before.is_quick, now.goes_on()) {
                    (true, false) => extent.forget(),
                    (true, true) if now.is_quick && !now.has_widened => extent.widen(0),
                    _ => (),
                }
            }
        }
    }
}
