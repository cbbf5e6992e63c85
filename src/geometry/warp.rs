//! Perspective warps: maps that give more texels to what is near the eye.
//!
//! A warp divides by a distance *across* the light (light-space perspective shadow maps, Wimmer
//! et al. 2004): rays of light stay parallel and keep their order of depth. Everything is in
//! terms of the strength `1/n'` instead of the distance `n'` from the centre of projection to
//! the body, so that no warp is the value zero and not a limit.

use glam::{DMat4, DVec3, DVec4};

use super::{
    aliasing::Aliasing,
    slice::{Slice, ViewVolume},
};

/// A vertex of the convex body that a map covers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyVertex {
    /// Where it is, in world space.
    pub position: DVec3,
    /// Height that the image has at its depth (metres).
    pub image_height: f64,
}

/// The vertices of a slice, in the order of its corners.
pub fn slice_vertices(slice: &Slice) -> [BodyVertex; 8] {
    core::array::from_fn(|corner| BodyVertex {
        position: slice.corners[corner],
        image_height: slice.image_height(corner),
    })
}

/// The frame of a warped map: orthonormal and right-handed, with its origin at the eye.
///
/// It turns with the camera, so warped maps cannot be snapped to texels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WarpFrame {
    /// The origin, in world space. The centre of projection has its lateral coordinate.
    pub eye: DVec3,
    /// Direction of the map's `u` axis, in world space.
    pub x: DVec3,
    /// Direction of the map's `v` axis and of the warp: away from the eye.
    pub y: DVec3,
    /// Unit vector from the scene to the light, in world space.
    pub z: DVec3,
}

/// Sines of angles between light and view below this count as zero.
const PARALLEL: f64 = 1e-6;

/// No map is thinner than this (metres): an extent is never divided by raw.
const MIN_EXTENT: f64 = 1e-6;

impl WarpFrame {
    /// A frame whose warp runs along `away`, as far as that lies across the light. `None` if
    /// it does not, or one of the directions is none.
    pub fn new(eye: DVec3, away: DVec3, to_light: DVec3) -> Option<Self> {
        let z = to_light.try_normalize()?;
        let y = away.reject_from_normalized(z).try_normalize()?;
        let x = y.cross(z);
        Some(Self { eye, x, y, z })
    }

    /// The frame for a view: the warp runs along the view direction, or along the camera's up
    /// where light and view are parallel and no strength is above zero. `None` if `to_light`
    /// has no direction or the camera no axes.
    pub fn of_view(view: &ViewVolume, to_light: DVec3) -> Option<Self> {
        let (forward, z) = (forward(view)?, to_light.try_normalize()?);
        let away = if forward.cross(z).length() < PARALLEL {
            view.axes.y_axis
        } else {
            forward
        };
        Self::new(view.eye, away, z)
    }

    /// The classical strength for a slice of a perspective view between two depths (1/metres;
    /// Scherzer and Wimmer, Eq. 1): equal errors along the warp at the slice's near and far
    /// end, if the light comes from the side. For other directions it can be many times worse
    /// than no warp at all. Expects `0 < near < far`.
    pub fn lispsm_strength(&self, view: &ViewVolume, near: f64, far: f64) -> f64 {
        let sine = forward(view).map_or(0.0, |forward| forward.cross(self.z).length());
        if sine < PARALLEL {
            return 0.0;
        }
        sine / (near + (near * far).sqrt())
    }

    /// The strength with the least worst error along the warp (1/metres): that of Lloyd et al.
    /// 2006 for a light from above, zero for one from behind, and continuous in between.
    ///
    /// Along the warp the error is never worse than without one. Across it, it can be: the
    /// storage factor of the view volume's slices stays within 32/27 of the best that any
    /// strength has (observed, not proven).
    pub fn minimax_strength(&self, body: &[BodyVertex]) -> f64 {
        let (near_line, far_line) = self.lines(body);
        let d = far_line - near_line;
        // Error at a vertex, up to a factor: (slope · strength + offset)² / (1 + strength · d).
        let roots: Vec<[f64; 2]> = body
            .iter()
            .map(|vertex| {
                let offset = vertex.image_height.sqrt().recip();
                [(self.along(vertex) - near_line) * offset, offset]
            })
            .collect();
        let worst = |strength: f64| {
            let root = roots
                .iter()
                .map(|[slope, offset]| slope * strength + offset)
                .fold(0.0, f64::max);
            root * root / (1.0 + strength * d)
        };
        // The worst error is convex, with its minimum where one vertex has its own or where two
        // are equally bad.
        let lowest = roots
            .iter()
            .map(|[slope, offset]| (d * offset - 2.0 * slope) / (d * slope));
        let equal = roots
            .iter()
            .flat_map(|a| roots.iter().map(|b| (b[1] - a[1]) / (a[0] - b[0])));
        lowest
            .chain(equal)
            .filter(|strength| *strength > 0.0 && strength.is_finite())
            .fold(0.0, |best, strength| {
                if worst(strength) < worst(best) {
                    strength
                } else {
                    best
                }
            })
    }

    /// The map over a body: from world space to clip space, NDC x and y in [−1, 1] over the
    /// body, z in [0, 1] with 1 at its light-side end (reverse z).
    ///
    /// The centre of projection lies `1 / strength` metres behind the body's nearest line, so
    /// `w >= 1` wherever light can reach the body, and 1 everywhere for strength zero: exactly
    /// the orthographic map. Casters behind the nearest line throw no shadow on the body.
    pub fn clip_from_world(&self, body: &[BodyVertex], strength: f64) -> DMat4 {
        let row = |axis: DVec3| axis.extend(-axis.dot(self.eye));
        let (near_line, far_line) = self.lines(body);
        let length = (far_line - near_line).max(MIN_EXTENT);
        let q = row(self.y) - near_line * DVec4::W;
        let w = strength * q + DVec4::W;
        let range = |row: DVec4| {
            extremes(body.iter().map(|vertex| {
                let position = vertex.position.extend(1.0);
                row.dot(position) / w.dot(position)
            }))
        };

        let u = row(self.x);
        let (left, right) = range(u);
        let top = extremes(body.iter().map(|vertex| self.local(vertex).z)).1;
        let height = row(self.z) - top * DVec4::W;
        let depth = -range(height).0;

        let x = (2.0 * u - (left + right) * w) / (right - left).max(MIN_EXTENT);
        let y = 2.0 * (1.0 + strength * length) / length * q - w;
        let z = w + height / depth.max(MIN_EXTENT);
        DMat4::from_cols(x, y, z, w).transpose()
    }

    /// The worst aliasing of that map over the body, for an image one pixel high.
    pub fn worst_aliasing(&self, body: &[BodyVertex], strength: f64) -> Option<Aliasing> {
        let clip_from_world = self.clip_from_world(body, strength);
        let at = |vertex: &BodyVertex| {
            let axes = [self.x, self.y];
            Aliasing::at(&clip_from_world, axes, vertex.position, vertex.image_height)
        };
        let all = body.iter().map(at);
        all.reduce(|a, b| Some(a?.max(b?))).flatten()
    }

    /// Where the body begins and ends along the warp (metres from the eye).
    pub(super) fn lines(&self, body: &[BodyVertex]) -> (f64, f64) {
        extremes(body.iter().map(|vertex| self.along(vertex)))
    }

    fn along(&self, vertex: &BodyVertex) -> f64 {
        self.local(vertex).y
    }

    fn local(&self, vertex: &BodyVertex) -> DVec3 {
        let p = vertex.position - self.eye;
        DVec3::new(self.x.dot(p), self.y.dot(p), self.z.dot(p))
    }
}

/// The direction in which the camera looks.
pub(super) fn forward(view: &ViewVolume) -> Option<DVec3> {
    (-view.axes.z_axis).try_normalize()
}

fn extremes(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), value| {
        (lo.min(value), hi.max(value))
    })
}
