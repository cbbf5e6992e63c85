//! Techniques that the plugin does not have, worked out on the CPU under the same maps, to know
//! whether they would be worth it.

use std::collections::HashMap;

use bevy::{
    math::{DMat4, DVec2, DVec3},
    prelude::*,
};
use bevy_pssm::{
    ShadowPlans,
    geometry::bias::{MapDerivatives, automatic},
};

use super::{
    accuracy::{Accuracy, Figures, Truth},
    gather::Geometry,
    run::View,
    studio::Studio,
    trace::Tracer,
};

/// How wrong one would be.
pub struct Alternative {
    /// What it is.
    pub name: String,
    /// How wrong.
    pub figures: Figures,
}

/// Blurs of the picture of light (Scherzer and Wimmer, 4.3): deviations at 10 m (pixels). They
/// shrink with depth, and never exceed [`WIDEST`].
const BLURS: [f64; 3] = [1.0, 2.0, 4.0];
/// Pixels.
const WIDEST: f64 = 4.0;
/// Meters.
const BLUR_DISTANCE: f64 = 10.0;

/// Radius of the tent that maps are prefiltered by: that of the default filter (texels).
const TENT: f64 = 2.65;
/// Exponents of the warps of depth, as large as 32-bit floats bear (Lauritzen 2008).
const EXPONENT: f64 = 42.0;
/// Least deviation of depth (share of the map's depth).
const LEAST_DEVIATION: f64 = 1e-5;

impl Studio {
    /// What blurring some pictures of light would make of them.
    pub fn blurred(&self, views: &[View], shares: &[Vec<Option<f32>>]) -> Vec<Alternative> {
        let blur = |deviation: f64| {
            let mut accuracy = Accuracy::default();
            for (view, shares) in views.iter().zip(shares) {
                let blurred = blurred(&view.truth, shares, deviation);
                accuracy.add(&view.truth, &blurred);
            }
            Alternative {
                name: format!("2×2, blurred by {deviation} px at 10 m"),
                figures: accuracy.figures(),
            }
        };
        BLURS.into_iter().map(blur).collect()
    }

    /// What the maps in force would give at a view if they were filtered before and not after
    /// the comparison; and, by the same model, after it.
    pub fn prefiltered(&mut self, view: &View) -> Vec<Alternative> {
        // The maps for this view.
        let _ = self.shares(view);
        let (camera, sun, to_sun) = (self.camera, self.sun, self.sun_direction());
        let world = self.world();
        let tracer = Tracer::new(Geometry::gather(world));
        let plans = world
            .get::<ShadowPlans>(sun)
            .and_then(|plans| plans.views.get(&camera));
        let maps: Vec<Map> = plans
            .into_iter()
            .flatten()
            .filter_map(|plan| {
                let clip_from_world = plan.map.as_ref()?.clip_from_world;
                Some(Map {
                    clip_from_world,
                    world_from_clip: clip_from_world.inverse(),
                    size: plan.map_size.as_dvec2(),
                    far: plan.far,
                    depths: HashMap::new(),
                })
            })
            .collect();
        let mut model = Model {
            tracer,
            to_sun,
            maps,
        };
        let truth = &view.truth;
        let lights: Vec<Option<[f32; 3]>> = truth
            .samples
            .iter()
            .map(|sample| {
                let sample = sample.filter(|sample| sample.faces_sun)?;
                let depth = truth
                    .lens
                    .clip_from_world
                    .row(3)
                    .dot(sample.point.extend(1.0));
                Some(model.light(sample.point, sample.normal, depth))
            })
            .collect();
        let names = [
            "tent after comparing (model)",
            "exponential variance, tent before",
            "… with less light bleeding (0.3)",
        ];
        let figures = |index: usize| {
            let shares: Vec<_> = lights
                .iter()
                .map(|light| light.map(|light| light[index]))
                .collect();
            let mut accuracy = Accuracy::default();
            accuracy.add(truth, &shares);
            accuracy.figures()
        };
        names
            .into_iter()
            .enumerate()
            .map(|(index, name)| Alternative {
                name: name.to_owned(),
                figures: figures(index),
            })
            .collect()
    }
}

/// Mixes neighbors on the same surface.
fn blurred(truth: &Truth, shares: &[Option<f32>], at_distance: f64) -> Vec<Option<f32>> {
    let [width, height] = truth.size().to_array().map(|side| side as i64);
    let facing = |pixel: usize| truth.samples[pixel].filter(|sample| sample.faces_sun);
    let blur = |pixel: usize| {
        let (share, center) = (shares[pixel]?, facing(pixel));
        let Some(center) = center else {
            return Some(share);
        };
        let depth = truth
            .lens
            .clip_from_world
            .row(3)
            .dot(center.point.extend(1.0));
        let deviation = (at_distance * BLUR_DISTANCE / depth).min(WIDEST);
        let reach = (2.0 * deviation).ceil() as i64;
        let (x, y) = (pixel as i64 % width, pixel as i64 / width);
        let (mut sum, mut weights) = (0.0, 0.0);
        for j in (y - reach).max(0)..(y + reach + 1).min(height) {
            for i in (x - reach).max(0)..(x + reach + 1).min(width) {
                let other = (j * width + i) as usize;
                let (Some(sample), Some(share)) = (facing(other), shares[other]) else {
                    continue;
                };
                if !truth.lens.same_surface(&center, &sample) {
                    continue;
                }
                let squares = ((i - x).pow(2) + (j - y).pow(2)) as f64;
                let weight = (-0.5 * squares / deviation.powi(2).max(1e-6)).exp();
                sum += weight * f64::from(share);
                weights += weight;
            }
        }
        Some((sum / weights.max(1e-9)) as f32)
    };
    (0..shares.len()).map(blur).collect()
}

/// A map whose texels are found by rays, as they are needed.
struct Map {
    clip_from_world: DMat4,
    world_from_clip: DMat4,
    size: DVec2,
    far: f64,
    depths: HashMap<[i32; 2], f64>,
}

struct Model {
    tracer: Tracer,
    to_sun: DVec3,
    maps: Vec<Map>,
}

impl Model {
    /// Light at a point, by the techniques of [`Studio::prefiltered`].
    fn light(&mut self, point: DVec3, normal: DVec3, depth: f64) -> [f32; 3] {
        const LIT: [f32; 3] = [1.0; 3];
        let Some(map) = self.maps.iter_mut().find(|map| depth < map.far) else {
            return LIT;
        };
        let Some(bias) = automatic(&map.clip_from_world, point, normal, self.to_sun, map.size)
        else {
            return LIT;
        };
        let out = normal * bias.offset.copysign(normal.dot(self.to_sun));
        let Some(here) = MapDerivatives::at(&map.clip_from_world, point + out) else {
            return LIT;
        };
        let at = (here.ndc.truncate() * 0.5 + 0.5) * map.size;
        let (mut compared, mut weights) = (0.0, 0.0);
        let mut moments = [0.0; 4];
        let receiver = here.ndc.z + bias.most();
        let first = (at - TENT - 0.5).ceil();
        let last = at + TENT - 0.5;
        let mut y = first.y;
        while y <= last.y {
            let mut x = first.x;
            while x <= last.x {
                let offset = DVec2::new(x, y) + 0.5 - at;
                let weight = (1.0 - offset.abs() / TENT).max(DVec2::ZERO);
                let weight = weight.x * weight.y;
                let texel = [x as i32, y as i32];
                let stored = *map.depths.entry(texel).or_insert_with(|| {
                    let ndc = (DVec2::new(x, y) + 0.5) / map.size * 2.0 - 1.0;
                    let bottom = map.world_from_clip.project_point3(ndc.extend(0.0));
                    let top = map.world_from_clip.project_point3(ndc.extend(1.0));
                    let height = self.tracer.caster_height(bottom, self.to_sun);
                    (height.unwrap_or(0.0) / (top - bottom).length()).min(1.0)
                });
                let is_lit = stored <= here.ndc.z + bias.at(offset);
                compared += weight * f64::from(u8::from(is_lit));
                // Nearer to the light is more: turned around for the usual inequality.
                let (up, down) = warped(-stored);
                for (moment, value) in moments.iter_mut().zip([up, up * up, down, down * down]) {
                    *moment += weight * value;
                }
                weights += weight;
                x += 1.0;
            }
            y += 1.0;
        }
        let moments = moments.map(|moment| moment / weights);
        let (up, down) = warped(-receiver);
        let least = LEAST_DEVIATION * EXPONENT;
        let bound = f64::min(
            chebyshev(moments[0], moments[1], up, least * up),
            chebyshev(moments[2], moments[3], down, least * down.abs()),
        );
        let sharper = ((bound - 0.3) / 0.7).clamp(0.0, 1.0);
        [compared / weights, bound, sharper].map(|light| light as f32)
    }
}

fn warped(depth: f64) -> (f64, f64) {
    // From −1 to 0 becomes −1 to 1.
    let depth = 2.0 * depth + 1.0;
    ((EXPONENT * depth).exp(), -(-EXPONENT * depth).exp())
}

/// The most that can be at `depth` or beyond, of a distribution with these moments.
fn chebyshev(mean: f64, square: f64, depth: f64, least_deviation: f64) -> f64 {
    if depth <= mean {
        return 1.0;
    }
    let variance = (square - mean * mean).max(least_deviation * least_deviation);
    variance / (variance + (depth - mean).powi(2))
}
