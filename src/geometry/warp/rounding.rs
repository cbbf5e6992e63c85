//! How fine a map in perspective may be: no finer than the GPU tells positions apart.
//!
//! The GPU multiplies points by the map's matrix in `f32`. Far from the origin the products almost cancel,
//! in the numerators as in `w`, and what is left is off as though the point had moved by
//! `ε · (|x| + |y| + |z|)` across the light, `ε` being [`f32::EPSILON`]. All maps share that law; but the
//! texels at a warp's nearest line, and those of a face that the light sees at a small angle, are many times
//! smaller than an even map's, and the same error is as many times more of them.
//!
//! A map's matrix is rounded as well, wherever it is: where depth changes much faster across the light than
//! along it, what is rounded of the one is more than all of the other.

use glam::DVec3;

use super::{MIN_EXTENT, WarpFrame};
use crate::geometry::slice::BodyVertex;

/// What rounding may come to, as predicted (texels). What is found is up to a third more, and about a quarter.
const MOST_ROUNDING: f64 = 0.2;

/// How many times as fast as along the light a map's depth may change across it: that takes 20 of `f32`'s 24
/// bits, and with the other four what is nearer to the light stays so.
pub(super) const MOST_SLOPE: f64 = (1 << 20) as f64;

impl WarpFrame {
    /// The least size of a texel (meters) of which rounding is no large part:
    /// `ε · (|x| + |y| + |z|) / 0.2` for an eye at `x`, `y`, `z`. At a kilometer from the origin, 0.6
    /// millimeters.
    pub fn least_texel(&self) -> f64 {
        let rounding = f64::from(f32::EPSILON) * self.eye.abs().element_sum();
        rounding / MOST_ROUNDING
    }

    /// The greatest strength (1/meters) at which no texel along the warp is smaller than that, and depth keeps
    /// its order in `f32`. Over `texels` of them, those at a body's nearest line are
    /// `length / (texels · (1 + strength · length))`; and over a body of some size depth changes up to
    /// `strength · size` times as fast along the warp as along the light.
    pub fn most_strength(&self, body: &[BodyVertex], texels: f64) -> f64 {
        let (near_line, far_line) = self.lines(body);
        let length = (far_line - near_line).max(MIN_EXTENT);
        let most_stretch = length / (texels * self.least_texel());
        let (lo, hi) = body
            .iter()
            .map(|vertex| self.local(vertex))
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), p| {
                (lo.min(p), hi.max(p))
            });
        let size = (hi - lo).max_element().max(MIN_EXTENT);
        ((most_stretch - 1.0) / length)
            .min(MOST_SLOPE / size)
            .max(0.0)
    }
}
