//! How wrong a picture's shadows are.

use bevy::prelude::*;
use distance_transform::{BoolGrid, dt2d};

use super::trace::{Lens, Sample};

/// Farther from any edge of a true shadow than this (pixels), even a gray is wrong.
const EDGE_REACH: f64 = 2.0;
/// … if it is off by more than this share of the sun's light.
const STAIN: f32 = 0.1;

/// A view's true shadows, and what figures need to know of them.
pub struct Truth {
    /// The picture's geometry.
    pub lens: Lens,
    /// By pixel, what its center shows.
    pub samples: Vec<Option<Sample>>,
    /// By pixel, the share of the sun's light that arrives over its whole area.
    pub shares: Vec<Option<f32>>,
    /// By pixel, the distance to the nearest boundary of light (pixels).
    to_boundary: Vec<f64>,
}

/// What is wrong with a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// Nothing that counts.
    None,
    /// Shadowed that should be lit.
    Acne,
    /// Lit that should be shadowed.
    Leak,
    /// Neither, but off by more than a tenth of the light, away from the edges of shadows.
    Stain,
}

/// Sums over pictures. A pixel counts if its center faces the sun and the sun's light shows.
#[derive(Default, Clone)]
pub struct Accuracy {
    facing: usize,
    acne: usize,
    leak: usize,
    stain: usize,
    error: f64,
    /// Distances between true and found edges (pixels).
    edges: Vec<f32>,
}

/// The figures (percent of the pixels that count; pixels).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// Lit for shadowed or the other way round: off by more than half the light.
    pub wrong_pct: f64,
    /// Of these, shadowed that should be lit.
    pub acne_pct: f64,
    /// Of these, lit that should be shadowed.
    pub leak_pct: f64,
    /// Off by more than a tenth of the light, away from the edges of shadows.
    pub stain_pct: f64,
    /// Mean error against the share of the pixel that is lit.
    pub mae_pct: f64,
    /// 95th percentile of how far true and found edges lie apart (pixels).
    pub edge_px_p95: f64,
}

impl Truth {
    /// Works out what follows from the rays of one view.
    pub fn new(lens: Lens, samples: Vec<Option<Sample>>, shares: Vec<Option<f32>>) -> Self {
        let lit = |i: usize| samples[i].map(|sample| sample.lit);
        let boundary = pairs_of(lens.size)
            .filter(|[a, b]| matches!((lit(*a), lit(*b)), (Some(a), Some(b)) if a != b))
            .collect::<Vec<_>>();
        let to_boundary = distances(lens.size, boundary.into_iter().flatten());
        Self {
            lens,
            samples,
            shares,
            to_boundary,
        }
    }

    /// Pixels.
    pub fn size(&self) -> UVec2 {
        self.lens.size
    }

    /// Distance to the nearest boundary of light (pixels); `None` without any.
    pub fn to_boundary(&self, pixel: usize) -> Option<f64> {
        let diagonal = self.lens.size.as_dvec2().length();
        Some(self.to_boundary[pixel]).filter(|distance| *distance < diagonal)
    }

    /// By pixel, the distance to the nearest one that is lit and shadowed both, as rays across it say
    /// (pixels).
    pub fn to_mixed(&self) -> Vec<f64> {
        let is_mixed = |i: &usize| self.shares[*i].is_some_and(|share| share > 0.0 && share < 1.0);
        distances(self.lens.size, (0..self.shares.len()).filter(is_mixed))
    }

    /// What is wrong with a pixel that gets a share of the sun's light; `None` if its center
    /// does not face the sun.
    pub fn fault(&self, pixel: usize, found: f32) -> Option<Fault> {
        let off = found - self.light(pixel)?;
        Some(if off < -0.5 {
            Fault::Acne
        } else if off > 0.5 {
            Fault::Leak
        } else if self.is_stained(pixel, found) {
            Fault::Stain
        } else {
            Fault::None
        })
    }

    /// How many pixels of a picture have a fault.
    pub fn faults(&self, shares: &[Option<f32>]) -> usize {
        let shares = shares.iter().enumerate();
        let faults = shares.filter_map(|(i, share)| self.fault(i, (*share)?));
        faults.filter(|fault| *fault != Fault::None).count()
    }

    fn light(&self, pixel: usize) -> Option<f32> {
        let sample = self.samples[pixel].filter(|sample| sample.faces_sun)?;
        Some(f32::from(u8::from(sample.lit)))
    }

    fn is_stained(&self, pixel: usize, found: f32) -> bool {
        let off = |light: f32| (found - light).abs() > STAIN;
        self.to_boundary[pixel] > EDGE_REACH && self.light(pixel).is_some_and(off)
    }

    /// Pixels on both sides of the edges of shadows: neighbors on one surface, both of which
    /// count, of which one is lit.
    fn edges(&self, found: &[Option<f32>], lit: impl Fn(usize) -> bool) -> Vec<usize> {
        let counts = |i: usize| {
            let sample = self.samples[i].filter(|sample| sample.faces_sun);
            sample.filter(|_| found[i].is_some())
        };
        pairs_of(self.lens.size)
            .filter(|[a, b]| {
                let (Some(first), Some(second)) = (counts(*a), counts(*b)) else {
                    return false;
                };
                lit(*a) != lit(*b) && self.lens.same_surface(&first, &second)
            })
            .flatten()
            .collect()
    }
}

impl Accuracy {
    /// Adds a picture: `found` is the share of the sun's light by pixel.
    pub fn add(&mut self, truth: &Truth, found: &[Option<f32>]) {
        for (i, found) in found.iter().enumerate() {
            let Some((found, fault)) =
                found.and_then(|found| Some((found, truth.fault(i, found)?)))
            else {
                continue;
            };
            self.facing += 1;
            self.acne += usize::from(fault == Fault::Acne);
            self.leak += usize::from(fault == Fault::Leak);
            self.stain += usize::from(truth.is_stained(i, found));
            self.error += f64::from((found - truth.shares[i].unwrap_or(found)).abs());
        }
        let is_lit = |i: usize| truth.samples[i].is_some_and(|sample| sample.lit);
        let seems_lit = |i: usize| found[i].is_some_and(|share| share > 0.5);
        let (true_edges, found_edges) = (truth.edges(found, is_lit), truth.edges(found, seems_lit));
        let size = truth.lens.size;
        for (from, to) in [(&true_edges, &found_edges), (&found_edges, &true_edges)] {
            let distances = distances(size, to.iter().copied());
            self.edges.extend(from.iter().map(|i| distances[*i] as f32));
        }
    }

    /// The figures so far.
    pub fn figures(&self) -> Figures {
        let percent = |sum: f64| 100.0 * sum / self.facing.max(1) as f64;
        let mut edges = self.edges.clone();
        edges.sort_by(f32::total_cmp);
        let p95 = edges.get((edges.len() * 95 / 100).min(edges.len().saturating_sub(1)));
        Figures {
            wrong_pct: percent((self.acne + self.leak) as f64),
            acne_pct: percent(self.acne as f64),
            leak_pct: percent(self.leak as f64),
            stain_pct: percent(self.stain as f64),
            mae_pct: percent(self.error),
            edge_px_p95: p95.copied().unwrap_or(0.0).into(),
        }
    }
}

/// All pairs of neighboring pixels, by index.
fn pairs_of(size: UVec2) -> impl Iterator<Item = [usize; 2]> {
    let [width, height] = size.to_array().map(|side| side as usize);
    (0..width * height).flat_map(move |i| {
        let right = (i % width + 1 < width).then_some([i, i + 1]);
        let below = (i + width < width * height).then_some([i, i + width]);
        right.into_iter().chain(below)
    })
}

/// By pixel, the distance to the nearest of some pixels, at most the picture's diagonal.
fn distances(size: UVec2, to: impl Iterator<Item = usize>) -> Vec<f64> {
    let (width, diagonal) = (size.x as usize, size.as_dvec2().length());
    let mut grid = BoolGrid::new(width, size.y as usize);
    for i in to {
        grid.set(i % width, i / width, true);
    }
    let squares = dt2d(&grid).to_vec();
    squares
        .into_iter()
        .map(|square| square.sqrt().min(diagonal))
        .collect()
}
