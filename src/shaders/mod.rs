//! The shader modules that take the places of `bevy_pbr::render::shadows` and `shadow_sampling`.
//!
//! Every shadow lookup in Bevy, forward, deferred, transmission and fog, goes through those
//! modules. Point and spot lights and directional lights without our component must stay
//! exactly right, so the replacements *are* Bevy's texts: some functions are renamed, and the plugin's,
//! which choose between the two, take their names.

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
    pub const OVERLAY_AGE: u32 = 7;
}

/// Constants of the library, `constants::…` there. Fractions by their reciprocals.
const CONSTANTS: [(&str, u32); 27] = [
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
    ("PSSM_OVERLAY_AGE", code::OVERLAY_AGE),
    ("PSSM_GRID_TEXELS", GRID_TEXELS),
];

/// A module of Bevy's, and what takes its place.
struct Replacement {
    /// Where Bevy keeps it.
    path: &'static str,
    imports: &'static str,
    /// Functions whose names the plugin's take.
    renamed: &'static [&'static str],
    /// The plugin's.
    functions: &'static str,
}

impl Replacement {
    /// The text that takes a module's place.
    fn apply(&self, built_in: &Shader) -> Result<String, Obstacle> {
        let lacks = |missing: String| Obstacle::ShaderModule {
            path: self.path,
            missing,
        };
        let Source::Wesl(text) = &built_in.source else {
            return Err(lacks("WESL".to_owned()));
        };
        let mut text = text.to_string();
        for name in self.renamed {
            let function = format!("fn {name}(");
            if !text.contains(&function) {
                return Err(lacks(function));
            }
            text = text.replace(&format!("{name}("), &format!("built_in_{name}("));
        }
        Ok([self.imports, &text, self.functions].concat())
    }
}

const REPLACEMENTS: [Replacement; 2] = [
    Replacement {
        path: "embedded://bevy_pbr/render/shadows.wesl",
        imports: "
import bevy_pssm::shaders::{
    directional::{
        cascade_at_depth, cascade_overlay, fetch_split_shadow, fog_lookup, sample_from_cascade,
    },
    slot::is_managed,
};
",
        renamed: &[
            "get_cascade_index",
            "world_to_directional_light_local",
            "sample_directional_cascade",
            "fetch_directional_shadow",
            "cascade_debug_visualization",
        ],
        functions: include_str!("shadows.wesl"),
    },
    Replacement {
        path: "embedded://bevy_pbr/render/shadow_sampling.wesl",
        imports: "
import bevy_pssm::shaders::slot::built_in_uv_scale;
",
        renamed: &[
            "sample_shadow_map_hardware",
            "sample_shadow_map_castano_thirteen",
            "sample_shadow_map_jimenez_fourteen",
            "sample_shadow_map",
            "sample_shadow_map_pcss",
            "search_for_blockers_in_shadow_map_hardware",
            "search_for_blockers_in_shadow_map",
        ],
        functions: include_str!("shadow_sampling.wesl"),
    },
];

#[derive(Resource)]
pub(crate) struct ShadowModules {
    built_in: [Handle<Shader>; 2],
    /// The texts that take their places.
    texts: Option<[String; 2]>,
    compiled: Option<ShaderFeatures>,
}

impl ShadowModules {
    /// The features that the modules have been replaced with, if they have.
    pub fn compiled(&self) -> Option<ShaderFeatures> {
        self.compiled
    }
}

impl FromWorld for ShadowModules {
    fn from_world(world: &mut World) -> Self {
        let assets = world.resource::<AssetServer>();
        Self {
            built_in: REPLACEMENTS.map(|it| assets.load(it.path)),
            texts: None,
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
    app.init_resource::<ShadowModules>();
}

/// Replaces the modules as soon as they have loaded; sooner, the load would undo it. And again
/// whenever features are added.
pub(crate) fn replace_shadow_modules(
    mut modules: ResMut<ShadowModules>,
    mut shaders: ResMut<Assets<Shader>>,
    features: Res<ShaderFeatures>,
    support: Res<ShadowSupport>,
) {
    // Once replaced, the modules have to follow what lights need, Bevy's own lookups included.
    let is_refused = !support.may_take_over() && modules.compiled.is_none();
    if modules.compiled == Some(*features) || is_refused {
        return;
    }
    let modules = &mut *modules;
    if modules.texts.is_none() {
        let [Some(lookups), Some(samples)] = modules.built_in.each_ref().map(|it| shaders.get(it))
        else {
            return;
        };
        let [of_lookups, of_samples] = &REPLACEMENTS;
        match (of_lookups.apply(lookups), of_samples.apply(samples)) {
            (Ok(lookups), Ok(samples)) => modules.texts = Some([lookups, samples]),
            (Err(obstacle), _) | (_, Err(obstacle)) => support.refuse(obstacle),
        }
    }
    let Some(texts) = &modules.texts else {
        return;
    };
    let modules_and_texts = modules.built_in.iter().zip(texts);
    for ((built_in, text), Replacement { path, .. }) in modules_and_texts.zip(REPLACEMENTS) {
        let mut shader = Shader::from_wesl(text.clone(), path);
        shader.shader_defs = shader_defs(*features);
        if let Err(err) = shaders.insert(built_in, shader) {
            error!("Could not replace {path}: {err}");
        }
    }
    modules.compiled = Some(*features);
}

/// Constants that the library shares with Rust, the features that are in, and the switch that makes
/// Bevy call `cascade_debug_visualization`.
pub fn shader_defs(features: ShaderFeatures) -> Vec<ShaderDefVal> {
    let mut defs: Vec<ShaderDefVal> = CONSTANTS
        .iter()
        .map(|(name, value)| ShaderDefVal::UInt((*name).into(), *value))
        .collect();
    defs.extend(features.defs());
    defs.push(ShaderDefVal::Bool(
        "DIRECTIONAL_LIGHT_SHADOW_MAP_DEBUG_CASCADES".into(),
        features.overlays,
    ));
    defs
}
