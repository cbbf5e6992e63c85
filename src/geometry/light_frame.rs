//! The fixed frame of a directional light, in which maps are laid and snapped.

use glam::{DMat3, DQuat, DVec2, DVec3};

/// When a light on the horizon turns, its frame turns up to so many times as far about it to become level
/// again, on top of what the turn itself takes; a higher one's less, by the squared cosine of its elevation.
pub const LEVELING: f64 = 3.0;

/// A right-handed frame that depends on the light's direction, and how it has turned, and an origin, and on
/// nothing else.
///
/// `z` points *to* the light. Were the frame to turn with the camera, texels would turn with it
/// and every shadow edge would crawl; tying it to the light alone is what makes snapping stable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightFrame {
    /// What is measured along the map's `u` axis, in world space: a unit vector across the light, or, in a
    /// frame that stands on the ground, longer.
    pub x: DVec3,
    /// As `x`, of the map's `v` axis.
    pub y: DVec3,
    /// Unit vector from the scene to the light, in world space.
    pub z: DVec3,
    /// Where texel grids are anchored, in world space.
    pub origin: DVec3,
    /// It stands on the ground: `x` and `y` are not at right angles.
    pub is_grounded: bool,
}

impl LightFrame {
    /// The frame of a light that lies in direction `to_light`, in world space; `None` if that has
    /// no direction (zero, infinite or not a number). Its origin is the world's.
    pub fn new(to_light: DVec3) -> Option<Self> {
        let z = to_light.try_normalize()?;
        let helper = if z.y.abs() > 0.999 {
            axis_of_smallest_component(z)
        } else {
            DVec3::Y
        };
        Some(Self::upright(helper.cross(z).normalize(), z))
    }

    fn upright(x: DVec3, z: DVec3) -> Self {
        Self {
            x,
            y: z.cross(x),
            z,
            origin: DVec3::ZERO,
            is_grounded: false,
        }
    }

    /// The frame of the light after a turn: it turns as far as the light does, and up to [`LEVELING`] times
    /// that about it, towards having `x` level. That, it has below 50° of elevation, where maps that are laid
    /// along the ground are sharper; higher up, what turns about the light would only swim. No path of the
    /// light makes it jump, one over the zenith neither. `to_light` and `None` as for
    /// [`LightFrame::new`].
    pub fn following(&self, to_light: DVec3) -> Option<Self> {
        let z = to_light.try_normalize()?;
        if z == self.z {
            return Some(*self);
        }
        let carried = DQuat::from_rotation_arc(self.z, z) * self.x;
        let carried = carried.reject_from_normalized(z).try_normalize()?;
        let x = match DVec3::Y.cross(z).try_normalize() {
            None => carried,
            Some(level) => {
                // A frame that lies on its head is level too.
                let level = level * level.dot(carried).signum();
                let off = angle_about(z, carried, level);
                let most = LEVELING * (1.0 - z.y * z.y) * angle_between(self.z, z);
                if off.abs() <= most {
                    level
                } else {
                    DQuat::from_axis_angle(z, most.copysign(off)) * carried
                }
            }
        };
        Some(Self::upright(x, z).at(self.origin))
    }

    /// A frame in which a texel covers the same ground wherever the light stands: `x` and `y` measure, along
    /// the world's X and against its Z, where light through a point meets the level of the origin. Maps are
    /// sheared. `to_light` is in world space; `None` if it has no direction, or stands lower than
    /// said (sine of its elevation).
    pub fn grounded(to_light: DVec3, lowest_sine: f64) -> Option<Self> {
        let z = to_light.try_normalize()?;
        (z.y.abs() >= lowest_sine).then(|| Self {
            x: DVec3::new(1.0, -z.x / z.y, 0.0),
            // Of a light from below, the other way around: seen from it, the frame is right-handed.
            y: DVec3::new(0.0, z.z / z.y, -1.0) * z.y.signum(),
            z,
            origin: DVec3::ZERO,
            is_grounded: true,
        })
    }

    /// The same with another origin, in world space.
    pub fn at(self, origin: DVec3) -> Self {
        Self { origin, ..self }
    }

    /// Coordinates of a world-space point in the light's frame (meters).
    pub fn light_from_world(&self, point_ws: DVec3) -> DVec3 {
        self.measured(point_ws - self.origin)
    }

    /// A world-space vector in the light's frame (meters).
    pub fn measured(&self, v_ws: DVec3) -> DVec3 {
        DVec3::new(self.x.dot(v_ws), self.y.dot(v_ws), self.z.dot(v_ws))
    }

    /// What takes light-space vectors to world space.
    pub fn world_from_light(&self) -> DMat3 {
        if !self.is_grounded {
            return DMat3::from_cols(self.x, self.y, self.z);
        }
        let per_area = self.x.dot(self.y.cross(self.z)).recip();
        let across = [self.y.cross(self.z), self.z.cross(self.x)];
        DMat3::from_cols(per_area * across[0], per_area * across[1], self.z)
    }

    /// Unit vectors across the light, in world space, along which the map's rows and columns lie.
    pub fn axes(&self) -> [DVec3; 2] {
        if !self.is_grounded {
            return [self.x, self.y];
        }
        let world_from_light = self.world_from_light();
        [world_from_light.x_axis, world_from_light.y_axis].map(DVec3::normalize)
    }

    /// What a meter across the light measures at most, along both axes.
    pub fn spread(&self) -> DVec2 {
        if !self.is_grounded {
            return DVec2::ONE;
        }
        DVec2::new(self.x.length(), self.y.length())
    }
}

/// Between unit vectors in one space (radians); exact where it is small.
pub fn angle_between(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}

/// From one unit vector to another, both at right angles to a third, about that one (radians).
fn angle_about(axis: DVec3, from: DVec3, to: DVec3) -> f64 {
    axis.dot(from.cross(to)).atan2(from.dot(to))
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
