//! The shader module that takes the place of `bevy_pbr::render::shadows`.
//!
//! Every shadow lookup in Bevy, forward, deferred, transmission and fog, goes through that
//! module. Point and spot lights and directional lights without our component must stay
//! exactly right, so the replacement *is* Bevy's text, with its directional functions renamed
//! and ours, which choose between the two, put in their place.

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

use crate::render::GpuSupport;

/// Where Bevy keeps the module.
const STOCK_PATH: &str = "embedded://bevy_pbr/render/shadows.wesl";

/// Marks the uniform slot that holds our data: no component of a direction is this large.
pub(crate) const SLOT_MARK: u32 = 20_607;

const IMPORTS: &str = "
import bevy_pssm::shaders::{
    directional::{
        cascade_at_depth, cascade_tint, fetch_split_shadow, fog_lookup, sample_first_covering,
    },
    slot::{is_managed, stock_uv_scale, tints_cascades},
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
    replaced: bool,
}

impl FromWorld for ShadowModule {
    fn from_world(world: &mut World) -> Self {
        Self {
            stock: world.resource::<AssetServer>().load(STOCK_PATH),
            replaced: false,
        }
    }
}

pub(crate) fn build(app: &mut App) {
    load_shader_library!(app, "slot.wesl");
    load_shader_library!(app, "directional.wesl");
    app.init_resource::<ShadowModule>();
}

/// Replaces the module as soon as it has loaded; sooner, the load would undo it.
pub(crate) fn replace_shadow_module(
    mut module: ResMut<ShadowModule>,
    mut shaders: ResMut<Assets<Shader>>,
    support: Res<GpuSupport>,
) {
    if module.replaced || !support.shadows() {
        return;
    }
    let Some(stock) = shaders.get(&module.stock) else {
        return;
    };
    module.replaced = true;
    let replacement = match &stock.source {
        Source::Wesl(text) => replacement_for(text),
        _ => None,
    };
    let Some(text) = replacement else {
        error!("{STOCK_PATH} is not the one of Bevy 0.20: shadows of managed lights will be wrong");
        return;
    };
    let mut shader = Shader::from_wesl(text, STOCK_PATH);
    shader.shader_defs = shader_defs();
    if let Err(err) = shaders.insert(&module.stock, shader) {
        error!("Could not replace {STOCK_PATH}: {err}");
    }
}

/// Constants that the library shares with Rust, and the switch that makes Bevy call
/// `cascade_debug_visualization`.
pub fn shader_defs() -> Vec<ShaderDefVal> {
    vec![
        ShaderDefVal::UInt("PSSM_MARK".into(), SLOT_MARK),
        ShaderDefVal::Bool("DIRECTIONAL_LIGHT_SHADOW_MAP_DEBUG_CASCADES".into(), true),
    ]
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
