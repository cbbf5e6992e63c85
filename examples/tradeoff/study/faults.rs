//! What is wrong in a case for the bias' sake alone.

use bevy::math::{DMat2, DVec2, DVec3};
use bevy_pssm::geometry::bias::{MapDerivatives, automatic};

use super::{
    gather::Geometry,
    maps::{Map, maps_of},
    run::View,
    studio::Studio,
    trace::Tracer,
};

/// Faults that are the bias' own, in percent of the pixels that can have them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BiasFaults {
    /// Lit pixels farther from any shadow than the filter reaches that lack a tenth of the light.
    pub stain_pct: f64,
    /// Shadowed pixels that get more than half the light.
    pub leak_pct: f64,
    /// How far behind the box of [`Case::Contact`](super::cases::Case::Contact) its shadow begins, in texels as they lie on
    /// the ground.
    pub gap_texels: f64,
}

impl Studio {
    /// What is wrong with a picture for the bias' sake, under a filter that reaches so many
    /// texels, and by pixel whether it is.
    pub fn bias_faults(
        &mut self,
        view: &View,
        shares: &[Option<f32>],
        reach: f64,
    ) -> (BiasFaults, Vec<bool>) {
        let maps = self.maps();
        let truth = &view.truth;
        let to_sun = self.sun_direction();
        let [mut lit, mut stained, mut dark, mut leaking] = [0_usize; 4];
        let mut gap = 0.0;
        let mut marks = vec![false; shares.len()];
        // Between pixels' centers, too, there may be shadows.
        let to_mixed = truth.to_mixed();
        for (pixel, share) in shares.iter().enumerate() {
            let sample = truth.samples[pixel].filter(|sample| sample.faces_sun);
            let (Some(sample), Some(share)) = (sample, share) else {
                continue;
            };
            let Some(texel) = texel_at(&maps, view, sample.point) else {
                continue;
            };
            let on_surface = texel / sample.normal.dot(to_sun).max(0.01);
            if sample.lit {
                let reach = (reach + 1.0) * core::f64::consts::SQRT_2 * on_surface;
                let reach = 2.0 + reach / truth.lens.pixel_size(sample.point);
                let is_far = to_mixed[pixel] > reach;
                if is_far && truth.to_boundary(pixel).is_none_or(|edge| edge > reach) {
                    lit += 1;
                    marks[pixel] = *share < 0.9;
                    stained += usize::from(marks[pixel]);
                }
                continue;
            }
            dark += 1;
            marks[pixel] = *share > 0.5;
            leaking += usize::from(marks[pixel]);
            // Behind the middle of the box.
            let behind = -0.75 - sample.point.x;
            let inside = sample.point.y.abs() < 1e-3 && sample.point.z.abs() < 0.3;
            if marks[pixel] && inside && behind > 0.0 && behind < 0.6 {
                gap = f64::max(gap, behind / on_surface);
            }
        }
        let percent = |part: usize, whole: usize| 100.0 * part as f64 / whole.max(1) as f64;
        let faults = BiasFaults {
            stain_pct: percent(stained, lit),
            leak_pct: percent(leaking, dark),
            gap_texels: gap,
        };
        (faults, marks)
    }

    /// Percent of the pixels near the terminator of smooth-shaded meshes, where the sun shines on the
    /// surface that is shaded, and no shadow is cast nearby, that get less than half of its light; and by
    /// pixel whether it does.
    pub fn terminator_faults(&mut self, view: &View, shares: &[Option<f32>]) -> (f64, Vec<bool>) {
        /// Farther from it, facets face the sun themselves (cosine of the angle to the sun).
        const NEAR: core::ops::Range<f64> = 0.005..0.35;
        /// Edges of shadows that are cast are this wide (pixels, either way).
        const EDGE: usize = 3;
        let to_sun = self.sun_direction();
        let tracer = Tracer::new(Geometry::gather(self.world()));
        let samples = view.truth.samples.iter();
        let lights = samples.map(|sample| sample.and_then(|it| tracer.smooth_light(&it, to_sun)));
        let lights: Vec<_> = lights.collect();
        let [width, height] = self.size.to_array().map(|side| side as usize);
        let is_cast_near = |pixel: usize| {
            let around = |at: usize, end: usize| at.saturating_sub(EDGE)..(at + EDGE + 1).min(end);
            let mut rows = around(pixel / width, height);
            rows.any(|y| {
                around(pixel % width, width)
                    .any(|x| lights[y * width + x].is_some_and(|(_, lit)| !lit))
            })
        };
        let (mut near, mut dark) = (0, 0);
        let marks = lights
            .iter()
            .zip(shares)
            .enumerate()
            .map(|(pixel, (light, share))| {
                let is_near = light.is_some_and(|(cosine, lit)| lit && NEAR.contains(&cosine));
                let is_near = is_near && !is_cast_near(pixel);
                let is_dark = is_near && share.is_some_and(|share| share < 0.5);
                near += usize::from(is_near);
                dark += usize::from(is_dark);
                is_dark
            });
        let marks = marks.collect();
        (100.0 * dark as f64 / near.max(1) as f64, marks)
    }

    /// The most that the automatic bias of a pixel should come to (texels), and the texels
    /// that it spans where they are fewest; `None` where two cascades are mixed, or the pixel and
    /// its neighbors are not of one triangle.
    pub fn expected_lookup(&mut self, view: &View, pixel: usize) -> Option<[f64; 2]> {
        let maps = self.maps();
        let truth = &view.truth;
        let sample = |pixel: usize| truth.samples.get(pixel).copied().flatten();
        let here = sample(pixel)?;
        let steps = [1, self.size.x as usize].map(|step| sample(pixel + step));
        let [right, below] = [steps[0]?, steps[1]?];
        if right.triangle != here.triangle || below.triangle != here.triangle {
            return None;
        }
        let depth = depth_of(view, here.point);
        let map = maps.iter().find(|map| depth < map.far)?;
        if depth > 0.8 * map.far {
            return None;
        }
        let derivatives = MapDerivatives::at(&map.clip_from_world, here.point)?;
        let to_sun = self.sun_direction();
        let bias = automatic(
            &map.clip_from_world,
            here.point,
            here.normal,
            to_sun,
            map.size,
        )?;
        let texel = derivatives.texel(map.size).max_element();
        let per_meter = derivatives.z.dot(to_sun).abs();
        let texels = [right, below].map(|neighbor| {
            let step = neighbor.point - here.point;
            0.5 * map.size * DVec2::new(derivatives.x.dot(step), derivatives.y.dot(step))
        });
        let jacobian = DMat2::from_cols(texels[0], texels[1]);
        let squares = jacobian.transpose() * jacobian;
        let (half_trace, determinant) = (
            0.5 * (squares.x_axis.x + squares.y_axis.y),
            squares.determinant(),
        );
        let fewest = half_trace - (half_trace * half_trace - determinant).max(0.0).sqrt();
        let most = bias.most() + bias.rounding;
        Some([most / per_meter / texel, fewest.max(0.0).sqrt()])
    }

    /// Width of the penumbra at the edge of [`Case::Slab`](super::cases::Case::Slab)'s shadow, mean over a range of view
    /// depths (meters along the ground, 10 to 90 % or so).
    pub fn penumbra(&mut self, view: &View, shares: &[Option<f32>], depths: [f64; 2]) -> f64 {
        let width = self.size.x as usize;
        let mut widths = Vec::new();
        for row in 0..self.size.y as usize {
            let mut sum = 0.0;
            let mut wanted = false;
            let row = row * width..(row + 1) * width;
            let samples = view.truth.samples[row.clone()].windows(2);
            for (pair, share) in samples.zip(&shares[row]) {
                let (Some(here), Some(next), Some(share)) = (pair[0], pair[1], *share) else {
                    continue;
                };
                let on_ground = here.point.y.abs() < 1e-3 && next.point.y.abs() < 1e-3;
                // Left of the shadow's middle.
                if !on_ground || here.point.x > 3.0 {
                    continue;
                }
                let depth = depth_of(view, here.point);
                wanted |= depth >= depths[0] && depth < depths[1];
                let share = f64::from(share);
                // A sixth of its width for an even ramp.
                sum += 6.0 * share * (1.0 - share) * (next.point.x - here.point.x);
            }
            if wanted {
                widths.push(sum);
            }
        }
        widths.iter().sum::<f64>() / widths.len().max(1) as f64
    }

    fn maps(&mut self) -> Vec<Map> {
        let (camera, sun, height) = (self.camera, self.sun, f64::from(self.size.y));
        maps_of(self.world(), camera, sun, 1.0, height)
    }
}

/// Size of a texel across the light at a point (meters); near a cascade's end the next one's,
/// which is mixed in there.
fn texel_at(maps: &[Map], view: &View, point: DVec3) -> Option<f64> {
    let depth = depth_of(view, point);
    let index = maps.iter().position(|map| depth < map.far)?;
    let next = maps
        .get(index + 1)
        .filter(|_| depth > 0.75 * maps[index].far);
    let texel = |map: &Map| {
        let derivatives = MapDerivatives::at(&map.clip_from_world, point)?;
        Some(derivatives.texel(map.size).max_element())
    };
    Some(texel(&maps[index])?.max(next.and_then(texel).unwrap_or(0.0)))
}

/// Meters from the eye, along the view.
fn depth_of(view: &View, point: DVec3) -> f64 {
    view.truth
        .lens
        .clip_from_world
        .row(3)
        .dot(point.extend(1.0))
}
