//! Perspective warps: maps that give more texels to what is near the eye.
//!
//! A warp divides by a distance *across* the light (light-space perspective shadow maps, Wimmer
//! et al. 2004): rays of light stay parallel and keep their order of depth. Everything is in
//! terms of the strength `1/n'` instead of the distance `n'` from the center of projection to
//! the body, so that no warp is the value zero and not a limit.

mod lispsm;
mod lloyd;
mod minimax;
mod rounding;
mod trapezoid;

use glam::{DMat3, DMat4, DVec2, DVec3, DVec4, UVec2};

use super::{
    aliasing::Aliasing,
    bias::MapDerivatives,
    fit::{LookupReach, usable},
    slice::{BodyVertex, ViewVolume},
};

use rounding::MOST_SLOPE;

/// The frame of a warped map: orthonormal and right-handed, with its origin at the eye.
///
/// It turns with the camera, so warped maps cannot be snapped to texels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WarpFrame {
    /// The origin, in world space. The center of projection has its lateral coordinate.
    pub eye: DVec3,
    /// Direction of the map's `u` axis, in world space.
    pub x: DVec3,
    /// Direction of the map's `v` axis and of the warp: away from the eye.
    pub y: DVec3,
    /// Unit vector from the scene to the light, in world space.
    pub z: DVec3,
    /// Sine of the angle between the light and the direction that the warp runs along; 0 where
    /// they are parallel.
    pub sine: f64,
}

/// Sines of angles between light and view below this count as zero.
const PARALLEL: f64 = 1e-6;

/// No map is thinner than this (meters): an extent is never divided by raw.
const MIN_EXTENT: f64 = 1e-6;

impl WarpFrame {
    /// A frame whose warp runs along `away`, as far as that lies across the light; all in world
    /// space. `None` if it does not, or one of the directions is none.
    pub fn new(eye: DVec3, away: DVec3, to_light: DVec3) -> Option<Self> {
        let (z, away) = (to_light.try_normalize()?, away.try_normalize()?);
        let y = away.reject_from_normalized(z).try_normalize()?;
        let x = y.cross(z);
        let sine = away.cross(z).length();
        Some(Self { eye, x, y, z, sine })
    }

    /// The frame for a view: the warp runs along the view direction, or along the camera's up
    /// where light and view are parallel and no strength is above zero. `None` if `to_light`, in
    /// world space, has no direction or the camera no axes.
    pub fn of_view(view: &ViewVolume, to_light: DVec3) -> Option<Self> {
        Self::along_or_up(view, view.forward()?, to_light)
    }

    /// A frame whose warp runs along `away`; or, where that is parallel to the light and no strength is above
    /// zero, along the camera's up, or its right if that is as well; all in world space. `None` as
    /// for [`WarpFrame::of_view`].
    pub fn along_or_up(view: &ViewVolume, away: DVec3, to_light: DVec3) -> Option<Self> {
        let to_light = to_light.try_normalize()?;
        let is_across = |axis: &DVec3| axis.cross(to_light).length() > PARALLEL * axis.length();
        if is_across(&away) {
            return Self::new(view.eye, away, to_light);
        }
        let across = [view.axes.y_axis, view.axes.x_axis]
            .into_iter()
            .find(is_across)?;
        let frame = Self::new(view.eye, across, to_light)?;
        Some(Self { sine: 0.0, ..frame })
    }

    /// The map over a body: from world space to clip space, NDC x and y in [−1, 1] over the
    /// body, z in [0, 1] over it, greater towards the light (reverse z).
    ///
    /// The center of projection lies `1 / strength` meters behind the body's nearest line, so
    /// `w >= 1` wherever light can reach the body, and 1 everywhere for strength zero: exactly
    /// the orthographic map. Casters behind the nearest line throw no shadow on the body.
    ///
    /// Depth is taken from the plane that lies through the body's middle. That leaves its order along
    /// rays of light as it is, and has surfaces near that plane, the ground above all, need the
    /// least bias: how depth changes from texel to texel does not grow with the distance to the
    /// light's end of the body.
    pub fn clip_from_world(&self, body: &[BodyVertex], strength: f64) -> DMat4 {
        let row = |axis_ws: DVec3| axis_ws.extend(-axis_ws.dot(self.eye));
        let (near_line, far_line) = self.lines(body);
        let length = (far_line - near_line).max(MIN_EXTENT);
        let q = row(self.y) - near_line * DVec4::W;
        let w = DVec4::W + strength * q;
        let range = |row: DVec4| {
            extremes(body.iter().map(|vertex| {
                let point_ws = vertex.position.extend(1.0);
                row.dot(point_ws) / w.dot(point_ws)
            }))
        };

        let u = row(self.x);
        let (left, right) = range(u);
        let [offset, across, along] = self.middle_plane(body);
        let height = row(self.z) - across * u - along * row(self.y) - offset * DVec4::W;
        let (bottom, top) = range(height);

        let x = (2.0 * u - (left + right) * w) / (right - left).max(MIN_EXTENT);
        let y = 2.0 * (1.0 + strength * length) / length * q - w;
        let z = (height - bottom * w) / (top - bottom).max(MIN_EXTENT);
        DMat4::from_cols(x, y, z, w).transpose()
    }

    /// The plane that fits the body's vertices best: height towards the light at the eye, and its
    /// change across and along the warp. No steeper than [`MOST_SLOPE`]: thin slices that the light sees along
    /// their length, nearly, have one that is nearly parallel to the light.
    fn middle_plane(&self, body: &[BodyVertex]) -> [f64; 3] {
        let local: Vec<DVec3> = body.iter().map(|vertex| self.local(vertex)).collect();
        let mean = local.iter().sum::<DVec3>() / local.len().max(1) as f64;
        let [mut square, mut product] = [DVec2::ZERO; 2];
        let mut mixed = 0.0;
        for p in local {
            let p = p - mean;
            square += p.truncate() * p.truncate();
            mixed += p.x * p.y;
            product += p.truncate() * p.z;
        }
        let determinant = square.x * square.y - mixed * mixed;
        let slope = if determinant > 1e-9 * square.x * square.y {
            DVec2::new(
                square.y * product.x - mixed * product.y,
                square.x * product.y - mixed * product.x,
            ) / determinant
        } else {
            DVec2::ZERO
        };
        let slope = slope.clamp_length_max(MOST_SLOPE);
        [mean.z - slope.dot(mean.truncate()), slope.x, slope.y]
    }

    /// That map with a guard around the body for what lookups reach beyond it, no finer than
    /// [`WarpFrame::least_texel`], and the size of a texel where it is largest (meters).
    pub fn guarded_map(
        &self,
        body: &[BodyVertex],
        strength: f64,
        map_size: UVec2,
        reach: LookupReach,
    ) -> (DMat4, DVec2) {
        let bare = self.clip_from_world(body, strength);
        let size = map_size.as_dvec2();
        let scale = usable(size, 2.0 * reach.texels) / size;
        let places = body
            .iter()
            .filter_map(|vertex| MapDerivatives::at(&bare, vertex.position));
        let places: Vec<_> = places
            .map(|map| (map.texel(size) / scale, map.z.dot(self.z)))
            .collect();
        let texels = || places.iter().map(|(texel, _)| *texel);
        let finest = texels().fold(DVec2::INFINITY, DVec2::min);
        let filled = (finest / self.least_texel()).min(DVec2::ONE);
        let (scale, texel) = (
            scale * filled,
            texels().fold(DVec2::ZERO, DVec2::max) / filled,
        );
        // Where texels are large, depth is shallow.
        let depths = places
            .iter()
            .map(|(texel, along_light)| (*texel / filled).max_element() * along_light);
        let margin = reach.texels * depths.fold(0.0, f64::max);
        let fit = DMat4::from_scale(scale.extend((1.0 + 2.0 * margin).recip()))
            * DMat4::from_translation(DVec3::Z * margin);
        (fit * bare, texel)
    }

    /// The worst aliasing of that map over the body, for an image one pixel high.
    pub fn worst_aliasing(&self, body: &[BodyVertex], strength: f64) -> Option<Aliasing> {
        let clip_from_world = self.clip_from_world(body, strength);
        Aliasing::over(&clip_from_world, [self.x, self.y], body)
    }

    /// The matrix from the frame to world space.
    pub fn world_from_frame(&self) -> DMat4 {
        let axes = DMat3::from_cols(self.x, self.y, self.z);
        DMat4::from_mat3_translation(axes, self.eye)
    }

    /// Where the body begins and ends along the warp (meters from the eye).
    pub(super) fn lines(&self, body: &[BodyVertex]) -> (f64, f64) {
        extremes(body.iter().map(|vertex| self.along(vertex)))
    }

    fn along(&self, vertex: &BodyVertex) -> f64 {
        self.local(vertex).y
    }

    fn local(&self, vertex: &BodyVertex) -> DVec3 {
        let p_ws = vertex.position - self.eye;
        DVec3::new(self.x.dot(p_ws), self.y.dot(p_ws), self.z.dot(p_ws))
    }
}

fn extremes(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), value| {
        (lo.min(value), hi.max(value))
    })
}
