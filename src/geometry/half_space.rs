//! Everything on one side of a plane.

use glam::DVec3;

/// A half-space `normal · p <= distance` with an outward unit normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfSpace {
    /// Outward unit normal, in world space.
    pub normal: DVec3,
    /// Signed distance of the plane from the world's origin along the normal (meters).
    pub distance: f64,
}
