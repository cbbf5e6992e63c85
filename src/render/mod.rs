//! The render world: cascades drawn by a pass of the plugin's into its own depth target, and looked up
//! by its own shader module.
//!
//! While any light is managed, *all* maps that share Bevy's array texture move here:
//! managed cascades, those of other directional lights and spot lights' maps. The cameras' bindings
//! name one texture, so all must live in it.

mod added;
mod adopt;
mod displaced;
mod extract;
mod guests;
mod hold;
mod layout;
mod moving;
mod one_thread;
mod options;
mod pass;
mod pipelines;
mod second_view;
mod shader_features;
mod steps;
mod target;
mod uniform;

use steps::{AdoptStep, ChooseStep};

pub use layout::AdoptedMap;
pub use pass::{DrawShadowMap, SHADOW_PASS_SPAN, shadow_map_pass};
pub use target::ShadowTarget;

pub(crate) use extract::ExtractedShadows;

use bevy::{
    app::{App, PostUpdate},
    asset::AssetEventSystems,
    core_pipeline::schedule::{Core3d, Core3dSystems},
    ecs::schedule::{
        IntoScheduleConfigs, SystemSet,
        common_conditions::{resource_changed, resource_exists},
    },
    pbr::{
        GpuDirectionalLight, MAX_CASCADES_PER_LIGHT, MAX_DIRECTIONAL_LIGHTS,
        RenderMaterialInstances, extract_lights, main_build_indirect_parameters, prepare_lights,
    },
    render::{
        ExtractSchedule, GpuResourceAppExt, Render, RenderApp, RenderSystems,
        camera::DirtySpecializationSystems,
        render_resource::ShaderType,
        renderer::{RenderAdapterInfo, RenderDevice},
        settings::{Backends, WgpuFeatures},
    },
};

use crate::{
    config::MAX_CASCADES,
    shaders,
    support::{Obstacle, Requirements, ShadowSupport},
    systems::{DisplacedMeshes, EditedCasters, PssmSystems, UnplannedMaps},
};

/// The plugin's system sets in the render world.
#[derive(SystemSet, Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PssmRenderSystems {
    /// In `Render`, within `RenderSystems::CreateViews`. After this set, the views of managed
    /// lights' maps carry `AdoptedMap` and `ShadowTarget` has a layer for each.
    AdoptViews,
    /// In `Render`, within `RenderSystems::PhaseSort`. After this set, views whose maps stay as they are have left the
    /// frame, and the shader's data is on its way to the GPU.
    ChooseMaps,
    /// In `Core3d`. After this set, a spot light's map is drawn. (A cascade's is, before [`DrawShadowMap`] begins.)
    DrawMaps,
}

pub(crate) fn build(app: &mut App) {
    if app.get_sub_app(RenderApp).is_none() {
        return;
    }
    shaders::build(app);
    app.init_resource::<Requirements>().add_systems(
        PostUpdate,
        (shader_features::add_needed, shaders::replace_shadow_modules)
            .chain()
            .after(PssmSystems::ManageLights)
            .before(AssetEventSystems),
    );
    let support = app.world().resource::<ShadowSupport>().clone();
    let displaced = app.world().resource::<DisplacedMeshes>().clone();
    let edited = app.world().resource::<EditedCasters>().clone();
    let unplanned = app.world().resource::<UnplannedMaps>().clone();
    let Some(render_app) = app.get_sub_app_mut(RenderApp) else {
        return;
    };
    render_app
        .insert_resource(support)
        .insert_resource(displaced)
        .insert_resource(edited)
        .insert_resource(unplanned)
        .init_resource::<ExtractedShadows>()
        .init_resource::<pipelines::CompiledFeatures>()
        .init_gpu_resource::<ShadowTarget>()
        .init_gpu_resource::<hold::DrawnMaps>()
        .init_resource::<added::AddedViews>()
        .init_resource::<displaced::DisplacingTypes>()
        .init_resource::<moving::MovingViews>()
        .init_resource::<second_view::KeptPipelines>()
        .add_systems(
            ExtractSchedule,
            (
                extract::fill_missing_views
                    .run_if(extract::are_views_missing)
                    .before(extract_lights),
                extract::extract_shadows.after(DirtySpecializationSystems::CheckForChanges),
                pipelines::extract_shaders.run_if(pipelines::have_shaders_changed),
            ),
        )
        .add_systems(
            Render,
            (
                (
                    adopt::ready_lights
                        .in_set(RenderSystems::CreateViews)
                        .before(prepare_lights),
                    one_thread::run(AdoptStep).in_set(PssmRenderSystems::AdoptViews),
                    one_thread::run(ChooseStep).in_set(PssmRenderSystems::ChooseMaps),
                )
                    .run_if(steps::has_maps),
                guests::warn_of_guests
                    .run_if(guests::may_be_there)
                    .in_set(RenderSystems::Cleanup)
                    .after(RenderSystems::Render),
                pipelines::wait_for_pipelines
                    .run_if(resource_changed::<pipelines::CompiledFeatures>)
                    .after(RenderSystems::Queue)
                    .before(RenderSystems::Render),
                displaced::note_displaced_meshes
                    .in_set(RenderSystems::Queue)
                    .run_if(resource_exists::<RenderMaterialInstances>)
                    .run_if(displaced::are_possible),
            ),
        )
        .configure_sets(
            Render,
            (
                PssmRenderSystems::AdoptViews
                    .in_set(RenderSystems::CreateViews)
                    .after(prepare_lights),
                PssmRenderSystems::ChooseMaps.in_set(RenderSystems::PhaseSort),
            ),
        )
        .configure_sets(
            Core3d,
            // Earlier, GPU culling would not have built the draws yet.
            PssmRenderSystems::DrawMaps
                .after(main_build_indirect_parameters)
                .before(Core3dSystems::MainPass),
        )
        .add_systems(
            Core3d,
            shadow_map_pass
                .in_set(PssmRenderSystems::DrawMaps)
                .run_if(pass::are_spots_drawn),
        );
    for schedule in steps::schedules().into_iter().chain(pass::schedules()) {
        render_app.add_schedule(schedule);
    }
}

pub(crate) fn finish(app: &mut App) {
    let Some((limits, features)) = app
        .get_sub_app(RenderApp)
        .and_then(|render_app| render_app.world().get_resource::<RenderDevice>())
        .map(|device| (device.limits(), device.features()))
    else {
        return;
    };
    let support = app.world().resource::<ShadowSupport>();
    support.set_device(
        limits.max_texture_dimension_2d,
        features.contains(WgpuFeatures::DEPTH_CLIP_CONTROL),
    );
    let Requirements {
        array_layers: needed,
        light_bytes: expected,
    } = *app.world().resource::<Requirements>();
    let found = limits.max_texture_array_layers;
    if found < needed {
        support.refuse(Obstacle::ArrayLayers { found, needed });
    }
    if MAX_DIRECTIONAL_LIGHTS < 2 || MAX_CASCADES_PER_LIGHT < MAX_CASCADES {
        support.refuse(Obstacle::LightSlots {
            lights: MAX_DIRECTIONAL_LIGHTS,
            cascades: MAX_CASCADES_PER_LIGHT,
        });
    }
    let adapter = app
        .get_sub_app(RenderApp)
        .and_then(|render_app| render_app.world().get_resource::<RenderAdapterInfo>());
    if let Some(adapter) = adapter.filter(|adapter| Backends::from(adapter.backend) == Backends::GL)
    {
        support.refuse(Obstacle::DepthLoads(adapter.name.clone()));
    }
    let found = GpuDirectionalLight::min_size().get();
    if found != expected {
        support.refuse(Obstacle::LightBytes { found, expected });
    }
}
