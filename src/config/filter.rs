//! How shadow maps are looked up: bias, filter, and the way from one cascade into the next.

use bevy::{
    light::DirectionalLight,
    reflect::{
        Reflect, ReflectDeserialize, ReflectSerialize, std_traits::ReflectDefault,
        structs::GetField,
    },
};
use serde::{Deserialize, Serialize};

use super::{ConfigError, MapFit, MapSize, ParallelSplitShadows};
use crate::geometry::{bias::MOST_OFFSET_TEXELS, fit::LookupReach};

/// The largest filter radius that stays affordable (texels): it reads 256 of them.
pub const MAX_FILTER_TEXELS: f64 = 8.0;

/// Radius of the tent that has the variance of Bevy's Gaussian (texels).
pub(crate) const GAUSSIAN_TEXELS: f64 = 2.65;
/// That of its temporal filter's disk (texels).
pub(crate) const TEMPORAL_TEXELS: f64 = 2.0;

/// Larger suns are a mistake (degrees).
const MAX_SUN_DEGREES: f64 = 20.0;

/// How far a lookup is moved towards the light so that surfaces do not shadow themselves.
///
/// `DirectionalLight::shadow_normal_bias` and `shadow_depth_bias` act as multipliers around
/// Bevy's defaults (1.8 and 0.02): twice the default doubles the part of the bias that
/// follows the slope and the part that does not, and zero takes it away.
#[derive(Reflect, Serialize, Deserialize, Debug, Default, Clone, Copy, PartialEq)]
#[reflect(Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum ShadowBias {
    /// What suffices and no more, by the map's matrix, the surface's plane and what one tap of
    /// the filter reads ([`geometry::bias`](crate::geometry::bias)); each tap is compared with
    /// the surface's plane at its own place, so that wide filters need no more than narrow
    /// ones.
    #[default]
    Automatic,
    /// The same everywhere. Either it is too little on slopes or too much elsewhere.
    Constant {
        /// Towards the light (meters, at least 0).
        meters: f64,
    },
    /// Grows with the depth's slope over the map, as the rasterizer's slope-scaled bias does
    /// (Scherzer and Wimmer, 4.2).
    SlopeScaled {
        /// Times the greatest change of depth from texel to texel (at least 0). Twice the
        /// filter's reach in texels suffices on planes.
        factor: f64,
        /// On top of that (meters, at least 0).
        meters: f64,
    },
    /// Moves the lookup along the surface's normal, as far as the sine of the angle between
    /// normal and light says. Moves shadows off their casters as well.
    NormalOffset {
        /// At a sine of 1 (texels, at least 0).
        texels: f64,
    },
    /// Compares each tap with the surface's plane at its own place, and moves all by the same.
    ReceiverPlane {
        /// Towards the light (meters, at least 0).
        meters: f64,
    },
}

/// How depth grows over a warped map. Without a warp the two are one.
#[derive(Reflect, Serialize, Deserialize, Debug, Default, Clone, Copy, PartialEq, Eq)]
#[reflect(Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum DepthDistribution {
    /// As the warp's division leaves it: planes stay planes, so the automatic bias is exact.
    #[default]
    Hyperbolic,
    /// As though the map held distances along the light (Scherzer and Wimmer, 4.2): taps are
    /// compared with the plane that faces the light. Of use with
    /// [`ShadowBias::Constant`] and [`ShadowBias::SlopeScaled`], which then need less; the
    /// other biases know better planes.
    Linear,
}

/// Which faces of closed casters the maps hold.
#[derive(Reflect, Serialize, Deserialize, Debug, Default, Clone, Copy, PartialEq, Eq)]
#[reflect(Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum CasterFaces {
    /// Those that materials show.
    #[default]
    Front,
    /// Those that materials cull (Scherzer and Wimmer, 4.2): lit surfaces are not in the map
    /// and cannot shadow themselves, but open meshes and ground cast no shadow, and thin ones
    /// leak. The bias turns around, away from the light, so materials without culling shadow
    /// themselves.
    Back,
}

/// How the neighborhood of a lookup is weighed.
#[derive(Reflect, Serialize, Deserialize, Debug, Default, Clone, Copy, PartialEq)]
#[reflect(Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum ShadowFilter {
    /// As the camera's `ShadowFilteringMethod` says: `Hardware2x2`, a tent of 2.65 texels for
    /// `Gaussian`, which has the variance of Bevy's kernel, or `Temporal` of 2 texels. A light
    /// with a `soft_shadow_size` casts [`ShadowFilter::Soft`] shadows instead: 10 is about
    /// the sun.
    #[default]
    Camera,
    /// The four nearest texels, by bilinear weights: one tap.
    Hardware2x2,
    /// All texels within the radius, weights falling evenly to zero. Radius 1 is
    /// `Hardware2x2`; up to 3 texels take nine taps, `r` more take about `r (r + 2)`, and twice as
    /// many where a shadow's edge is near. Wider is softer and hides texels; edges move off
    /// the truth by what is hidden.
    Tent(FilterRadius),
    /// Eight taps on a spiral, turned from pixel to pixel and frame to frame: for cameras with
    /// temporal antialiasing; grainy otherwise.
    Temporal(FilterRadius),
    /// Percentage-closer soft shadows: the farther the caster from the surface, the softer. 16
    /// taps to find how far, 16 to filter, turned from pixel to pixel.
    Soft {
        /// How large the sun looks (degrees, above 0 and at most 20). The real one: 0.53.
        sun_degrees: f64,
    },
}

/// The radius of a filter. Measured across the light: in a warped map the filter covers the
/// same shape in the world.
#[derive(Reflect, Serialize, Deserialize, Debug, Clone, Copy, PartialEq)]
#[reflect(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum FilterRadius {
    /// In texels of each map (1 to [`MAX_FILTER_TEXELS`]): as sharp as the map allows.
    Texels(f64),
    /// In meters (above 0): edges are equally soft in all cascades, as far as 1 to
    /// [`MAX_FILTER_TEXELS`] of their texels allow.
    Meters(f64),
}

/// How one cascade gives way to the next within the blend band.
#[derive(Reflect, Serialize, Deserialize, Debug, Default, Clone, Copy, PartialEq, Eq)]
#[reflect(Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum CascadeTransition {
    /// Both are looked up and mixed.
    #[default]
    CrossFade,
    /// One of the two is looked up, by a pattern that changes from frame to frame: costs
    /// nothing, for cameras with temporal antialiasing.
    Dither,
}

impl ShadowBias {
    pub(super) fn validate(self) -> Result<(), ConfigError> {
        /// More than this many meters or texels is a mistake.
        const MOST: f64 = 1000.0;
        let check = |field, value| ConfigError::check_range(field, value, 0.0..=MOST);
        match self {
            Self::Automatic => Ok(()),
            Self::Constant { meters } | Self::ReceiverPlane { meters } => check("meters", meters),
            Self::SlopeScaled { factor, meters } => {
                check("factor", factor)?;
                check("meters", meters)
            }
            Self::NormalOffset { texels } => check("texels", texels),
        }
    }
}

impl ShadowFilter {
    pub(super) fn validate(self) -> Result<(), ConfigError> {
        match self {
            Self::Camera | Self::Hardware2x2 => Ok(()),
            Self::Tent(radius) | Self::Temporal(radius) => match radius {
                FilterRadius::Texels(texels) => {
                    ConfigError::check_range("Texels", texels, 1.0..=MAX_FILTER_TEXELS)
                }
                FilterRadius::Meters(meters) => ConfigError::check_positive("Meters", meters),
            },
            Self::Soft { sun_degrees } => {
                if sun_degrees > 0.0 && sun_degrees <= MAX_SUN_DEGREES {
                    return Ok(());
                }
                Err(ConfigError::out_of_range(
                    "sun_degrees",
                    sun_degrees,
                    format_args!("above 0 and at most {MAX_SUN_DEGREES}"),
                ))
            }
        }
    }

    /// How far a lookup reads from its point, in texels, one bilinear tap included. Over texels
    /// that are not `square`, a filter is longer in one direction than its radius says.
    pub fn reach_texels(self, square: bool) -> f64 {
        match self {
            Self::Hardware2x2 => 1.0,
            _ if !square => MAX_FILTER_TEXELS + 1.0,
            // The camera may ask for any of Bevy's methods.
            Self::Camera => GAUSSIAN_TEXELS.max(TEMPORAL_TEXELS).ceil() + 1.0,
            Self::Tent(FilterRadius::Texels(texels))
            | Self::Temporal(FilterRadius::Texels(texels)) => texels + 1.0,
            Self::Tent(FilterRadius::Meters(_))
            | Self::Temporal(FilterRadius::Meters(_))
            | Self::Soft { .. } => MAX_FILTER_TEXELS + 1.0,
        }
    }
}

/// A light of this `soft_shadow_size` looks as large as the sun.
const SUNS_SOFT_SIZE: f64 = 10.0;
/// Degrees.
const SUNS_SIZE: f64 = 0.53;

impl ParallelSplitShadows {
    /// The filter for a light: soft if the light has a `soft_shadow_size` and the filter is left
    /// to the camera.
    pub fn filter_for(&self, light: &DirectionalLight) -> ShadowFilter {
        // By name: the field is there if anyone has switched Bevy's feature on.
        let size = light.get_field::<Option<f32>>("soft_shadow_size");
        let size = size.copied().flatten().unwrap_or(0.0);
        if self.filter == ShadowFilter::Camera && size > 0.0 {
            let sun_degrees = f64::from(size) / SUNS_SOFT_SIZE * SUNS_SIZE;
            return ShadowFilter::Soft {
                sun_degrees: sun_degrees.min(MAX_SUN_DEGREES),
            };
        }
        self.filter
    }

    /// What surface lookups reach beyond their points, for a light.
    pub fn lookup_reach(&self, light: &DirectionalLight) -> LookupReach {
        let normal = normal_multiplier(light.shadow_normal_bias).abs();
        let offset = match self.bias {
            ShadowBias::NormalOffset { texels } => texels * normal,
            ShadowBias::Automatic => {
                MOST_OFFSET_TEXELS * normal.max(depth_multiplier(light.shadow_depth_bias).abs())
            }
            _ => 0.0,
        };
        let filter = self.filter_for(light);
        LookupReach {
            texels: (filter.reach_texels(self.has_square_texels()) + offset).ceil(),
        }
    }

    /// Whether all maps have square texels.
    pub(crate) fn has_square_texels(&self) -> bool {
        !self.fit.any(|fit| fit != MapFit::Stable)
            && !matches!(self.map_size, MapSize::Sides(_) | MapSize::Budget(_))
    }
}

/// What a light's `shadow_normal_bias` multiplies the slope's part of the bias by.
pub(crate) fn normal_multiplier(shadow_normal_bias: f32) -> f64 {
    multiplier(
        shadow_normal_bias,
        DirectionalLight::DEFAULT_SHADOW_NORMAL_BIAS,
    )
}

/// What a light's `shadow_depth_bias` multiplies the constant part of the bias by.
pub(crate) fn depth_multiplier(shadow_depth_bias: f32) -> f64 {
    multiplier(
        shadow_depth_bias,
        DirectionalLight::DEFAULT_SHADOW_DEPTH_BIAS,
    )
}

fn multiplier(value: f32, default: f32) -> f64 {
    let ratio = f64::from(value) / f64::from(default);
    if ratio.is_finite() { ratio } else { 1.0 }
}
