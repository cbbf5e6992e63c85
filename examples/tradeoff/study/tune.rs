//! Bevy's shadows at their best: a small search per scene.

use super::{
    run::View,
    settings::{Setting, Stock},
    studio::Studio,
};

/// Size of the maps that are tuned (texels per side); what suits one size suits the others.
pub const TUNED_SIZE: u32 = 2048;

/// Ends of the first cascade that are tried (metres).
const FIRST_FAR: [f32; 5] = [5.0, 20.0, 35.0, 60.0, 100.0];
/// Normal biases that are tried (texels).
const NORMAL_BIAS: [f32; 4] = [0.3, 0.6, 0.9, 1.3];
/// Depth biases that are tried (metres).
const DEPTH_BIAS: [f32; 3] = [0.0, 0.005, 0.05];

/// How many settings [`Studio::tune`] measures.
pub fn attempts(quick: bool) -> usize {
    1 + FIRST_FAR.len() + NORMAL_BIAS.len() + if quick { 0 } else { DEPTH_BIAS.len() }
}

impl Studio {
    /// The first bound, the normal bias and the depth bias, one after the other, that leave the
    /// fewest wrong pixels at the views; Bevy's defaults among them. `done` is called after each
    /// frame.
    pub fn tune(
        &mut self,
        views: &[View],
        start: Stock,
        quick: bool,
        mut done: impl FnMut(),
    ) -> Stock {
        let mut wrong_pixels = |studio: &mut Self, stock: Stock| {
            studio.apply(&Setting::bevy("", stock));
            studio.wrong_pixels(views, &mut done)
        };
        let mut best = (wrong_pixels(self, start), start);
        let mut attempt =
            |studio: &mut Self, best: &mut (usize, Stock), change: &dyn Fn(&mut Stock)| {
                let mut stock = best.1;
                change(&mut stock);
                let wrong = wrong_pixels(studio, stock);
                if wrong < best.0 {
                    *best = (wrong, stock);
                }
            };
        for first_far in FIRST_FAR {
            attempt(self, &mut best, &|stock| stock.first_far = first_far);
        }
        for normal_bias in NORMAL_BIAS {
            attempt(self, &mut best, &|stock| stock.normal_bias = normal_bias);
        }
        for depth_bias in DEPTH_BIAS.iter().filter(|_| !quick) {
            attempt(self, &mut best, &|stock| stock.depth_bias = *depth_bias);
        }
        best.1
    }
}
