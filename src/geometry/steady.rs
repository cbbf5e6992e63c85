//! Sizes that would change with every frame, held: they grow at once, shrink late, and in steps.
//!
//! Held values depend on what was held before and on what is needed now, not on time: a camera
//! that stands still has them stand still.

/// How much larger than needed something may be, as a share; 0 for not at all.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slack(pub f64);

impl Slack {
    /// A length that is at least as long as needed (metres): a whole power of `1 + slack`. One that
    /// is held stays until it is too short, or two steps too long.
    pub fn length(self, needed: f64, held: Option<f64>) -> f64 {
        self.power(needed, held, 1.0)
    }

    /// As [`Slack::length`], for a length that must not be longer than needed.
    pub fn shorter(self, needed: f64, held: Option<f64>) -> f64 {
        self.power(needed, held, -1.0)
    }

    fn power(self, needed: f64, held: Option<f64>, side: f64) -> f64 {
        if self.0 <= 0.0 || needed <= 0.0 || !needed.is_finite() {
            return needed;
        }
        let step = 1.0 + self.0;
        let steps = needed.ln() / step.ln();
        let rounded = step.powf((side * steps).ceil() * side);
        let [least, most] = if side > 0.0 {
            [needed, rounded * step]
        } else {
            [rounded / step, needed]
        };
        held.filter(|held| (least..=most).contains(held))
            .unwrap_or(rounded)
    }

    /// An interval that holds the one needed (metres), its ends multiples of `slack · scale`. One
    /// that is held stays while it is no more than two steps too wide on either side.
    pub fn interval(self, needed: [f64; 2], scale: f64, held: Option<[f64; 2]>) -> [f64; 2] {
        let step = self.0 * scale;
        if step <= 0.0 || !step.is_finite() {
            return needed;
        }
        let [lo, hi] = needed;
        let rounded = [(lo / step).floor() * step, (hi / step).ceil() * step];
        held.filter(|[low, high]| {
            *low <= lo && hi <= *high && *low >= rounded[0] - step && *high <= rounded[1] + step
        })
        .unwrap_or(rounded)
    }
}
