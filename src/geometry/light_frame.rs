//! The fixed frame of a directional light, in which maps are laid and snapped.

use glam::{DMat3, DVec3};

/// An orthonormal, right-handed frame that depends on the light's direction and an origin, and on
/// nothing else.
///
/// `z` points *to* the light. Were the frame to turn with the camera, texels would turn with it
/// and every shadow edge would crawl; tying it to the light alone is what makes snapping stable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightFrame {
    /// Direction of the map's `u` axis, in world space.
    pub x: DVec3,
    /// Direction of the map's `v` axis, in world space.
    pub y: DVec3,
    /// Unit vector from the scene to the light, in world space.
    pub z: DVec3,
    /// Where texel grids are anchored, in world space.
    pub origin: DVec3,
}

impl LightFrame {
    /// The frame of a light that lies in direction `to_light`; `None` if that has no direction
    /// (zero, infinite or not a number). Its origin is the world's.
    pub fn new(to_light: DVec3) -> Option<Self> {
        let z = to_light.try_normalize()?;
        let helper = if z.y.abs() > 0.999 {
            axis_of_smallest_component(z)
        } else {
            DVec3::Y
        };
        let x = helper.cross(z).normalize();
        Some(Self {
            x,
            y: z.cross(x),
            z,
            origin: DVec3::ZERO,
        })
    }

    /// The same with another origin, in world space.
    pub fn at(self, origin: DVec3) -> Self {
        Self { origin, ..self }
    }

    /// Coordinates of a world-space point in the light's frame (meters).
    pub fn light_from_world(&self, point: DVec3) -> DVec3 {
        let point = point - self.origin;
        DVec3::new(self.x.dot(point), self.y.dot(point), self.z.dot(point))
    }

    /// The rotation that takes light-space vectors to world space.
    pub fn world_from_light(&self) -> DMat3 {
        DMat3::from_cols(self.x, self.y, self.z)
    }
}

fn axis_of_smallest_component(v: DVec3) -> DVec3 {
    let a = v.abs();
    if a.x <= a.y && a.x <= a.z {
        DVec3::X
    } else if a.z <= a.y {
        DVec3::Z
    } else {
        DVec3::Y
    }
}
