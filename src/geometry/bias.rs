//! How much nearer to the light a lookup must be taken for a plane not to shadow itself: exactly
//! enough, for any map.
//!
//! A map stores the depth of texel centres, and a lookup reads those around it, so on a slope it
//! finds texels that are nearer to the light than the surface at the lookup. A map's matrix
//! takes planes to planes: the depth changes evenly over the map, and the greatest change within
//! the lookup's reach is necessary and sufficient.

use glam::{DMat4, DVec2, DVec3};

/// Sines of the angle between a plane and the light's rays below this have no bias that
/// suffices: the plane is edge-on, and gets no light to speak of.
const EDGE_ON: f64 = 1e-9;

/// Change of NDC depth per NDC length along a map's x and y, over a plane through `point` with
/// this normal (both in world space). `None` if the plane is edge-on to the light, or the map
/// has no image of the point.
pub fn depth_slope(clip_from_world: &DMat4, point: DVec3, normal: DVec3) -> Option<DVec2> {
    let clip = *clip_from_world * point.extend(1.0);
    let (a, b) = normal.try_normalize()?.any_orthonormal_pair();
    // Derivatives of NDC along two directions in the plane.
    let [a, b] = [a, b].map(|direction| {
        let change = *clip_from_world * direction.extend(0.0);
        (change.truncate() - clip.truncate() / clip.w * change.w) / clip.w
    });
    let determinant = a.x * b.y - a.y * b.x;
    let size = a.truncate().length() * b.truncate().length();
    let sound = clip.w > 0.0 && determinant.abs() > EDGE_ON * size;
    sound.then(|| {
        DVec2::new(
            (a.z * b.y - b.z * a.y) / determinant,
            (b.z * a.x - a.z * b.x) / determinant,
        )
    })
}

/// The bias in NDC depth that suffices for lookups that read texel centres at most `reach`
/// texels away along each axis, in a map of so many texels: a nearest texel's reach is a half, a
/// bilinear tap's one, that of a kernel of bilinear taps up to `j` texels away `j + 1`.
pub fn sufficient(slope: DVec2, reach: DVec2, map_size: DVec2) -> f64 {
    (2.0 * reach / map_size).dot(slope.abs())
}
