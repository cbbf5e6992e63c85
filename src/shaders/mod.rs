//! The shader module that takes the place of `bevy_pbr::render::shadows`.
//!
//! Every shadow lookup in Bevy, forward, deferred, transmission and fog, goes through that
//! module. Point and spot lights and directional lights without our component must stay
//! exactly right, so the replacement *is* Bevy's text, with its directional functions renamed
//! and ours, which choose between the two, put in their place.

mod parts;

pub(crate) use parts::LeftToBevy;
pub use parts::ShaderParts;

use bevy::{
    app::{App, PostUpdate},
    asset::{AssetEventSystems, AssetServer, Assets, Handle},
    ecs::{
        resource::Resource,
        schedule::IntoScheduleConfigs,
        system::{Res, ResMut},
        world::{FromWorld, World},
    },
    log::error,
    render::RenderApp,
    shader::{Shader, ShaderDefVal, Source, load_shader_library},
};

use crate::{
    config::{GAUSSIAN_TEXELS, MAX_FILTER_TEXELS, TEMPORAL_TEXELS},
    debug::GRID_TEXELS,
    geometry::bias,
    render::GpuSupport,
    systems::PssmSystems,
};

/// Where Bevy keeps the module.
const STOCK_PATH: &str = "embedded://bevy_pbr/render/shadows.wesl";

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
const CONSTANTS: [(&str, u32); 23] = [
    ("PSSM_MARK", SLOT_MARK),
    ("PSSM_ROUNDING", bias::ROUNDING_RECIPROCAL),
    ("PSSM_EDGE_ON", bias::EDGE_ON_RECIPROCAL),
    ("PSSM_MOST_TEXELS", bias::MOST_TEXELS),
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
    slot::{is_managed, stock_uv_scale},
};
";

/// Functions of Bevy's module that ours take the names of.
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
        "return sample_stock_shadow_map(",
    ],
    [
        "return sample_shadow_map_pcss(",
        "return sample_stock_shadow_map_pcss(",
    ],
];

#[derive(Resource)]
pub(crate) struct ShadowModule {
    stock: Handle<Shader>,
    text: Option<Replacement>,
    compiled: Option<ShaderParts>,
}

/// The text that takes Bevy's place.
enum Replacement {
    Known(String),
    /// Bevy's is not the one of this release.
    Impossible,
}

impl FromWorld for ShadowModule {
    fn from_world(world: &mut World) -> Self {
        Self {
            stock: world.resource::<AssetServer>().load(STOCK_PATH),
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
    let left_to_bevy = LeftToBevy::default();
    if let Some(render_app) = app.get_sub_app_mut(RenderApp) {
        render_app.insert_resource(left_to_bevy.clone());
    }
    app.insert_resource(left_to_bevy);
    app.init_resource::<ShadowModule>().add_systems(
        PostUpdate,
        (parts::add_needed_parts, replace_shadow_module)
            .chain()
            .after(PssmSystems::ManageLights)
            .before(AssetEventSystems),
    );
}

/// Replaces the module as soon as it has loaded; sooner, the load would undo it. And again
/// whenever parts are added.
fn replace_shadow_module(
    mut module: ResMut<ShadowModule>,
    mut shaders: ResMut<Assets<Shader>>,
    parts: Res<ShaderParts>,
    support: Res<GpuSupport>,
) {
    if module.compiled == Some(*parts) || !support.shadows() {
        return;
    }
    let module = &mut *module;
    if module.text.is_none() {
        let Some(stock) = shaders.get(&module.stock) else {
            return;
        };
        let text = match &stock.source {
            Source::Wesl(text) => replacement_for(text),
            _ => None,
        };
        if text.is_none() {
            error!(
                "{STOCK_PATH} is not the one of Bevy 0.20: shadows of managed lights will be wrong"
            );
        }
        module.text = Some(text.map_or(Replacement::Impossible, Replacement::Known));
    }
    let Some(Replacement::Known(text)) = &module.text else {
        return;
    };
    let mut shader = Shader::from_wesl(text.clone(), STOCK_PATH);
    shader.shader_defs = shader_defs(*parts);
    if let Err(err) = shaders.insert(&module.stock, shader) {
        error!("Could not replace {STOCK_PATH}: {err}");
    }
    module.compiled = Some(*parts);
}

/// Constants that the library shares with Rust, the parts that are in, and the switch that makes
/// Bevy call `cascade_debug_visualization`.
pub fn shader_defs(parts: ShaderParts) -> Vec<ShaderDefVal> {
    let mut defs: Vec<ShaderDefVal> = CONSTANTS
        .iter()
        .map(|(name, value)| ShaderDefVal::UInt((*name).into(), *value))
        .collect();
    defs.extend(parts.defs());
    defs.extend([
        // Browsers reject derivatives where control flow may differ between pixels.
        ShaderDefVal::Bool("PSSM_DERIVATIVES".into(), cfg!(not(target_family = "wasm"))),
        ShaderDefVal::Bool(
            "DIRECTIONAL_LIGHT_SHADOW_MAP_DEBUG_CASCADES".into(),
            parts.overlays,
        ),
    ]);
    defs
}

/// The text that replaces Bevy's module of text `stock`; `None` if that lacks what is renamed
/// or redirected.
pub fn replacement_for(stock: &str) -> Option<String> {
    let mut text = stock.to_owned();
    for name in RENAMED {
        if !text.contains(&format!("fn {name}(")) {
            return None;
        }
        text = text.replace(&format!("{name}("), &format!("stock_{name}("));
    }
    for [from, to] in REDIRECTED {
        if !text.contains(from) {
            return None;
        }
        text = text.replace(from, to);
    }
    Some([IMPORTS, &text, include_str!("shadows.wesl")].concat())
}
