//! From a scene and settings to figures.

use super::{
    accuracy::{Accuracy, Figures, Truth},
    cost::Frame,
    flicker::{Flips, Motion, Still, follow, steady},
    gather::Geometry,
    maps::{maps_of, texels_per_pixel},
    settings::{Setting, Technique},
    studio::{Picture, Stance, Studio},
    trace::Tracer,
};

/// How thoroughly to look.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// Rays across a pixel, for fractions.
    pub rays: u32,
    /// Poses at which flicker is measured, the first ones.
    pub flicker_poses: usize,
    /// Steps of each motion.
    pub steps: usize,
}

/// Frames after which the GPU's counts arrive.
const GPU_LATENCY: usize = 2;

/// One place to look from: the truth there, and on small motions away.
pub struct View {
    /// The first frame.
    pub still: Still,
    /// What figures are taken against.
    pub truth: Truth,
    motions: Vec<Vec<Still>>,
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
        // Everything has its place after a frame, and its shaders after a few.
        self.headless.settle();
        let tracer = Tracer::new(Geometry::gather(self.world()));
        let height = self.size.y as f32;
        let mut view = |(index, stance): (usize, &Stance)| {
            let still = self.still(&tracer, stance, None);
            let to_sun = self.sun_direction();
            let shares = tracer.shares(&still.lens, to_sun, &still.samples, effort.rays);
            done();
            let mut motions = Vec::new();
            for motion in Motion::ALL {
                if index >= effort.flicker_poses {
                    break;
                }
                let mut path: Vec<Still> = Vec::new();
                for step in 1..=effort.steps {
                    let stance = motion.step(stance, step, height);
                    path.push(self.still(&tracer, &stance, Some(&still)));
                    done();
                }
                motions.push(path);
            }
            View {
                truth: Truth::new(still.lens, still.samples.clone(), shares),
                still,
                motions,
            }
        };
        stances.iter().enumerate().map(&mut view).collect()
    }

    fn still(&mut self, tracer: &Tracer, stance: &Stance, before: Option<&Still>) -> Still {
        self.place(stance);
        let reference = self.reference();
        let (lens, to_sun) = (self.lens(), self.sun_direction());
        Still {
            stance: stance.clone(),
            lens,
            samples: tracer.picture(&lens, to_sun),
            reference,
            steady: before.map_or(Vec::new(), |before| {
                if before.stance.sun == stance.sun {
                    vec![true; before.samples.len()]
                } else {
                    steady(tracer, &before.samples, to_sun)
                }
            }),
        }
    }

    /// The picture from a still's place, under the setting in force.
    fn take(&mut self, still: &Still) -> Shot {
        self.place(&still.stance);
        let picture = self.shoot();
        let shares = still.reference.shares(&picture);
        Shot { picture, shares }
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
        let ours = matches!(setting.technique, Technique::Pssm(_));
        let (camera, sun, height) = (self.camera, self.sun, f64::from(self.size.y));
        let mut accuracy = Accuracy::default();
        let mut flips = [Flips::default(); 4];
        let mut fewest = [f64::INFINITY; 2];
        let mut shots: Vec<Shot> = Vec::new();
        let mut frames = Vec::new();
        for view in views {
            let shot = self.take(&view.still);
            frames.push(self.cost.clone());
            accuracy.add(&view.truth, &shot.shares);
            let maps = maps_of(self.world(), camera, sun, ours, height);
            let facing = view.still.samples.iter().flatten().filter(|s| s.faces_sun);
            let found = texels_per_pixel(&maps, &view.still.lens, facing.copied());
            fewest = [0, 1].map(|i| f64::min(fewest[i], found[i]));
            shots.push(shot);
            done();
        }
        for (view, shot) in views.iter().zip(&shots) {
            for (motion, path) in view.motions.iter().enumerate() {
                for still in path {
                    let after = self.take(still);
                    frames.push(self.cost.clone());
                    let (before, after) =
                        (view.still.seen(&shot.shares), still.seen(&after.shares));
                    flips[motion] += follow(before, after, &still.steady);
                    done();
                }
            }
        }
        // Until the counts of the last view have arrived.
        while frames.len() < views.len() + GPU_LATENCY {
            self.shoot();
            frames.push(self.cost.clone());
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
            shots,
        }
    }

    /// How many pixels of all views have a fault, under the setting in force.
    pub fn faults(&mut self, views: &[View], mut done: impl FnMut()) -> usize {
        let of_view = |view: &View| {
            let shares = self.take(&view.still).shares;
            done();
            view.truth.faults(&shares)
        };
        views.iter().map(of_view).sum()
    }
}
