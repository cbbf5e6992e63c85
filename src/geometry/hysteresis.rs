//! Hysteresis for sizes that would change with every frame: they grow at once (or, where they may lag, by a few steps
//! later), shrink after a delay or when they are much too large, and all in steps.

use glam::DVec2;

/// How much larger than needed something may be, as a share; 0 for not at all.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slack(pub f64);

/// A value that is held from frame to frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Kept<T> {
    value: Option<T>,
    /// For how many frames in a row it has been much larger than needed, or smaller.
    frames_off: u32,
    /// How often it has grown since it last had time to shrink.
    growths: u32,
    /// It is to have as much to spare as if it were new, and so many steps more.
    widens: Option<u32>,
    /// Steps that it has to spare for a while: they are not too many.
    spare: u32,
    hold: Hold,
}

/// How long and how much too large something may be held.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hold {
    /// Frames for which something must have been two steps too large before it shrinks.
    pub frames: u32,
    /// Steps by which it may be too large at most, whatever moves: beyond, it shrinks at once. Infinite for any
    /// number.
    pub steps: f64,
    /// Steps by which it may be too small for as many frames: none where what is needed must be had.
    pub lag: u32,
    /// Steps that a length has to spare at least when it is new.
    pub margin: f64,
    /// Steps that something which keeps growing is made larger than needed, so that it grows less
    /// often: one the first time, then one more, up to this.
    pub headroom: u32,
}

impl Hold {
    /// Half a second at 60 frames per second, and about one and a half times for a slack of a tenth.
    pub const SHORT: Self = Self {
        frames: SHRINK_DELAY,
        steps: 4.0,
        lag: 0,
        margin: 0.0,
        headroom: 0,
    };

    /// Ten seconds at 60 frames per second, for what is to change as seldom as can be.
    pub const LONG: Self = Self {
        frames: 600,
        steps: 7.0,
        lag: 0,
        margin: 0.5,
        headroom: 3,
    };

    /// With so large a `step` that what has headroom is no more than about twice too large.
    fn within(self, step: f64) -> Self {
        if self.headroom == 0 {
            return self;
        }
        let doublings = core::f64::consts::LN_2 / step.ln();
        let steps = if self.steps.is_finite() {
            self.steps.min(doublings.max(1.0))
        } else {
            self.steps
        };
        Self {
            steps,
            margin: self.margin.min(0.5 * doublings.max(1.0)),
            headroom: self.headroom.min((0.5 * doublings) as u32),
            ..self
        }
    }
}

impl<T> Default for Kept<T> {
    fn default() -> Self {
        Self::with(Hold::SHORT)
    }
}

/// Frames for which something must have been too large before it shrinks: half a second at 60 per second.
pub const SHRINK_DELAY: u32 = 30;

/// Steps are powers and multiples of floating-point numbers, and compared with such.
const ROUNDING: f64 = 1e-9;

/// Of the steps that a length has to spare when it has grown, so many are one's that need not have.
const MOST_SPARED: u32 = 2;

impl Slack {
    /// As [`Slack::round_up`], of two lengths that grow together where they can: when one of them does, the other
    /// gets as much to spare, or it would soon follow.
    pub fn round_up_both(self, needed: DVec2, kept: &mut [Kept<f64>; 2]) -> DVec2 {
        let before = *kept;
        let [x, y] = kept;
        let mut rounded = DVec2::new(self.round_up(needed.x, x), self.round_up(needed.y, y));
        // They have been told to.
        if before.iter().any(|kept| kept.widens.is_some()) {
            return rounded;
        }
        match [x.has_grown(&before[0]), y.has_grown(&before[1])] {
            [true, false] => {
                y.widen(x.growths.min(MOST_SPARED));
                rounded.y = self.round_up(needed.y, y);
            }
            [false, true] => {
                x.widen(y.growths.min(MOST_SPARED));
                rounded.x = self.round_up(needed.x, x);
            }
            _ => (),
        }
        rounded
    }

    /// A length that is at least as long as needed (meters): a whole power of `1 + slack`. One that
    /// is held stays until it is too short, much too long, or has been two steps too long for a while.
    pub fn round_up(self, needed: f64, kept: &mut Kept<f64>) -> f64 {
        self.power(needed, kept, 1.0)
    }

    /// How many steps make something that many times as large at most.
    pub fn steps_within(self, times: f64) -> u32 {
        (times.ln() / self.0.ln_1p() + ROUNDING) as u32
    }

    /// The least whole power of the root of `1 + slack` that is at least as long as needed (meters).
    pub fn round_up_at_once(self, needed: f64) -> f64 {
        let finer = Self((1.0 + self.0).sqrt() - 1.0);
        finer.power(needed, &mut Kept::default(), 1.0)
    }

    /// As [`Slack::round_up`], for a length that must not be longer than needed (but where it may lag).
    pub fn round_down(self, needed: f64, kept: &mut Kept<f64>) -> f64 {
        self.power(needed, kept, -1.0)
    }

    fn power(self, needed: f64, kept: &mut Kept<f64>, side: f64) -> f64 {
        if self.0 <= ROUNDING || needed <= 0.0 || !needed.is_finite() {
            return needed;
        }
        let step = 1.0 + self.0;
        let steps = side * needed.ln() / step.ln();
        let hold = kept.hold.within(step);
        let least = (steps - ROUNDING + hold.margin).ceil();
        let rounded = step.powf(side * least);
        let too_large = |value: f64| side * (value / rounded).ln();
        kept.update(
            hold,
            |headroom| step.powf(side * (least + headroom)),
            |value| side * (value / needed).ln() >= -ROUNDING,
            |value| too_large(value) / step.ln() - ROUNDING,
        )
    }

    /// An interval that holds the one needed (meters), its ends multiples of `slack · scale`. One
    /// that is held stays until it is too narrow, much too wide, or has been two steps too wide for a
    /// while.
    pub fn interval(self, needed: [f64; 2], scale: f64, kept: &mut Kept<[f64; 2]>) -> [f64; 2] {
        let step = self.0 * scale;
        if self.0 <= ROUNDING || step <= 0.0 || !step.is_finite() {
            return needed;
        }
        let [lo, hi] = needed.map(|end| end / step);
        let rounded = [(lo + ROUNDING).floor(), (hi - ROUNDING).ceil()];
        let in_steps = |[low, high]: [f64; 2]| [low / step, high / step];
        kept.update(
            kept.hold,
            |headroom| {
                [
                    (rounded[0] - headroom) * step,
                    (rounded[1] + headroom) * step,
                ]
            },
            |value| {
                let [low, high] = in_steps(value);
                low <= lo + ROUNDING && high >= hi - ROUNDING
            },
            |value| {
                let [low, high] = in_steps(value);
                (rounded[0] - low).max(high - rounded[1]) - ROUNDING
            },
        )
    }
}

impl<T> Kept<T> {
    /// Nothing yet.
    pub fn with(hold: Hold) -> Self {
        Self {
            value: None,
            frames_off: 0,
            growths: 0,
            widens: None,
            spare: 0,
            hold,
        }
    }

    /// Has what is held become so many steps larger than it would be if it were new, unless it is that large.
    pub fn widen(&mut self, headroom: u32) {
        self.widens = Some(headroom);
    }

    /// The same, and that is not too large until it [settles](Self::settle).
    pub fn spread(&mut self, headroom: u32) {
        self.widen(headroom);
        self.spare = headroom;
    }

    /// Needs no more to spare than others.
    pub fn settle(&mut self) {
        self.spare = 0;
    }

    /// Holds on in another way.
    pub fn hold_as(&mut self, hold: Hold) {
        self.hold = hold;
    }

    /// May be too small by no more steps than these.
    pub fn lag_at_most(&mut self, steps: u32) {
        self.hold.lag = self.hold.lag.min(steps);
    }

    /// A frame in which nothing is needed: so many in all, and what is held is let go.
    pub fn wait(&mut self) {
        if self.value.is_some() {
            self.frames_off += 1;
        }
        if self.frames_off > self.hold.frames {
            self.forget();
        }
    }

    /// Lets go of what is held.
    pub fn forget(&mut self) {
        *self = Self::with(self.hold);
    }
}

impl Kept<f64> {
    /// Whether it has become larger than it was, or is new.
    pub fn has_grown(&self, before: &Self) -> bool {
        self.value > before.value
    }
}

impl<T: Copy> Kept<T> {
    /// What is held, or else what is `needed`, with so many steps to spare. `steps_too_large`: by how many
    /// steps a value is.
    fn update(
        &mut self,
        hold: Hold,
        needed: impl Fn(f64) -> T,
        suffices: impl Fn(T) -> bool,
        steps_too_large: impl Fn(T) -> f64,
    ) -> T {
        let widens = self.widens.take();
        let Some(value) = self.value else {
            return *self.value.insert(needed(0.0));
        };
        let mut headroom = 0;
        let steps = steps_too_large(value);
        let may_lag = hold.lag > 0 && steps >= -f64::from(hold.lag) - 0.5;
        if suffices(value) {
            // Half a step allows for rounding: they are whole ones.
            let widened = widens.filter(|widened| steps < f64::from(*widened) - 0.5);
            if let Some(widened) = widened {
                headroom = widened;
            } else if steps <= 1.0 + f64::from(self.spare) {
                self.frames_off = 0;
                return value;
            } else if steps <= hold.steps {
                if self.frames_off < hold.frames {
                    self.frames_off += 1;
                    return value;
                }
                self.growths = 0;
            }
        } else if may_lag && self.frames_off < hold.frames {
            self.frames_off += 1;
            return value;
        } else {
            self.growths = hold.headroom.min(self.growths + 1);
            headroom = self.growths;
        }
        self.frames_off = 0;
        *self.value.insert(needed(f64::from(headroom)))
    }
}
