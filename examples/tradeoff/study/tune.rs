//! Bevy's shadows at their best: a small search per scene.

use super::{
    run::View,
    settings::{Setting, Stock},
    studio::Studio,
};

/// Size of the maps that are tuned (texels per side); what suits one size suits the others.
pub const TUNED_SIZE: u32 = 2048;

/// What is tried: ends of the first cascade (meters), normal biases (texels), depth biases
/// (meters).
struct Choices {
    first_far: &'static [f32],
    normal_bias: &'static [f32],
    depth_bias: &'static [f32],
}

const ALL: Choices = Choices {
    first_far: &[5.0, 20.0, 35.0, 60.0, 100.0],
    normal_bias: &[0.6, 0.9, 1.2, 1.5],
    depth_bias: &[0.0, 0.005, 0.05],
};

const QUICK: Choices = Choices {
    first_far: &[20.0, 40.0, 100.0],
    normal_bias: &[1.2, 1.5],
    depth_bias: &[],
};

fn choices(quick: bool) -> &'static Choices {
    if quick { &QUICK } else { &ALL }
}

/// How many settings [`Studio::tune`] measures.
pub fn attempts(quick: bool) -> usize {
    let choices = choices(quick);
    1 + choices.first_far.len() + choices.normal_bias.len() + choices.depth_bias.len()
}

impl Studio {
    /// The first bound, the normal bias and the depth bias, one after the other, that leave the
    /// fewest wrong pixels at the views, among those that stain no more than Bevy's defaults: else
    /// the least bias would win, with gray stripes all over that stay just under half the light.
    /// `done` is called after each frame.
    pub fn tune(
        &mut self,
        views: &[View],
        start: Stock,
        quick: bool,
        mut done: impl FnMut(),
    ) -> Stock {
        self.apply(&Setting::bevy("", start));
        let defaults = self.figures(views, &mut done);
        let mut best = (
            defaults.wrong_pct,
            Stock {
                tuned: true,
                ..start
            },
        );
        let mut attempt = |change: &dyn Fn(&mut Stock)| {
            let mut stock = best.1;
            change(&mut stock);
            self.apply(&Setting::bevy("", stock));
            let found = self.figures(views, &mut done);
            if found.stain_pct <= defaults.stain_pct && found.wrong_pct < best.0 {
                best = (found.wrong_pct, stock);
            }
        };
        let choices = choices(quick);
        for first_far in choices.first_far.iter().filter(|end| **end < start.far) {
            attempt(&|stock| stock.first_far = *first_far);
        }
        for normal_bias in choices.normal_bias {
            attempt(&|stock| stock.normal_bias = *normal_bias);
        }
        for depth_bias in choices.depth_bias {
            attempt(&|stock| stock.depth_bias = *depth_bias);
        }
        best.1
    }
}
