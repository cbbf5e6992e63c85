//! The tests of [`hull`](super::hull) in `f32`, for very many spheres: grown by whatever rounding might do.

use glam::{Affine3A, Mat4, Vec3A, Vec4};

use super::hull::{CasterHull, Sweep};

/// What a few roundings to `f32` come to at most, as a share.
const ROUNDING: f32 = 1e-6;

/// A [`Sweep`] in `f32`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CoarseSweep {
    center: Vec3A,
    radius: f32,
    to_light: Vec3A,
    rounding: f32,
}

impl CoarseSweep {
    /// The same in `f32`.
    pub fn new(sweep: &Sweep) -> Self {
        let center = sweep.center.as_vec3a();
        Self {
            center,
            radius: sweep.radius as f32 * (1.0 + ROUNDING),
            to_light: sweep.to_light.as_vec3a(),
            rounding: ROUNDING * center.abs().max_element(),
        }
    }

    /// Whether a sphere is certainly far from the sweep ([`Sweep::is_far`]). Not if any is no number.
    #[inline]
    pub fn is_far(&self, sphere: &CoarseSphere) -> bool {
        let offset = sphere.center - self.center;
        let along = offset.dot(self.to_light).max(0.0);
        let reach = self.radius + sphere.radius + self.rounding + sphere.rounding();
        offset.length_squared() * (1.0 - 4.0 * ROUNDING) - along * along > reach * reach
    }

    /// As [`Self::is_far`], for each of four spheres: a bit for each.
    #[inline]
    pub fn are_far(&self, spheres: &FourSpheres) -> u32 {
        let [x, y, z] = [
            spheres.x - self.center.x,
            spheres.y - self.center.y,
            spheres.z - self.center.z,
        ];
        let along = x * self.to_light.x + y * self.to_light.y + z * self.to_light.z;
        // What is no number stays none.
        let along = Vec4::select(along.cmplt(Vec4::ZERO), Vec4::ZERO, along);
        let reach = spheres.radius * (1.0 + ROUNDING) + (self.radius + self.rounding);
        let distance_2 = x * x + y * y + z * z;
        let beside_2 = distance_2 * (1.0 - 4.0 * ROUNDING) - along * along;
        beside_2.cmpgt(reach * reach).bitmask()
    }
}

/// The planes of a [`CasterHull`] in `f32`, four together.
#[derive(Debug, Clone, PartialEq)]
pub struct CoarseHull {
    planes: Vec<FourPlanes>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct FourPlanes {
    normal: [Vec4; 3],
    distance: Vec4,
}

impl CoarseHull {
    /// The same in `f32`.
    pub fn new(hull: &CasterHull) -> Self {
        let planes = hull.planes.chunks(4).map(|planes| {
            // One plane's stand for those that are missing.
            let [a, b, c, d] = [0, 1, 2, 3].map(|index| planes.get(index).unwrap_or(&planes[0]));
            let distance = [a, b, c, d].map(|plane| plane.distance as f32);
            let distance = Vec4::from_array(distance);
            FourPlanes {
                normal: lanes([a, b, c, d].map(|plane| plane.normal.as_vec3a())),
                distance: distance + ROUNDING * distance.abs(),
            }
        });
        Self {
            planes: planes.collect(),
        }
    }

    /// Whether a sphere is certainly outside of one of the planes. Not if any is no number.
    #[inline]
    pub fn is_outside(&self, sphere: &CoarseSphere) -> bool {
        let CoarseSphere { center, radius, .. } = *sphere;
        let reach = radius * (1.0 + ROUNDING) + 4.0 * sphere.rounding();
        self.planes.iter().any(|planes| {
            let [x, y, z] = planes.normal;
            let along = x * center.x + y * center.y + z * center.z;
            (along - reach).cmpgt(planes.distance).any()
        })
    }
}

/// A sphere around a box, in `f32`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CoarseSphere {
    /// Its center in world space (meters).
    pub center: Vec3A,
    /// Its radius (meters).
    pub radius: f32,
    /// The greatest of the numbers whose sum the center is (meters).
    pub magnitude: f32,
}

impl CoarseSphere {
    /// Around a box given by its center and half its extents, as it stands in the world.
    #[inline]
    pub fn new(world_from_local: &Affine3A, center: Vec3A, half: Vec3A) -> Self {
        let axes = &world_from_local.matrix3;
        let size = axes.abs();
        let magnitude = size * center.abs() + world_from_local.translation.abs();
        Self {
            center: axes * center + world_from_local.translation,
            // Of the box along the world's axes.
            radius: (size * half).length(),
            magnitude: magnitude.max_element(),
        }
    }

    /// The same with another radius, as a multiple of its own.
    #[inline]
    pub fn scaled(self, by: f32) -> Self {
        Self {
            radius: by * self.radius,
            ..self
        }
    }

    fn rounding(&self) -> f32 {
        ROUNDING * self.magnitude
    }
}

/// Four spheres around boxes, about the origins of their meshes: larger than need be, and sooner worked out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FourSpheres {
    x: Vec4,
    y: Vec4,
    z: Vec4,
    radius: Vec4,
}

impl FourSpheres {
    /// As [`CoarseSphere::new`], for four boxes.
    #[inline]
    pub fn new(world_from_local: [&Affine3A; 4], centers: [Vec3A; 4], halves: [Vec3A; 4]) -> Self {
        let [a, b, c, d] = world_from_local;
        let [x, y, z] = lanes([a.translation, b.translation, c.translation, d.translation]);
        let stretch_2 = |affine: &Affine3A| {
            let axes = &affine.matrix3;
            axes.x_axis * axes.x_axis + axes.y_axis * axes.y_axis + axes.z_axis * axes.z_axis
        };
        // No vector is made longer by a matrix than by the root of the sum of its squares.
        let stretch = root_of_sum([stretch_2(a), stretch_2(b), stretch_2(c), stretch_2(d)]);
        let lengths = |[a, b, c, d]: [Vec3A; 4]| root_of_sum([a * a, b * b, c * c, d * d]);
        Self {
            x,
            y,
            z,
            radius: stretch * (lengths(centers) + lengths(halves)),
        }
    }

    /// The same with other radii, as multiples of theirs.
    #[inline]
    pub fn scaled(self, by: f32) -> Self {
        Self {
            radius: by * self.radius,
            ..self
        }
    }
}

/// The roots of the sums of four vectors' coordinates.
#[inline]
fn root_of_sum(vectors: [Vec3A; 4]) -> Vec4 {
    let [x, y, z] = lanes(vectors);
    (x + y + z).sqrt()
}

/// Four vectors' coordinates, each of all.
#[inline]
fn lanes([a, b, c, d]: [Vec3A; 4]) -> [Vec4; 3] {
    let rows = Mat4::from_cols(a.extend(0.0), b.extend(0.0), c.extend(0.0), d.extend(0.0));
    let lanes = rows.transpose();
    [lanes.x_axis, lanes.y_axis, lanes.z_axis]
}
