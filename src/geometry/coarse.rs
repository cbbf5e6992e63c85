//! The tests of [`hull`](super::hull) in `f32`, for very many casters, four at a time: grown by whatever rounding might do.

use glam::{Affine3A, Mat4, Vec3A, Vec4};

use super::{
    half_space::HalfSpace,
    hull::{CasterHull, Sweep},
};

/// What a few roundings to `f32` come to at most, as a share.
const ROUNDING: f32 = 1e-6;

/// Four spheres around boxes as they stand in the world: larger than need be, and soon worked out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FourSpheres {
    x: Vec4,
    y: Vec4,
    z: Vec4,
    radius: Vec4,
}

impl FourSpheres {
    /// Around boxes given by their centers and half their extents.
    #[inline]
    pub fn new(
        world_from_local: [&Affine3A; 4],
        centers: [Vec3A; 4],
        half_extents: [Vec3A; 4],
    ) -> Self {
        const LANES: [usize; 4] = [0, 1, 2, 3];
        let [x, y, z] =
            lanes(LANES.map(|lane| world_from_local[lane].transform_point3a(centers[lane])));
        let stretch_2 = sum(world_from_local.map(|affine| {
            let axes = &affine.matrix3;
            axes.x_axis * axes.x_axis + axes.y_axis * axes.y_axis + axes.z_axis * axes.z_axis
        }));
        // A center that is far from its mesh's origin is off by a share δ of three roundings: with ε for `ROUNDING`,
        // (half + δ center)² is at most (1 + ε) half² + (1 + 1/ε) δ² center².
        const APART: f32 = 1e-7;
        let half_2 = sum(LANES.map(|lane| {
            let (center, half) = (centers[lane], half_extents[lane]);
            half * half + APART * (center * center)
        }));
        Self {
            x,
            y,
            z,
            // No vector is made longer by a matrix than by the root of the sum of its squares.
            radius: (stretch_2 * half_2).sqrt() * (1.0 + ROUNDING),
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

/// A [`Sweep`] in `f32`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CoarseSweep {
    center: Vec3A,
    radius: f32,
    to_light: Vec3A,
}

impl CoarseSweep {
    /// The same in `f32`.
    pub fn new(sweep: &Sweep) -> Self {
        let center = sweep.center.as_vec3a();
        Self {
            center,
            radius: sweep.radius as f32 * (1.0 + ROUNDING) + ROUNDING * center.abs().max_element(),
            to_light: sweep.to_light.as_vec3a(),
        }
    }

    /// Which of four spheres are certainly far from the sweep ([`Sweep::is_far`]), a bit for each. Not if any is no number.
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
        let reach = spheres.radius * (1.0 + ROUNDING) + self.radius;
        let distance_2 = x * x + y * y + z * z;
        let beside_2 = distance_2 * (1.0 - 4.0 * ROUNDING) - along * along;
        let is_far = beside_2.cmpgt(reach * reach) & distance_2.cmplt(Vec4::INFINITY);
        is_far.bitmask()
    }
}

/// The planes of a [`CasterHull`] in `f32`.
#[derive(Debug, Clone, PartialEq)]
pub struct CoarseHull {
    /// Outward normals, and distances along them.
    planes: Vec<Vec4>,
}

impl CoarseHull {
    /// The same in `f32`.
    pub fn new(hull: &CasterHull) -> Self {
        let plane = |plane: &HalfSpace| plane.normal.as_vec3().extend(plane.distance as f32);
        Self {
            planes: hull.planes.iter().map(plane).collect(),
        }
    }

    /// Which of four spheres are certainly outside of one of the planes, a bit for each. Not if any is no number.
    #[inline]
    pub fn are_outside(&self, spheres: &FourSpheres) -> u32 {
        let FourSpheres { x, y, z, radius } = *spheres;
        let magnitude = x.abs().max(y.abs()).max(z.abs());
        // A plane that they touch is no farther away than they reach.
        let reach = radius * (1.0 + ROUNDING) + magnitude * (4.0 * ROUNDING);
        let mut outside = 0;
        for plane in &self.planes {
            let along = x * plane.x + y * plane.y + z * plane.z;
            outside |= (along - reach).cmpgt(Vec4::splat(plane.w)).bitmask();
            if outside == 0b1111 {
                break;
            }
        }
        outside
    }
}

/// The sums of four vectors' coordinates.
#[inline]
fn sum(vectors: [Vec3A; 4]) -> Vec4 {
    let [x, y, z] = lanes(vectors);
    x + y + z
}

/// Four vectors' coordinates, each of all.
#[inline]
fn lanes([a, b, c, d]: [Vec3A; 4]) -> [Vec4; 3] {
    let rows = Mat4::from_cols(a.extend(0.0), b.extend(0.0), c.extend(0.0), d.extend(0.0));
    let lanes = rows.transpose();
    [lanes.x_axis, lanes.y_axis, lanes.z_axis]
}
