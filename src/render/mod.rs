//! The render world: cascades drawn by an own pass into an own depth target, sampled by an own
//! shader module.
//!
//! While any light is managed, *all* maps that share Bevy's array texture move here: our
//! cascades, those of other directional lights and spot lights' maps. The cameras' bindings
//! name one texture, so all must live in it.

mod adopt;
mod extract;
mod options;
mod pass;
mod uniform;

pub use adopt::{AdoptedMap, ShadowTarget};
pub use pass::{SHADOW_PASS_SPAN, shadow_map_pass};

pub(crate) use extract::ExtractedShadows;

use bevy::{
    app::App,
    core_pipeline::schedule::{Core3d, Core3dSystems},
    ecs::{
        resource::Resource,
        schedule::{IntoScheduleConfigs, SystemSet},
    },
    log::warn,
    pbr::{
        MAX_CASCADES_PER_LIGHT, MAX_DIRECTIONAL_LIGHTS, extract_lights,
        main_build_indirect_parameters, prepare_lights,
    },
    render::{
        ExtractSchedule, GpuResourceAppExt, Render, RenderApp, RenderSystems,
        renderer::RenderDevice, settings::WgpuFeatures,
    },
};

use crate::{
    config::{MAX_CASCADES, MaxMapSize},
    shaders,
};

/// The plugin's system sets in the render world.
#[derive(SystemSet, Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PssmRenderSystems {
    /// In `Render`, within `RenderSystems::PrepareViews`. After this set, the views of managed
    /// lights' maps carry [`AdoptedMap`] and [`ShadowTarget`] has a layer for each.
    AdoptViews,
    /// In `Render`, within `RenderSystems::PrepareResources`. After this set, the shader's data
    /// is on its way to the GPU.
    WriteUniforms,
    /// In `Core3d`. After this set, all maps are drawn.
    DrawMaps,
}

/// Whether the GPU can hold our maps.
#[derive(Resource, Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct GpuSupport {
    layers: u32,
    depth_clip_control: bool,
}

impl Default for GpuSupport {
    fn default() -> Self {
        // Without a renderer (servers, tests) planning goes on as though there were one.
        Self {
            layers: u32::MAX,
            depth_clip_control: true,
        }
    }
}

impl GpuSupport {
    /// An array texture needs room for one light's cascades at least, and the uniform for a
    /// light and its data; WebGL2 has neither.
    pub(crate) fn shadows(self) -> bool {
        MAX_DIRECTIONAL_LIGHTS > 1
            && MAX_CASCADES_PER_LIGHT >= MAX_CASCADES
            && self.layers >= MAX_CASCADES as u32
    }

    /// Bevy's stand-in for unclipped depth does not divide by w.
    pub(crate) fn warps(self) -> bool {
        self.depth_clip_control
    }
}

pub(crate) fn build(app: &mut App) {
    if app.get_sub_app(RenderApp).is_none() {
        return;
    }
    shaders::build(app);
    let Some(render_app) = app.get_sub_app_mut(RenderApp) else {
        return;
    };
    render_app
        .init_resource::<ExtractedShadows>()
        .init_gpu_resource::<ShadowTarget>()
        .add_systems(
            ExtractSchedule,
            (
                extract::fill_missing_views.before(extract_lights),
                extract::extract_shadows,
            ),
        )
        .add_systems(
            Render,
            (
                (adopt::forgo_occlusion_culling, adopt::shrink_stock_maps)
                    .in_set(RenderSystems::CreateViews)
                    .before(prepare_lights),
                adopt::adopt_views.in_set(PssmRenderSystems::AdoptViews),
                uniform::write_uniforms.in_set(PssmRenderSystems::WriteUniforms),
            ),
        )
        .configure_sets(
            Render,
            (
                PssmRenderSystems::AdoptViews
                    .in_set(RenderSystems::PrepareViews)
                    .after(prepare_lights),
                PssmRenderSystems::WriteUniforms.in_set(RenderSystems::PrepareResources),
            ),
        )
        .configure_sets(
            Core3d,
            // Earlier, GPU culling would not have built the draws yet.
            PssmRenderSystems::DrawMaps
                .after(main_build_indirect_parameters)
                .before(Core3dSystems::MainPass),
        )
        .add_systems(Core3d, shadow_map_pass.in_set(PssmRenderSystems::DrawMaps));
}

pub(crate) fn finish(app: &mut App) {
    let Some((limits, features)) = app
        .get_sub_app(RenderApp)
        .and_then(|render_app| render_app.world().get_resource::<RenderDevice>())
        .map(|device| (device.limits(), device.features()))
    else {
        return;
    };
    app.world()
        .resource::<MaxMapSize>()
        .set(limits.max_texture_dimension_2d);
    let support = GpuSupport {
        layers: limits.max_texture_array_layers,
        depth_clip_control: features.contains(WgpuFeatures::DEPTH_CLIP_CONTROL),
    };
    if !support.shadows() {
        warn!("This GPU has no array textures: Bevy's own shadows stay in force");
    }
    app.insert_resource(support);
}
