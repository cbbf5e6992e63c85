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
    /// Of a sphere that holds it, sheared or not (meters).
    pub fn radius(&self) -> f64 {
        let DMat3 {
            x_axis,
            y_axis,
            z_axis,
        } = self.half_axes;
        let squares = x_axis.length_squared() + y_axis.length_squared() + z_axis.length_squared();
        let shear = x_axis.dot(y_axis).abs() + y_axis.dot(z_axis).abs() + z_axis.dot(x_axis).abs();
        (squares + 2.0 * shear).sqrt()
    }

    /// How far it reaches from its center along a direction in world space, per length of that.
    pub fn reach(&self, direction: DVec3) -> f64 {
        (self.half_axes.transpose() * direction).abs().element_sum()
    }
}
