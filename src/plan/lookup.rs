//! What a light's own fields say of its lookups, and its own configuration of its range.

use bevy::{
    light::{CascadeShadowConfig, DirectionalLight},
    reflect::structs::GetField,
};

use crate::{
    config::{MAX_SUN_DEGREES, ParallelSplitShadows, ShadowBias, ShadowFilter, SplitScheme},
    geometry::fit::LookupReach,
};

/// A light of this `soft_shadow_size` looks as large as the sun.
const SUN_SOFT_SIZE: f64 = 10.0;
/// How large the sun looks (degrees).
const SUN_DEGREES: f64 = 0.53;

/// The filter for a light: soft if the light has a `soft_shadow_size` and the filter is left to the
/// camera.
pub fn filter_of(config: &ParallelSplitShadows, light: &DirectionalLight) -> ShadowFilter {
    // By name: the field is there if anyone has switched Bevy's feature on.
    let size = light.get_field::<Option<f32>>("soft_shadow_size");
    let size = size.copied().flatten().unwrap_or(0.0);
    if config.filter == ShadowFilter::Camera && size > 0.0 {
        let sun_degrees = (f64::from(size) / SUN_SOFT_SIZE * SUN_DEGREES) as f32;
        return ShadowFilter::Soft {
            sun_degrees: sun_degrees.min(MAX_SUN_DEGREES),
        };
    }
    config.filter
}

/// What surface lookups reach beyond their points, for a light.
pub fn lookup_reach(config: &ParallelSplitShadows, light: &DirectionalLight) -> LookupReach {
    let [slope_scale, _] = bias_scales(light).map(f64::abs);
    let offset = match config.comparison.bias {
        ShadowBias::NormalOffset { texels } => f64::from(texels) * slope_scale,
        _ => 0.0,
    };
    let filter = filter_of(config, light).reach_texels(config.has_square_texels());
    LookupReach {
        texels: (f64::from(filter) + offset).ceil(),
    }
}

/// What a light multiplies the bias by: the part that follows the slope by its
/// `shadow_normal_bias`, the constant part by its `shadow_depth_bias`, both over Bevy's defaults.
pub fn bias_scales(light: &DirectionalLight) -> [f64; 2] {
    [
        (
            light.shadow_normal_bias,
            DirectionalLight::DEFAULT_SHADOW_NORMAL_BIAS,
        ),
        (
            light.shadow_depth_bias,
            DirectionalLight::DEFAULT_SHADOW_DEPTH_BIAS,
        ),
    ]
    .map(|(value, default)| {
        let ratio = f64::from(value) / f64::from(default);
        if ratio.is_finite() { ratio } else { 1.0 }
    })
}

/// A configuration over the range that the light's own has, if the game has set that one and has left
/// ours at its default. As it is where that makes no range.
pub fn over_own_range(
    config: &ParallelSplitShadows,
    own: &CascadeShadowConfig,
) -> ParallelSplitShadows {
    let default = ParallelSplitShadows::default();
    let is_set = [config.near, config.far] != [default.near, default.far]
        || matches!(config.splits, SplitScheme::Manual(_));
    let [near, far] = match own.bounds[..] {
        _ if is_set || own.bounds == CascadeShadowConfig::default().bounds => {
            return config.clone();
        }
        // Bevy's splits are logarithmic from the first on.
        [first, .., last] => {
            let ratio = (last / first).powf(1.0 / (own.bounds.len() - 1) as f32);
            [first / ratio, last]
        }
        [last] => [config.near.min(0.1 * last), last],
        [] => return config.clone(),
    };
    let over_own = ParallelSplitShadows {
        near,
        far,
        ..config.clone()
    };
    if over_own.validate(u32::MAX).is_ok() {
        over_own
    } else {
        config.clone()
    }
}
