//! What receives shadows before a camera, as boxes: where cascades are worth anything.

use glam::{DMat3, DVec3};

use super::slice::ViewVolume;

/// The boxes of everything that a camera sees and that receives shadows.
#[derive(Debug, Clone, PartialEq)]
pub struct Receivers {
    eye: DVec3,
    /// A point's depth is its product with this, from the eye.
    per_depth: DVec3,
    boxes: Vec<ReceiverBox>,
    everywhere: bool,
    fog: bool,
}

/// A box along the world's axes, and the depths between which it lies.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ReceiverBox {
    lo: DVec3,
    hi: DVec3,
    near: f64,
    far: f64,
}

/// A box along the world's axes, as lower and upper corner.
pub type Bounds = [DVec3; 2];

/// Holds nothing.
const NOWHERE: Bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];

impl Receivers {
    /// None yet.
    pub fn new(view: &ViewVolume) -> Self {
        Self {
            eye: view.eye,
            per_depth: view.per_depth(),
            boxes: Vec::new(),
            everywhere: false,
            fog: false,
        }
    }

    /// Something that receives shadows wherever the camera looks.
    pub fn everywhere(view: &ViewVolume) -> Self {
        Self {
            everywhere: true,
            ..Self::new(view)
        }
    }

    /// Fog, which receives shadows in the air.
    pub fn fog(view: &ViewVolume) -> Self {
        Self {
            fog: true,
            ..Self::everywhere(view)
        }
    }

    /// Adds something without bounds.
    pub fn add_everywhere(&mut self) {
        self.everywhere = true;
    }

    /// Adds what lies in an oriented box, given by its half-extents as three vectors in world
    /// space. Not if the box is not finite: then nothing is seen of it.
    pub fn add(&mut self, centre: DVec3, half_axes: &DMat3) {
        let half = half_axes.x_axis.abs() + half_axes.y_axis.abs() + half_axes.z_axis.abs();
        let depth = self.per_depth.dot(centre - self.eye);
        let reach = (half_axes.transpose() * self.per_depth).abs().element_sum();
        if (centre.abs() + half).is_finite() {
            self.boxes.push(ReceiverBox {
                lo: centre - half,
                hi: centre + half,
                near: depth - reach,
                far: depth + reach,
            });
        }
    }

    /// Whether they have no bounds.
    pub fn are_everywhere(&self) -> bool {
        self.everywhere
    }

    /// Whether fog is among them.
    pub fn has_fog(&self) -> bool {
        self.fog
    }

    /// Depths between which they lie, those behind the eye included (metres). In no order if
    /// there are none.
    pub fn depths(&self) -> [f64; 2] {
        if self.everywhere {
            return [f64::NEG_INFINITY, f64::INFINITY];
        }
        let start = [f64::INFINITY, f64::NEG_INFINITY];
        self.boxes.iter().fold(start, |[near, far], it| {
            [near.min(it.near), far.max(it.far)]
        })
    }

    /// For each interval of depth the box around all that reaches into it, in one pass. Corners in
    /// no order where there is nothing; infinite where they have no bounds.
    pub fn bounds_between(&self, intervals: &[(f64, f64)]) -> Vec<Bounds> {
        if self.everywhere {
            return vec![[DVec3::NEG_INFINITY, DVec3::INFINITY]; intervals.len()];
        }
        let mut found = vec![NOWHERE; intervals.len()];
        for it in &self.boxes {
            for ([lo, hi], (near, far)) in found.iter_mut().zip(intervals) {
                if it.near <= *far && it.far >= *near {
                    *lo = lo.min(it.lo);
                    *hi = hi.max(it.hi);
                }
            }
        }
        found
    }
}
