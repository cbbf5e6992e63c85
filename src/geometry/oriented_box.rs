//! A box at any angle: bounds of a mesh in the world.

use glam::{DMat3, DVec3};

/// A box, or with a shear a parallelepiped, in world space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrientedBox {
    /// Its center (meters).
    pub center: DVec3,
    /// Half its extents, as three vectors (meters).
    pub half_axes: DMat3,
}

impl OrientedBox {
    /// How far it reaches from its center along a direction in world space, per length of that.
    pub fn reach(&self, direction: DVec3) -> f64 {
        (self.half_axes.transpose() * direction).abs().element_sum()
    }
}
