//! The shader module that takes the place of `bevy_pbr::render::shadows`.
//!
//! Every shadow lookup in Bevy, forward, deferred, transmission and fog, goes through that
//! module. Point and spot lights and directional lights without our component must stay
//! exactly right, so the replacement *is* Bevy's text: its directional functions are renamed, and the
//! plugin's, which choose between the two, take their names.

mod features;

pub use features::ShaderFeatures;

use bevy::{
    app::App,
    asset::{AssetServer, Assets, Handle},
    ecs::{
        resource::Resource,
        system::{Res, ResMut},
        world::{FromWorld, World},
    },
    log::error,
    shader::{Shader, ShaderDefVal, Source, load_shader_library},
};

use crate::{
    config::{GAUSSIAN_TEXELS, MAX_FILTER_TEXELS, TEMPORAL_TEXELS},
    debug::GRID_TEXELS,
    geometry::bias,
    support::{Obstacle, ShadowSupport},
};

/// Where Bevy keeps the module.
const BUILT_IN_PATH: &str = "embedded://bevy_pbr/render/shadows.wesl";

/// Marks the uniform slot that holds our data: no component of a direction is this large.
pub(crate) const SLOT_MARK: u32 = 20_607;

/// Variants of the configuration, as the shader knows them.
pub(crate) mod code {
    pub const BIAS_AUTOMATIC: u32 = 0;
    pub const BIAS_CONSTANT: u32 = 1;
    pub const BIAS_SLOPE_SCALED: u32 = 2;
    pub const BIAS_NORMAL_OFFSET: u32 = 3;
    pub const BIAS_RECEIVER_PLANE: u32 = 4;

    pub const FILTER_CAMERA: u32 = 0;
    pub const FILTER_HARDWARE: u32 = 1;
    pub const FILTER_TENT: u32 = 2;
    pub const FILTER_TEMPORAL: u32 = 3;
    pub const FILTER_SOFT: u32 = 4;

    /// Overlays from here on take the light's place.
    pub const OVERLAY_TINT: u32 = 1;
    pub const OVERLAY_LIGHT: u32 = 2;
    pub const OVERLAY_CASCADE: u32 = 3;
    pub const OVERLAY_BIAS: u32 = 4;
    pub const OVERLAY_TEXELS: u32 = 5;
    pub const OVERLAY_GRID: u32 = 6;
}

/// Constants of the library, `constants::…` there. Fractions by their reciprocals.
const CONSTANTS: [(&str, u32); 26] = [
    ("PSSM_MARK", SLOT_MARK),
    ("PSSM_ROUNDING", bias::ROUNDING_RECIPROCAL),
    ("PSSM_EDGE_ON", bias::EDGE_ON_RECIPROCAL),
    ("PSSM_BEND", bias::BEND_RECIPROCAL),
    ("PSSM_FACETS", bias::FACETS),
    ("PSSM_STEEPEST", bias::STEEPEST_SLOPE),
    ("PSSM_STEEP", bias::STEEP_SLOPE),
    ("PSSM_CORNER", bias::CORNER_SLOPE),
    ("PSSM_MAX_FILTER_TEXELS", MAX_FILTER_TEXELS as u32),
    (
        "PSSM_GAUSSIAN_HUNDREDTHS",
        (100.0 * GAUSSIAN_TEXELS).round() as u32,
    ),
    (
        "PSSM_TEMPORAL_HUNDREDTHS",
        (100.0 * TEMPORAL_TEXELS).round() as u32,
    ),
    ("PSSM_BIAS_AUTOMATIC", code::BIAS_AUTOMATIC),
    ("PSSM_BIAS_SLOPE_SCALED", code::BIAS_SLOPE_SCALED),
    ("PSSM_BIAS_NORMAL_OFFSET", code::BIAS_NORMAL_OFFSET),
    ("PSSM_BIAS_RECEIVER_PLANE", code::BIAS_RECEIVER_PLANE),
    ("PSSM_FILTER_HARDWARE", code::FILTER_HARDWARE),
    ("PSSM_FILTER_TENT", code::FILTER_TENT),
    ("PSSM_FILTER_TEMPORAL", code::FILTER_TEMPORAL),
    ("PSSM_FILTER_SOFT", code::FILTER_SOFT),
    ("PSSM_OVERLAY_TINT", code::OVERLAY_TINT),
    ("PSSM_OVERLAY_LIGHT", code::OVERLAY_LIGHT),
    ("PSSM_OVERLAY_CASCADE", code::OVERLAY_CASCADE),
    ("PSSM_OVERLAY_BIAS", code::OVERLAY_BIAS),
    ("PSSM_OVERLAY_TEXELS", code::OVERLAY_TEXELS),
    ("PSSM_OVERLAY_GRID", code::OVERLAY_GRID),
    ("PSSM_GRID_TEXELS", GRID_TEXELS),
];

const IMPORTS: &str = "
import bevy_pssm::shaders::{
    directional::{
        cascade_at_depth, cascade_overlay, fetch_split_shadow, fog_lookup, sample_from_cascade,
    },
    slot::{is_managed, built_in_uv_scale},
};
";

/// Functions of Bevy's module whose names the plugin's take.
const RENAMED: [&str; 5] = [
    "get_cascade_index",
    "world_to_directional_light_local",
    "sample_directional_cascade",
    "fetch_directional_shadow",
    "cascade_debug_visualization",
];

/// Lookups of spot lights and of Bevy's directional lights, which may have to be scaled.
const REDIRECTED: [[&str; 2]; 2] = [
    [
        "return sample_shadow_map(",
        "return sample_built_in_shadow_map(",
    ],
    [
        "return sample_shadow_map_pcss(",
        "return sample_built_in_shadow_map_pcss(",
    ],
];

#[derive(Resource)]
pub(crate) struct ShadowModule {
    built_in: Handle<Shader>,
    /// The text that takes its place.
    text: Option<String>,
    compiled: Option<ShaderFeatures>,
}

impl FromWorld for ShadowModule {
    fn from_world(world: &mut World) -> Self {
        Self {
            built_in: world.resource::<AssetServer>().load(BUILT_IN_PATH),
            text: None,
            compiled: None,
        }
    }
}

pub(crate) fn build(app: &mut App) {
    load_shader_library!(app, "slot.wesl");
    load_shader_library!(app, "receiver.wesl");
    load_shader_library!(app, "filter.wesl");
    load_shader_library!(app, "overlay.wesl");
    load_shader_library!(app, "directional.wesl");
    app.init_resource::<ShadowModule>();
}

/// Replaces the module as soon as it has loaded; sooner, the load would undo it. And again
/// whenever features are added.
pub(crate) fn replace_shadow_module(
    mut module: ResMut<ShadowModule>,
    mut shaders: ResMut<Assets<Shader>>,
    features: Res<ShaderFeatures>,
    support: Res<ShadowSupport>,
) {
    // Once replaced, the module has to follow what lights need, Bevy's own lookups included.
    let is_refused = !support.may_take_over() && module.compiled.is_none();
    if module.compiled == Some(*features) || is_refused {
        return;
    }
    let module = &mut *module;
    if module.text.is_none() {
        let Some(built_in) = shaders.get(&module.built_in) else {
            return;
        };
        let text = match &built_in.source {
            Source::Wesl(text) => replacement_for(text),
            _ => Err("WESL".to_owned()),
        };
        match text {
            Ok(text) => module.text = Some(text),
            Err(missing) => support.refuse(Obstacle::ShaderModule {
                path: BUILT_IN_PATH,
                missing,
            }),
        }
    }
    let Some(text) = &module.text else {
        return;
    };
    let mut shader = Shader::from_wesl(text.clone(), BUILT_IN_PATH);
    shader.shader_defs = shader_defs(*features);
    if let Err(err) = shaders.insert(&module.built_in, shader) {
        error!("Could not replace {BUILT_IN_PATH}: {err}");
    }
    module.compiled = Some(*features);
}

/// Constants that the library shares with Rust, the features that are in, and the switch that makes
/// Bevy call `cascade_debug_visualization`.
pub fn shader_defs(features: ShaderFeatures) -> Vec<ShaderDefVal> {
    let mut defs: Vec<ShaderDefVal> = CONSTANTS
        .iter()
        .map(|(name, value)| ShaderDefVal::UInt((*name).into(), *value))
        .collect();
    defs.extend(features.defs());
    defs.extend([
        // Browsers reject derivatives where control flow may differ between pixels.
        ShaderDefVal::Bool("PSSM_DERIVATIVES".into(), cfg!(not(target_family = "wasm"))),
        ShaderDefVal::Bool(
            "DIRECTIONAL_LIGHT_SHADOW_MAP_DEBUG_CASCADES".into(),
            features.overlays,
        ),
    ]);
    defs
}

/// The text that replaces Bevy's module of text `built_in`.
///
/// # Errors
/// What that lacks of what is renamed or redirected.
pub fn replacement_for(built_in: &str) -> Result<String, String> {
    let mut text = built_in.to_owned();
    for name in RENAMED {
        let function = format!("fn {name}(");
        if !text.contains(&function) {
            return Err(function);
        }
        text = text.replace(&format!("{name}("), &format!("built_in_{name}("));
    }
    for [from, to] in REDIRECTED {
        if !text.contains(from) {
            return Err(from.to_owned());
        }
        text = text.replace(from, to);
    }
    Ok([IMPORTS, &text, include_str!("shadows.wesl")].concat())
}
