//! How much nearer to the light a lookup must be taken for a plane not to shadow itself: exactly
//! enough, for any map.
//!
//! A map stores the depth of texel centers, and a lookup reads those around it, so on a slope it
//! finds texels that are nearer to the light than the surface at the lookup. A map's matrix
//! takes planes to planes: the depth changes evenly over the map, and the greatest change within
//! the lookup's reach is necessary and sufficient ([`sufficient`]).
//!
//! Let `X`, `Y` and `Z` be the gradients of NDC over the world at the point
//! ([`MapDerivatives`]), and `n` the plane's normal. The depth's slopes `a` and `b` along the map's
//! axes are those for which `Z − aX − bY` is parallel to `n`, that is
//! `a = Z·(Y × n) / X·(Y × n)` and `b = Z·(n × X) / X·(Y × n)`. A filter of many taps compares
//! each with the plane at its own place, by these slopes, so the bias has to cover the reach of
//! one tap only ([`TAP_REACH`]), whatever the filter. [`automatic`] adds what walls on the
//! plane and the rounding of positions need. `shaders/receiver.wesl` does the same on the GPU.

use glam::{DMat4, DVec2, DVec3};

/// What a bilinear tap reads: texel centers less than one texel away, along both axes; and the
/// 1/256 of a texel that rasterizers round vertices to, with a margin (texels).
pub const TAP_REACH: f64 = 1.0 + 1.0 / 64.0;

/// The automatic bias is never below that of a plane with this slope (meters towards the light
/// per meter across it): a wall may stand on the plane, and rises within one tap's reach.
pub const LEAST_SLOPE: f64 = 2.0;

/// The automatic bias moves a lookup towards the light by no more than this (texels across the
/// light), or nearly edge-on surfaces would lose the shadows of what stands close to them. What
/// is missing is made up for along the surface's normal, where it takes less than two texels at
/// any slope.
pub const MOST_TEXELS: u32 = 3;

/// What it then takes along the normal at most (texels): the wall's and the rounding's parts
/// included, with a margin.
pub const MOST_OFFSET_TEXELS: f64 = 2.0;

/// Where a filter's taps differ, casters that rise by less than this from the lookup's point
/// (meters towards the light per meter across it, on top of the plane's own slope) may be a bend
/// of the surface itself.
pub const CORNER_SLOPE: u32 = 4;

/// Where the sine of the angle between plane and light is below one part in so many (89.6° from
/// facing it), it is taken as that: such planes get no light to speak of.
pub const EDGE_ON_RECIPROCAL: u32 = 128;

/// World positions are rounded by one part in so many, matrices' products included.
pub const ROUNDING_RECIPROCAL: u32 = 1 << 22;

/// NDC at a point of the world, and its gradients there (per meter).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapDerivatives {
    /// NDC of the point.
    pub ndc: DVec3,
    /// Gradient of NDC x.
    pub x: DVec3,
    /// Gradient of NDC y.
    pub y: DVec3,
    /// Gradient of NDC depth.
    pub z: DVec3,
}

impl MapDerivatives {
    /// At a point in world space. `None` where the map has no image of it.
    pub fn at(clip_from_world: &DMat4, point: DVec3) -> Option<Self> {
        let clip = *clip_from_world * point.extend(1.0);
        let ndc = clip.truncate() / clip.w;
        let row = |index| clip_from_world.row(index).truncate();
        let gradient = |index, value| (row(index) - value * row(3)) / clip.w;
        (clip.w > 0.0 && ndc.is_finite()).then(|| Self {
            ndc,
            x: gradient(0, ndc.x),
            y: gradient(1, ndc.y),
            z: gradient(2, ndc.z),
        })
    }

    /// Change of NDC depth per NDC length along the map's x and y, over the plane through the
    /// point with this normal (world space, of any length). `None` if the normal has no
    /// direction or the map no area.
    pub fn depth_slope(&self, normal: DVec3) -> Option<DVec2> {
        let normal = normal.try_normalize()?;
        let (y_and_normal, normal_and_x) = (self.y.cross(normal), normal.cross(self.x));
        let area = self.x.dot(y_and_normal);
        let least = self.x.length() * self.y.length() / f64::from(EDGE_ON_RECIPROCAL);
        let clamped_area = area.abs().max(least).copysign(area);
        (least > 0.0)
            .then(|| DVec2::new(self.z.dot(y_and_normal), self.z.dot(normal_and_x)) / clamped_area)
    }

    /// Size of a texel across the light, along the map's axes (meters).
    pub fn texel(&self, map_size: DVec2) -> DVec2 {
        2.0 / map_size / DVec2::new(self.x.length(), self.y.length())
    }
}

/// The bias in NDC depth that suffices for lookups that read texel centers at most `reach`
/// texels away along each axis, in a map of so many texels: a nearest texel's reach is a half, a
/// bilinear tap's one, that of a kernel of bilinear taps up to `j` texels away `j + 1`.
pub fn sufficient(slope: DVec2, reach: DVec2, map_size: DVec2) -> f64 {
    (2.0 * reach / map_size).dot(slope.abs())
}

/// How far a lookup is moved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bias {
    /// Towards the light (NDC depth).
    pub depth: f64,
    /// Along the normal, to the light's side (meters).
    pub offset: f64,
}

/// The bias that every tap of a lookup gets ([`ShadowBias::Automatic`](crate::ShadowBias)): what
/// one tap reads of the plane, or of a wall on it, and what positions are rounded by. An
/// offset along the normal clears a plane as a depth bias does that is as much larger as the sine
/// of the angle between plane and light is smaller. `None` as for [`MapDerivatives`].
pub fn automatic(
    clip_from_world: &DMat4,
    point: DVec3,
    normal: DVec3,
    to_light: DVec3,
    map_size: DVec2,
) -> Option<Bias> {
    let map = MapDerivatives::at(clip_from_world, point)?;
    let (normal, to_light) = (normal.try_normalize()?, to_light.try_normalize()?);
    let slope = map.depth_slope(normal)?;
    let reach = sufficient(slope, DVec2::splat(TAP_REACH), map_size);
    let sizes = map.texel(map_size);
    let (texel, per_meter) = (sizes.max_element(), map.z.dot(to_light).abs());
    let wall = LEAST_SLOPE * texel * per_meter;
    let rounding = (point.x.abs() + point.y.abs() + point.z.abs()) / f64::from(ROUNDING_RECIPROCAL);
    let sideways = (slope.abs() * 2.0 / map_size / sizes).element_sum();
    let need = reach.max(wall) + rounding * (map.z.length() + sideways);
    let depth = need.min(f64::from(MOST_TEXELS) * texel * per_meter);
    let facing = normal.dot(to_light).abs();
    let out = facing.max(1.0 / f64::from(EDGE_ON_RECIPROCAL));
    Some(Bias {
        depth,
        offset: out * (need - depth) / per_meter,
    })
}
