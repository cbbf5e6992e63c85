//! How fine a map in perspective may be: no finer than the GPU tells positions apart.
//!
//! The GPU multiplies points by the map's matrix in `f32`. Far from the origin the products almost cancel,
//! in the numerators as in `w`, and what is left is off as though the point had moved by
//! `ε · (|x| + |y| + |z|)` across the light, `ε` being [`f32::EPSILON`]. All maps share that law; but the
//! texels at a warp's nearest line, and those of a face that the light sees at a small angle, are many times
//! smaller than an even map's, and the same error is as many times more of them.

use super::{MIN_EXTENT, WarpFrame};
use crate::geometry::slice::BodyVertex;

/// What rounding may come to, as predicted (texels). What is found is up to a third more, and about a quarter.
const MOST_ROUNDING: f64 = 0.2;

impl WarpFrame {
    /// The least size of a texel (meters) of which rounding is no large part:
    /// `ε · (|x| + |y| + |z|) / 0.2` for an eye at `x`, `y`, `z`. At a kilometer from the origin, 0.6
    /// millimeters.
    pub fn least_texel(&self) -> f64 {
        let rounding = f64::from(f32::EPSILON) * self.eye.abs().element_sum();
        rounding / MOST_ROUNDING
    }

    /// The greatest strength (1/meters) at which no texel along the warp is smaller than that. Over `texels`
    /// of them, those at a body's nearest line are `length / (texels · (1 + strength · length))`.
    pub fn most_strength(&self, body: &[BodyVertex], texels: f64) -> f64 {
        let (near_line, far_line) = self.lines(body);
        let length = (far_line - near_line).max(MIN_EXTENT);
        let most_stretch = length / (texels * self.least_texel());
        ((most_stretch - 1.0) / length).max(0.0)
    }
}
