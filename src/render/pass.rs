//! The pass that draws one adopted map through Bevy's caster phase.

use bevy::{
    ecs::{
        entity::Entity,
        schedule::{
            IntoScheduleConfigs, Schedule, ScheduleBuildSettings, ScheduleLabel,
            common_conditions::resource_exists,
        },
        system::Res,
        world::World,
    },
    log::error,
    pbr::{
        PreprocessPipelines, Shadow, allocate_uniforms, early_gpu_preprocess,
        main_build_indirect_parameters, unpack_bins,
    },
    render::{
        diagnostic::RecordDiagnostics,
        render_phase::ViewBinnedRenderPhases,
        render_resource::{
            LoadOp, Operations, RenderPassDepthStencilAttachment, RenderPassDescriptor, StoreOp,
        },
        renderer::{RenderContext, ViewQuery},
        view::ExtractedView,
    },
};

use super::{PssmRenderSystems, layout::AdoptedMap, target::ShadowTarget};

/// Name under which `RenderDiagnosticsPlugin` reports map `i` of the target (the first camera's
/// cascades come first): `render/pssm_shadow_map_{i}/elapsed_gpu`, `…/vertex_shader_invocations`
/// and so on.
pub const SHADOW_PASS_SPAN: &str = "pssm_shadow_map";

/// The schedule that draws the map of one directional light's cascade.
#[derive(ScheduleLabel, Debug, Clone, PartialEq, Eq, Hash)]
pub struct DrawShadowMap;

/// What a map takes: Bevy's preprocessing of what is in it, and the pass.
pub(super) fn schedule() -> Schedule {
    let mut schedule = Schedule::new(DrawShadowMap);
    schedule.set_build_settings(ScheduleBuildSettings {
        auto_insert_apply_deferred: false,
        ..Default::default()
    });
    let preprocessing = (
        allocate_uniforms,
        unpack_bins,
        early_gpu_preprocess,
        main_build_indirect_parameters,
    );
    schedule.add_systems(
        (
            preprocessing
                .chain()
                .run_if(resource_exists::<PreprocessPipelines>),
            shadow_map_pass.in_set(PssmRenderSystems::DrawMaps),
        )
            .chain(),
    );
    schedule
}

/// Draws the map of the current root view, if the plugin has adopted it. Runs in [`DrawShadowMap`], and for
/// spot lights in `Core3d`.
pub fn shadow_map_pass(
    world: &World,
    view: ViewQuery<(Entity, &AdoptedMap, &ExtractedView)>,
    phases: Res<ViewBinnedRenderPhases<Shadow>>,
    target: Res<ShadowTarget>,
    mut ctx: RenderContext,
) {
    let (entity, map, extracted_view) = view.into_inner();
    let (Some(phase), Some(layer)) = (
        phases.get(&extracted_view.retained_view_entity),
        target.layer(map.layer),
    ) else {
        return;
    };
    if map.skip_if_empty && phase.is_empty() {
        return;
    }

    let diagnostics = ctx.diagnostic_recorder();
    let diagnostics = diagnostics.as_deref();
    let mut pass = ctx.begin_tracked_render_pass(RenderPassDescriptor {
        label: Some(SHADOW_PASS_SPAN),
        depth_stencil_attachment: Some(RenderPassDepthStencilAttachment {
            view: layer,
            // Reverse z: nothing is farther than 0.
            depth_ops: Some(Operations {
                load: LoadOp::Clear(0.0),
                store: StoreOp::Store,
            }),
            stencil_ops: None,
        }),
        ..Default::default()
    });
    let span = diagnostics.pass_span(&mut pass, format!("{SHADOW_PASS_SPAN}_{}", map.layer));
    let [width, height] = map.size.to_array();
    pass.set_viewport(0.0, 0.0, width as f32, height as f32, 0.0, 1.0);
    pass.set_scissor_rect(0, 0, width, height);
    if let Err(err) = phase.render(&mut pass, world, entity) {
        error!("Could not draw shadow casters: {err:?}");
    }
    span.end(&mut pass);
}
