//! How much nearer to the light than a lookup's point the texels that it reads may be and still be
//! the surface that the point lies on: exactly that much, for any map.
//!
//! A map stores the depth of texel centers, and a lookup reads those around its point, so on a slope
//! it finds texels that are nearer to the light than the point. A map's matrix takes planes to
//! planes: the depth changes evenly over the map, and each texel is compared with the
//! receiver's plane at its own center ([`Bias::at`]). On planes nothing is left of the bias then but
//! rounding; bends of the surface and walls that stand on it need their parts.
//!
//! Let `X`, `Y` and `Z` be the gradients of NDC over the world at the point
//! ([`MapDerivatives`]), and `n` the plane's normal. The depth's slopes `a` and `b` along the map's
//! axes are those for which `Z − aX − bY` is parallel to `n`, that is
//! `a = Z·(Y × n) / X·(Y × n)` and `b = Z·(n × X) / X·(Y × n)`. `shaders/receiver.wesl` and
//! `shaders/filter.wesl` do the same on the GPU, which also lifts lookups where light runs out on
//! smooth-shaded meshes ([`FACETS`]): that takes the shading normal.

use glam::{DMat4, DVec2, DVec3};

/// A wall that stands on the receiver's plane may rise by so many texels' size towards the light,
/// which it reaches half a texel away, before it is taken for a caster.
pub const WALL_SLOPE: f64 = 2.0;

/// The receiver's surface bends upwards by no more than one part in so many of a radian within a
/// texel: under a sun that grazes the ground a texel covers much of it.
pub const BEND_RECIPROCAL: u32 = 7;

/// Rasterizers round vertices to 1/256 of a texel, and with them the plane that a map holds; with a
/// margin (texels).
pub const TEXEL_ROUNDING: f64 = 1.0 / 64.0;

/// A triangle of a smooth-shaded mesh ends within so many times the distance from its middle that the
/// shading normal's deviation and curvature come to. That far, times the sine by which it is turned
/// away from the light, lies the shaded surface above it.
pub const FACETS: u32 = 3;

/// Planes that rise by more than this (meters towards the light per meter across it) are taken to
/// rise by no more, for they end soon: the rest of what they need goes along the surface's normal,
/// where it takes a texel or so.
pub const STEEPEST_SLOPE: u32 = 16;

/// Planes that rise by more than this (meters towards the light per meter across it) end before they
/// have left a wide filter, which is narrowed for them.
pub const STEEP_SLOPE: u32 = 3;

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
    pub fn at(clip_from_world: &DMat4, point_ws: DVec3) -> Option<Self> {
        let clip = *clip_from_world * point_ws.extend(1.0);
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
    pub fn depth_slope(&self, normal_ws: DVec3) -> Option<DVec2> {
        let normal_ws = normal_ws.try_normalize()?;
        let (y_and_normal, normal_and_x) = (self.y.cross(normal_ws), normal_ws.cross(self.x));
        let area = self.x.dot(y_and_normal);
        let least = self.x.length() * self.y.length() / f64::from(EDGE_ON_RECIPROCAL);
        let clamped_area = area.abs().max(least).copysign(area);
        (least > 0.0)
            .then(|| DVec2::new(self.z.dot(y_and_normal), self.z.dot(normal_and_x)) / clamped_area)
    }

    /// Size of a texel across the light, along the map's axes (meters); of sheared maps, how far its rows and
    /// columns are apart.
    pub fn texel(&self, map_size: DVec2) -> DVec2 {
        2.0 / map_size / DVec2::new(self.x.length(), self.y.length())
    }
}

/// How much nearer to the light than a point the texels around it may be and still be its own
/// surface (NDC depth).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bias {
    /// What the receiver's plane rises per texel along the map's x and y.
    pub slope: DVec2,
    /// What it rises more per texel where it bends ([`BEND_RECIPROCAL`]).
    pub bend: f64,
    /// What a wall on it may rise at most: evenly up to half a texel away, and no more beyond
    /// ([`WALL_SLOPE`]).
    pub wall: f64,
    /// What positions and the plane are rounded by.
    pub rounding: f64,
    /// How far the point is moved along the normal, to the light's side (meters): nothing unless the
    /// plane is nearly edge-on ([`STEEPEST_SLOPE`]).
    pub offset: f64,
}

impl Bias {
    /// For a texel whose center lies so far from the point (texels).
    pub fn at(&self, offset: DVec2) -> f64 {
        let farthest = offset.abs().max_element();
        let rise = self.slope.dot(offset);
        let bent = (rise + self.bend * farthest).min(self.most());
        let wall = self.wall * (2.0 * farthest).min(1.0);
        rise + (bent.max(wall) - rise).min(self.most()).max(0.0) + self.rounding
    }

    /// What the plane rises within a texel along both axes, or a wall: beyond the plane, no
    /// texel needs more.
    pub fn most(&self) -> f64 {
        self.slope.abs().element_sum().max(self.wall)
    }
}

/// The bias of [`ShadowBias::Automatic`](crate::ShadowBias): what the plane, its bends, a wall on it
/// and the rounding of positions need, for a point, a normal and a direction to the light in world
/// space. `None` as for [`MapDerivatives`].
pub fn automatic(
    clip_from_world: &DMat4,
    point_ws: DVec3,
    normal_ws: DVec3,
    to_light_ws: DVec3,
    map_size: DVec2,
) -> Option<Bias> {
    let map = MapDerivatives::at(clip_from_world, point_ws)?;
    let (normal_ws, to_light_ws) = (normal_ws.try_normalize()?, to_light_ws.try_normalize()?);
    let whole_slope = map.depth_slope(normal_ws)? * 2.0 / map_size;
    let sizes = map.texel(map_size);
    let per_meter = map.z.dot(to_light_ws).abs();
    let texel_depth = sizes.max_element() * per_meter;
    if !(texel_depth > 0.0 && texel_depth.is_finite()) {
        return None;
    }
    let whole_steepness = whole_slope.abs().element_sum();
    let steepness = whole_steepness.min(f64::from(STEEPEST_SLOPE) * texel_depth);
    let slope = whole_slope * (steepness / whole_steepness.max(f64::MIN_POSITIVE));
    let facing = normal_ws.dot(to_light_ws).abs();
    let out = facing.max(1.0 / f64::from(EDGE_ON_RECIPROCAL));
    let positions =
        (point_ws.x.abs() + point_ws.y.abs() + point_ws.z.abs()) / f64::from(ROUNDING_RECIPROCAL);
    let sideways = (slope.abs() / sizes).element_sum();
    Some(Bias {
        slope,
        bend: (texel_depth + slope.length_squared() / texel_depth) / f64::from(BEND_RECIPROCAL),
        wall: WALL_SLOPE * texel_depth,
        rounding: TEXEL_ROUNDING * steepness + positions * (map.z.length() + sideways),
        offset: out * (whole_steepness - steepness) / per_meter,
    })
}
