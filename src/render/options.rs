//! A light's bias, filter and transition in the terms of the shader.

use bevy::light::DirectionalLight;

use crate::{
    config::{
        CascadeTransition, CasterFaces, DepthDistribution, FilterRadius, ParallelSplitShadows,
        ShadowBias, ShadowFilter,
    },
    geometry::bias::{TEXEL_ROUNDING, WALL_SLOPE},
    plan::{bias_scales, filter_of},
    shaders::code,
};

/// As `LightSlot` and the border of `CascadeSlot` in `shaders/slot.wesl`.
#[derive(Debug, Default, Clone, Copy, PartialEq)]
pub(crate) struct LookupOptions {
    /// Kind, size, whether that is in meters, whether cascades are dithered.
    pub filter: [f32; 4],
    /// Kind, two parameters, whether depth is taken as linear.
    pub bias: [f32; 4],
    /// Multipliers of the bias: the part that follows the slope, and the constant one. Then 1, or
    /// −1 where maps hold back faces.
    pub bias_scale: [f32; 3],
    /// Texels at a map's edge that filters would reach over.
    pub border: f32,
}

impl LookupOptions {
    pub fn new(config: &ParallelSplitShadows, light: &DirectionalLight) -> Self {
        let kind = filter_of(config, light);
        let (filter, size, in_meters) = match kind {
            ShadowFilter::Camera => (code::FILTER_CAMERA, 1.0, false),
            ShadowFilter::Hardware2x2 => (code::FILTER_HARDWARE, 1.0, false),
            ShadowFilter::Tent(radius) => with_radius(code::FILTER_TENT, radius),
            ShadowFilter::Temporal(radius) => with_radius(code::FILTER_TEMPORAL, radius),
            ShadowFilter::Soft { sun_degrees } => {
                let tangent = (0.5 * f64::from(sun_degrees)).to_radians().tan();
                (code::FILTER_SOFT, tangent as f32, false)
            }
        };
        let (bias, parameters) = match config.comparison.bias {
            ShadowBias::Automatic => (
                code::BIAS_AUTOMATIC,
                [TEXEL_ROUNDING as f32, WALL_SLOPE as f32],
            ),
            ShadowBias::Constant { meters } => (code::BIAS_CONSTANT, [meters, 0.0]),
            ShadowBias::SlopeScaled { factor, meters } => {
                (code::BIAS_SLOPE_SCALED, [meters, factor])
            }
            ShadowBias::NormalOffset { texels } => (code::BIAS_NORMAL_OFFSET, [texels, 0.0]),
            ShadowBias::ReceiverPlane { meters } => (code::BIAS_RECEIVER_PLANE, [meters, 0.0]),
        };
        let side = match config.comparison.caster_faces {
            CasterFaces::Front => 1.0,
            CasterFaces::Back => -1.0,
        };
        let [slope_scale, constant_scale] = bias_scales(light).map(|scale| {
            // What suffices is the least that does.
            let is_automatic = config.comparison.bias == ShadowBias::Automatic;
            if is_automatic { scale.max(1.0) } else { scale }
        });
        let flag = |set: bool| f32::from(u8::from(set));
        Self {
            filter: [
                filter as f32,
                size,
                flag(in_meters),
                flag(config.transition == CascadeTransition::Dither),
            ],
            bias: [
                bias as f32,
                parameters[0],
                parameters[1],
                flag(config.comparison.depth == DepthDistribution::Linear),
            ],
            bias_scale: [slope_scale as f32, constant_scale as f32, side],
            border: kind.reach_texels(config.has_square_texels()),
        }
    }
}

fn with_radius(kind: u32, radius: FilterRadius) -> (u32, f32, bool) {
    match radius {
        FilterRadius::Texels(texels) => (kind, texels, false),
        FilterRadius::Meters(meters) => (kind, meters, true),
    }
}
