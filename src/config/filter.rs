//! How shadow maps are looked up: the filter, and the way from one cascade into the next.

use bevy::reflect::{Reflect, ReflectDeserialize, ReflectSerialize, std_traits::ReflectDefault};
use serde::{Deserialize, Serialize};

use super::ConfigError;

/// The largest filter radius that stays affordable (texels): it reads 256 of them.
pub const MAX_FILTER_TEXELS: f32 = 8.0;

/// Radius of the tent that has the variance of Bevy's Gaussian (texels).
pub(crate) const GAUSSIAN_TEXELS: f32 = 2.65;
/// That of its temporal filter's disk (texels).
pub(crate) const TEMPORAL_TEXELS: f32 = 2.0;

/// Larger suns are a mistake (degrees).
pub(crate) const MAX_SUN_DEGREES: f32 = 20.0;

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
    /// The four nearest texels, each compared at its own center, by bilinear weights: as wide as Bevy's of that name,
    /// without the comparison that a sampler does.
    Hardware2x2,
    /// All texels within the radius, weights falling evenly to zero. Radius 1 is `Hardware2x2`;
    /// radius `r` reads about `4 r²` texels, and twice as many where a shadow's edge is near. Wider
    /// is softer and hides texels; edges move off the truth by what is hidden.
    Tent(FilterRadius),
    /// Eight taps on a spiral, turned from pixel to pixel and frame to frame: for cameras with
    /// temporal antialiasing; grainy otherwise.
    Temporal(FilterRadius),
    /// Percentage-closer soft shadows: the farther the caster from the surface, the softer. 16
    /// taps to find how far, 16 to filter, turned from pixel to pixel, and from frame to frame for cameras with
    /// temporal antialiasing or `ShadowFilteringMethod::Temporal`.
    Soft {
        /// How large the sun looks (degrees, above 0 and at most 20). The real one: 0.53.
        #[reflect(@0.0..=MAX_SUN_DEGREES)]
        sun_degrees: f32,
    },
}

/// The radius of a filter. Measured across the light: in a warped map the filter covers the
/// same shape in the world.
#[derive(Reflect, Serialize, Deserialize, Debug, Clone, Copy, PartialEq)]
#[reflect(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum FilterRadius {
    /// In texels of each map (1 to 8): as sharp as the map allows.
    Texels(#[reflect(@1.0..=MAX_FILTER_TEXELS)] f32),
    /// In meters (above 0): edges are equally soft in all cascades, as far as 1 to
    /// 8 of their texels allow.
    Meters(f32),
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

impl ShadowFilter {
    pub(super) fn validate(self) -> Result<(), ConfigError> {
        match self {
            Self::Camera | Self::Hardware2x2 => Ok(()),
            Self::Tent(radius) | Self::Temporal(radius) => match radius {
                FilterRadius::Texels(texels) => {
                    ConfigError::check_range("Texels", texels, 1.0..=MAX_FILTER_TEXELS)
                }
                FilterRadius::Meters(meters) => ConfigError::check_distance("Meters", meters),
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
    pub fn reach_texels(self, square: bool) -> f32 {
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
