//! How many pixels a texel covers: the error measure of Lloyd et al. 2006, *Warping and
//! partitioning for low error shadow maps*.
//!
//! Only perspective aliasing is measured, the part that maps can do something about; how a
//! surface is turned to light and eye is left out.

use glam::{DMat4, DVec2, DVec3};

use super::slice::BodyVertex;

/// Aliasing along a map's two axes for maps and images of *one* texel and pixel: a map of
/// `res_s × res_t` texels, seen in an image of `res` pixels a side, has `x · res / res_s` and
/// `z · res / res_t` (Lloyd et al. 2006, Eq. 1). Above one, texels show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aliasing {
    /// Along the map's x axis.
    pub x: f64,
    /// Along its y axis, which in a warped map is the warp's direction.
    pub z: f64,
}

impl Aliasing {
    /// The aliasing of a map at one place.
    ///
    /// - `clip_from_world`: any map, warped or not; NDC x and y in [−1, 1] over the map.
    /// - `axes_ws`: the unit directions in world space along which x and y of the map grow at its
    ///   center. The shear of a warped map's texels is left out, as in the paper.
    /// - `point_ws`: in world space.
    /// - `image_side`: side of the image at the point's depth (meters): `2 tan θ · depth`. All of
    ///   it counts as one pixel.
    ///
    /// `None` where the map has no image of the point (`w <= 0`) or no extent.
    pub fn at(
        clip_from_world: &DMat4,
        axes_ws: [DVec3; 2],
        point_ws: DVec3,
        image_side: f64,
    ) -> Option<Self> {
        let clip = *clip_from_world * point_ws.extend(1.0);
        let per_meter = |axis_ws: DVec3, row: usize| {
            let change_cs = *clip_from_world * axis_ws.extend(0.0);
            ((change_cs[row] - clip[row] / clip.w * change_cs.w) / clip.w).abs()
        };
        // The map is two wide.
        let [x, z] = [0, 1].map(|row| 2.0 / per_meter(axes_ws[row], row) / image_side);
        let is_valid = clip.w > 0.0 && x.is_finite() && z.is_finite();
        is_valid.then_some(Self { x, z })
    }

    /// The worst aliasing of a map over a convex body, for an image one pixel high; arguments as in
    /// [`Aliasing::at`]. `None` if the map has no image of a vertex.
    pub fn over(clip_from_world: &DMat4, axes: [DVec3; 2], body: &[BodyVertex]) -> Option<Self> {
        let all = body
            .iter()
            .map(|vertex| Self::at(clip_from_world, axes, vertex.position, vertex.image_height));
        all.reduce(|a, b| Some(a?.max(b?))).flatten()
    }

    /// Pixels that a texel covers along the map's axes, in an image `image_height` pixels high
    /// and a map of `map_size` texels. For aliasing that was worked out for an image one
    /// pixel high.
    pub fn pixels_per_texel(self, map_size: DVec2, image_height: f64) -> DVec2 {
        DVec2::new(self.x, self.z) * image_height / map_size
    }

    /// The worst of two, axis by axis.
    pub fn max(self, other: Self) -> Self {
        Self {
            x: self.x.max(other.x),
            z: self.z.max(other.z),
        }
    }

    /// The storage factor: texels that a map needs so that none shows, per pixel of the image
    /// (Lloyd et al. 2006, Eq. 12). Expects the worst aliasing over the map, which for convex
    /// bodies is found at their vertices: one component is a ratio of affine functions, the
    /// other a square over an affine function.
    pub fn storage(self) -> f64 {
        self.x * self.z
    }

    /// The least resolution at which no texel shows in an image of `image_size` pixels a side
    /// (texels; Lloyd et al. 2006, Eq. 13).
    pub fn critical_resolution(self, image_size: f64) -> DVec2 {
        DVec2::new(self.x, self.z) * image_size
    }

    /// The resolution that shares `texels` so that both axes are equally good (texels; Lloyd et
    /// al. 2006, Eq. 14).
    pub fn balanced_resolution(self, texels: f64) -> DVec2 {
        DVec2::new(
            (texels * self.x / self.z).sqrt(),
            (texels * self.z / self.x).sqrt(),
        )
    }
}

/// Storage factors of `partitions` logarithmic slices in the directions for which the paper has
/// closed forms. `ratio` is far over near, `tan` the tangent of half the field of view.
pub mod closed_form {
    /// Light from above, unwarped maps (Eq. 17).
    pub fn overhead(ratio: f64, tan: f64, partitions: u32) -> f64 {
        let r = slice_ratio(ratio, partitions);
        f64::from(partitions) * r * (r - 1.0) / (2.0 * tan)
    }

    /// Light from above, each slice warped (Eq. 18; Eq. 19 with face partitioning is the same).
    pub fn overhead_warped(ratio: f64, tan: f64, partitions: u32) -> f64 {
        f64::from(partitions) * (slice_ratio(ratio, partitions) - 1.0) / (2.0 * tan)
    }

    /// Light from behind, where a warp has no effect (Eq. 20).
    pub fn behind(ratio: f64, partitions: u32) -> f64 {
        f64::from(partitions) * slice_ratio(ratio, partitions).powi(2)
    }

    /// Light from behind or in front, one warped map for each side face of each slice and one
    /// for the near face (Eq. 21).
    pub fn behind_faces(ratio: f64, partitions: u32) -> f64 {
        2.0 * f64::from(partitions) * (slice_ratio(ratio, partitions) - 1.0) + 1.0
    }

    fn slice_ratio(ratio: f64, partitions: u32) -> f64 {
        ratio.powf(1.0 / f64::from(partitions))
    }
}
