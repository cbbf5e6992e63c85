//! From a scene and settings to figures.

use bevy::prelude::GlobalTransform;
use bevy_pssm::ShadowPlans;

use super::{
    accuracy::{Accuracy, Figures, Truth},
    cost::Frame,
    flicker::{Flips, Motion, Nudge, steady},
    gather::Geometry,
    light::{Picture, Reference},
    maps::{maps_of, texels_per_pixel},
    settings::{Setting, Technique},
    studio::{Stance, Studio},
    trace::{Rays, Tracer},
};

/// How thoroughly to look.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// Rays across a pixel, for fractions.
    pub rays: Rays,
    /// Poses at which flicker is measured, the first ones.
    pub flicker_poses: usize,
    /// Steps of each motion.
    pub steps: usize,
}

/// Frames after which the GPU's counts arrive.
const GPU_LATENCY: usize = 2;

/// One place to look from, and the truth there.
pub struct View {
    stance: Stance,
    reference: Reference,
    /// What figures are taken against.
    pub truth: Truth,
    /// By step of the sun and by pixel, whether the truth stays the same; empty where flicker is
    /// not measured.
    steady: Vec<Vec<bool>>,
}

/// A picture, and what it says of the sun's light.
pub struct Shot {
    /// The picture.
    pub picture: Picture,
    /// By pixel, the share of the sun's light; `None` where it would not show.
    pub shares: Vec<Option<f32>>,
}

/// What a setting is worth in a scene.
pub struct Outcome {
    /// The setting.
    pub setting: Setting,
    /// How wrong.
    pub figures: Figures,
    /// Flips by motion, as [`Motion::ALL`].
    pub flips: [Flips; 4],
    /// Texels across a pixel where they are fewest: predicted, and at what is seen.
    pub texels_per_pixel: [f64; 2],
    /// Costs: of the first frame of each view, then of the others.
    pub frames: Vec<Frame>,
    /// By frame: its view.
    pub view_of: Vec<usize>,
    /// What each view looked like.
    pub shots: Vec<Shot>,
}

impl Studio {
    /// Takes stock of the scene from some places: truth by rays, pictures with and without sun.
    /// `done` is called after each frame.
    pub fn survey(
        &mut self,
        stances: &[Stance],
        effort: Effort,
        mut done: impl FnMut(),
    ) -> Vec<View> {
        self.headless.settle();
        let mut view = |(index, stance): (usize, &Stance)| {
            self.place(stance);
            let reference = self.reference();
            // Anew for each place: a sky, say, goes with the camera.
            let tracer = Tracer::new(Geometry::gather(self.world()));
            let (lens, to_sun) = (self.lens(), self.sun_direction());
            let samples = tracer.picture(&lens, to_sun);
            let shares = tracer.shares(&lens, to_sun, &samples, effort.rays);
            let steps = if index < effort.flicker_poses {
                effort.steps
            } else {
                0
            };
            let steady = (1..=steps).map(|step| {
                let mut sun = GlobalTransform::from(stance.sun);
                Motion::Sun.move_sun(step, &mut sun);
                steady(&tracer, &samples, sun.back().as_dvec3().normalize())
            });
            let view = View {
                stance: stance.clone(),
                reference,
                steady: steady.collect(),
                truth: Truth::new(lens, samples, shares),
            };
            done();
            view
        };
        stances.iter().enumerate().map(&mut view).collect()
    }

    /// The picture at a view, with maps laid as they are or for a small motion.
    fn take(&mut self, view: &View, nudge: Nudge) -> Shot {
        self.place(&view.stance);
        self.world().insert_resource(nudge);
        let picture = self.shoot();
        let shares = view.reference.shares(&picture);
        Shot { picture, shares }
    }

    /// Has maps forget what they hold on to, as from place to place.
    pub(super) fn forget(&mut self) {
        let sun = self.sun;
        if let Some(mut plans) = self.world().get_mut::<ShadowPlans>(sun) {
            *plans = ShadowPlans::default();
        }
    }

    /// By pixel, the share of the sun's light under what is in force.
    pub fn shares(&mut self, view: &View) -> Vec<Option<f32>> {
        self.forget();
        self.take(view, Nudge::default()).shares
    }

    /// Measures a setting. `done` is called after each frame.
    pub fn measure(&mut self, views: &[View], setting: &Setting, done: impl FnMut()) -> Outcome {
        self.apply(setting);
        self.observe(views, setting, done)
    }

    /// Measures what is in force, which should be a setting or something close to it.
    pub fn observe(
        &mut self,
        views: &[View],
        setting: &Setting,
        mut done: impl FnMut(),
    ) -> Outcome {
        let near = match &setting.technique {
            Technique::Pssm(config) => f64::from(config.near),
            Technique::Bevy(stock) => f64::from(stock.near),
        };
        let (camera, sun, height) = (self.camera, self.sun, f64::from(self.size.y));
        let mut accuracy = Accuracy::default();
        let mut flips = [Flips::default(); 4];
        let mut fewest = [f64::INFINITY; 2];
        let mut shots: Vec<Shot> = Vec::new();
        let mut frames = Vec::new();
        for view in views {
            self.forget();
            let shot = self.take(view, Nudge::default());
            frames.push(self.cost.clone());
            accuracy.add(&view.truth, &shot.shares);
            let maps = maps_of(self.world(), camera, sun, near, height);
            let found = texels_per_pixel(&maps, &view.truth);
            fewest = [0, 1].map(|i| f64::min(fewest[i], found[i]));
            shots.push(shot);
            done();
        }
        let mut view_of: Vec<usize> = (0..views.len()).collect();
        for (index, (view, before)) in views.iter().zip(&shots).enumerate() {
            if !view.steady.is_empty() {
                self.forget();
                self.take(view, Nudge::default());
                frames.push(self.cost.clone());
                view_of.push(index);
            }
            for (motion, flips) in Motion::ALL.into_iter().zip(&mut flips) {
                for (step, steady) in view.steady.iter().enumerate() {
                    let after = self.take(view, Nudge(Some((motion, step + 1))));
                    frames.push(self.cost.clone());
                    view_of.push(index);
                    *flips += Flips::between(&before.shares, &after.shares, steady);
                    done();
                }
            }
        }
        self.world().insert_resource(Nudge::default());
        // Until the counts of the last view have arrived.
        while frames.len() < views.len() + GPU_LATENCY {
            self.shoot();
            frames.push(self.cost.clone());
            view_of.push(views.len() - 1);
        }
        for index in GPU_LATENCY..frames.len() {
            frames[index - GPU_LATENCY].gpu = frames[index].gpu;
        }
        frames.truncate(frames.len() - GPU_LATENCY);
        Outcome {
            setting: setting.clone(),
            figures: accuracy.figures(),
            flips,
            texels_per_pixel: fewest,
            frames,
            view_of,
            shots,
        }
    }

    /// How wrong all views are, under the setting in force.
    pub fn figures(&mut self, views: &[View], mut done: impl FnMut()) -> Figures {
        let mut accuracy = Accuracy::default();
        for view in views {
            self.forget();
            let shot = self.take(view, Nudge::default());
            accuracy.add(&view.truth, &shot.shares);
            done();
        }
        accuracy.figures()
    }
}
