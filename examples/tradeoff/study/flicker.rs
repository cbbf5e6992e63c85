//! Shadows that change where nothing does.
//!
//! Points are followed, not pixels: an edge that is wrong but rests on its surface does not
//! flicker. A point at a pixel's centre counts as changed if its answer, lit or not, is shared
//! by a block of two by two pixels before, and by none of the four pixels around it after: on a
//! resting shadow at least one of those four falls into the block.

use bevy::{
    math::DVec3,
    prelude::*,
    tasks::{ComputeTaskPool, ParallelSlice},
};

use super::{
    studio::{Reference, Stance},
    trace::{Lens, Sample},
};

/// Small motions, each in steps from where the camera and the sun stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// To the right, by 0.3 pixels at a distance of 10 m.
    Pan,
    /// To the left about the vertical, by 0.3 pixels.
    Turn,
    /// Into the picture, its edges by 0.3 pixels.
    Zoom,
    /// The sun about the vertical, by 0.005°: a day of an hour at 20 frames a second.
    Sun,
}

/// Pixels that the camera's motions move the picture by.
const STEP: f32 = 0.3;
/// Distance at which a pan moves the picture by that (metres).
const PAN_DISTANCE: f32 = 10.0;
/// The sun's turn per step (degrees).
const SUN_STEP: f32 = 0.005;

impl Motion {
    /// All.
    pub const ALL: [Self; 4] = [Self::Pan, Self::Turn, Self::Zoom, Self::Sun];

    /// The stance after some steps, for a picture `height` pixels high.
    pub fn step(self, from: &Stance, steps: usize, height: f32) -> Stance {
        let mut to = from.clone();
        let share = STEP * steps as f32 / (0.5 * height);
        let tangent = match &from.projection {
            Projection::Perspective(lens) => (0.5 * lens.fov).tan(),
            _ => 1.0,
        };
        match self {
            Self::Pan => {
                to.camera.translation += from.camera.right() * (share * tangent * PAN_DISTANCE);
            }
            Self::Turn => to.camera.rotate_y((share * tangent).atan()),
            Self::Zoom => {
                if let Projection::Perspective(lens) = &mut to.projection {
                    lens.fov = 2.0 * (tangent * (1.0 - share)).atan();
                }
            }
            Self::Sun => to.sun.rotate_y((SUN_STEP * steps as f32).to_radians()),
        }
        to
    }
}

/// A frame of a path: how to take it, and what is seen.
pub struct Still {
    /// Where camera and sun stand.
    pub stance: Stance,
    /// The picture's geometry.
    pub lens: Lens,
    /// By pixel.
    pub samples: Vec<Option<Sample>>,
    /// The picture with and without the sun.
    pub reference: Reference,
    /// By pixel of the path's first frame, whether the truth at its sample is still the same.
    pub steady: Vec<bool>,
}

impl Still {
    /// With light shares, by pixel.
    pub fn seen<'a>(&'a self, shares: &'a [Option<f32>]) -> Seen<'a> {
        Seen {
            lens: &self.lens,
            samples: &self.samples,
            shares,
        }
    }
}

/// How followed points fared.
#[derive(Default, Debug, Clone, Copy, PartialEq, Eq)]
pub struct Flips {
    /// Points that could be followed from a frame to the next.
    pub followed: usize,
    /// Of these, those whose answer changed though the truth did not.
    pub flipped: usize,
}

impl Flips {
    /// Percent of the points followed.
    pub fn percent(self) -> f64 {
        100.0 * self.flipped as f64 / self.followed.max(1) as f64
    }
}

impl core::ops::AddAssign for Flips {
    fn add_assign(&mut self, other: Self) {
        self.followed += other.followed;
        self.flipped += other.flipped;
    }
}

/// One frame's picture, as light shares over what is seen.
#[derive(Clone, Copy)]
pub struct Seen<'a> {
    /// The picture's geometry.
    pub lens: &'a Lens,
    /// By pixel.
    pub samples: &'a [Option<Sample>],
    /// By pixel, the share of the sun's light.
    pub shares: &'a [Option<f32>],
}

impl Seen<'_> {
    /// Whether a pixel is lit, if it shows the surface of `sample` and that faces the sun.
    fn answer(&self, sample: &Sample, x: i64, y: i64) -> Option<bool> {
        let size = self.lens.size.as_i64vec2();
        if x < 0 || y < 0 || x >= size.x || y >= size.y {
            return None;
        }
        let i = (y * size.x + x) as usize;
        let seen = self.samples[i].filter(|seen| seen.faces_sun)?;
        let share = self.shares[i]?;
        self.lens.same_surface(sample, &seen).then_some(share > 0.5)
    }

    /// The answers of a block of two by two pixels, if they are all there.
    fn block(&self, sample: &Sample, x: i64, y: i64) -> Option<[bool; 4]> {
        Some([
            self.answer(sample, x, y)?,
            self.answer(sample, x + 1, y)?,
            self.answer(sample, x, y + 1)?,
            self.answer(sample, x + 1, y + 1)?,
        ])
    }
}

/// Follows the points of one frame into the next. `steady` tells, by pixel, whether the truth is
/// the same in both.
pub fn follow(before: Seen, after: Seen, steady: &[bool]) -> Flips {
    let width = before.lens.size.x as usize;
    let follow_row = |(y, row): (usize, &[Option<Sample>])| {
        let mut flips = Flips::default();
        for (x, sample) in row.iter().enumerate() {
            let Some(sample) = sample.filter(|s| s.faces_sun && steady[y * width + x]) else {
                continue;
            };
            let (x, y) = (x as i64, y as i64);
            let Some(lit) = before.answer(&sample, x, y) else {
                continue;
            };
            let corners = [(x, y), (x - 1, y), (x, y - 1), (x - 1, y - 1)];
            let shared = corners
                .iter()
                .any(|(x, y)| before.block(&sample, *x, *y) == Some([lit; 4]));
            let around = after.lens.pixel(sample.point).and_then(|at| {
                let corner = (at - 0.5).floor().as_i64vec2();
                after.block(&sample, corner.x, corner.y)
            });
            if let (true, Some(around)) = (shared, around) {
                flips.followed += 1;
                flips.flipped += usize::from(around == [!lit; 4]);
            }
        }
        flips
    };
    let rows: Vec<(usize, &[Option<Sample>])> = before.samples.chunks(width).enumerate().collect();
    let mut total = Flips::default();
    let parts = rows.par_chunk_map(ComputeTaskPool::get(), 16, |_, rows| {
        let mut sum = Flips::default();
        for row in rows {
            sum += follow_row(*row);
        }
        sum
    });
    for part in parts {
        total += part;
    }
    total
}

/// Whether a point's truth is the same under the light of the next frame.
pub fn steady(
    tracer: &super::trace::Tracer,
    samples: &[Option<Sample>],
    to_sun: DVec3,
) -> Vec<bool> {
    let chunks = samples.par_chunk_map(ComputeTaskPool::get(), 1024, |_, chunk| {
        let same = |sample: &Sample| {
            sample.normal.dot(to_sun) > 0.0 && tracer.is_lit(sample, to_sun) == sample.lit
        };
        chunk
            .iter()
            .map(|sample| sample.as_ref().is_some_and(|s| s.faces_sun && same(s)))
            .collect::<Vec<bool>>()
    });
    chunks.into_iter().flatten().collect()
}
