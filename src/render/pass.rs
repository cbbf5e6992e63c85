//! The pass that draws one adopted map through Bevy's caster phase.

use bevy::{
    ecs::{
        entity::Entity,
        schedule::{
            IntoScheduleConfigs, Schedule, ScheduleBuildSettings, ScheduleLabel,
            common_conditions::resource_exists,
        },
        system::{Query, Res, ScheduleSystem},
        world::World,
    },
    log::error,
    pbr::{
        PreprocessPipelines, Shadow, allocate_uniforms, early_gpu_preprocess,
        main_build_indirect_parameters, unpack_bins,
    },
    render::{
        diagnostic::RecordDiagnostics,
        render_phase::{BinnedRenderPhase, ViewBinnedRenderPhases},
        render_resource::{
            LoadOp, Operations, RenderPassDepthStencilAttachment, RenderPassDescriptor, StoreOp,
            TextureView,
        },
        renderer::{RenderContext, ViewQuery},
        view::ExtractedView,
    },
};

use super::{
    PssmRenderSystems,
    hold::DrawnMaps,
    layout::AdoptedMap,
    moving::{draw_added, draw_both},
    second_view::{Over, SecondView},
    target::ShadowTarget,
};

/// Name under which `RenderDiagnosticsPlugin` reports map `i` of the target (the first camera's
/// cascades come first): `render/pssm_shadow_map_{i}/elapsed_gpu`, `…/vertex_shader_invocations`
/// and so on.
pub const SHADOW_PASS_SPAN: &str = "pssm_shadow_map";

/// As [`SHADOW_PASS_SPAN`], of what moves in a map.
pub const MOVING_PASS_SPAN: &str = "pssm_moving_casters";

/// The schedule that draws the map of one directional light's cascade.
#[derive(ScheduleLabel, Debug, Clone, PartialEq, Eq, Hash)]
pub struct DrawShadowMap;

/// The schedule that draws what a second view has over such a map.
#[derive(ScheduleLabel, Debug, Clone, PartialEq, Eq, Hash)]
pub(super) struct DrawSecondView;

/// The schedule of a map that casters are added to: those, and what moves in it.
#[derive(ScheduleLabel, Debug, Clone, PartialEq, Eq, Hash)]
pub(super) struct DrawAdded;

/// The schedule of a map in which something moves, and what rests is drawn anew: both, one after the other.
#[derive(ScheduleLabel, Debug, Clone, PartialEq, Eq, Hash)]
pub(super) struct DrawBoth;

pub(super) fn schedules() -> [Schedule; 4] {
    let mut both = Schedule::new(DrawBoth);
    both.add_systems(draw_both);
    let mut added = Schedule::new(DrawAdded);
    added.add_systems(draw_added);
    [
        map_schedule(
            DrawShadowMap,
            shadow_map_pass.in_set(PssmRenderSystems::DrawMaps),
        ),
        map_schedule(DrawSecondView, second_view_pass),
        both,
        added,
    ]
}

/// What a map takes: Bevy's preprocessing of what is in it, and the pass.
fn map_schedule<M>(
    label: impl ScheduleLabel,
    pass: impl IntoScheduleConfigs<ScheduleSystem, M>,
) -> Schedule {
    let mut schedule = Schedule::new(label);
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
            pass,
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
        target.resting(map.layer),
    ) else {
        return;
    };
    if map.skip_if_empty && phase.is_empty() {
        return;
    }
    // Reverse z: nothing is farther than 0.
    let load = LoadOp::Clear(0.0);
    let span = SHADOW_PASS_SPAN;
    draw(&mut ctx, world, entity, map, phase, layer, load, span);
}

/// Draws what is added to what a map holds over that, or what moves over a copy of it.
fn second_view_pass(
    world: &World,
    view: ViewQuery<(Entity, &SecondView, &ExtractedView)>,
    maps: Query<&AdoptedMap>,
    drawn: Res<DrawnMaps>,
    phases: Res<ViewBinnedRenderPhases<Shadow>>,
    target: Res<ShadowTarget>,
    mut ctx: RenderContext,
) {
    let (entity, second, extracted_view) = view.into_inner();
    let Ok(map) = maps.get(second.of) else {
        return;
    };
    let (layer, span) = match second.over {
        Over::Moving => (target.layer(map.layer), MOVING_PASS_SPAN),
        Over::Added => (target.resting(map.layer), SHADOW_PASS_SPAN),
    };
    let (Some(phase), Some(layer)) = (phases.get(&extracted_view.retained_view_entity), layer)
    else {
        return;
    };
    // Where nothing rests, nothing has been drawn.
    let load = if drawn.is_empty(second.of) {
        LoadOp::Clear(0.0)
    } else {
        if second.over == Over::Moving {
            target.copy_from_apart(ctx.command_encoder(), map.layer);
        }
        LoadOp::Load
    };
    draw(&mut ctx, world, entity, map, phase, layer, load, span);
}

/// Draws a phase into a map's layer.
fn draw(
    ctx: &mut RenderContext,
    world: &World,
    view: Entity,
    map: &AdoptedMap,
    phase: &BinnedRenderPhase<Shadow>,
    layer: &TextureView,
    load: LoadOp<f32>,
    name: &'static str,
) {
    let diagnostics = ctx.diagnostic_recorder();
    let diagnostics = diagnostics.as_deref();
    let mut pass = ctx.begin_tracked_render_pass(RenderPassDescriptor {
        label: Some(name),
        depth_stencil_attachment: Some(RenderPassDepthStencilAttachment {
            view: layer,
            depth_ops: Some(Operations {
                load,
                store: StoreOp::Store,
            }),
            stencil_ops: None,
        }),
        ..Default::default()
    });
    let span = diagnostics.pass_span(&mut pass, format!("{name}_{}", map.layer));
    let [width, height] = map.size.to_array();
    pass.set_viewport(0.0, 0.0, width as f32, height as f32, 0.0, 1.0);
    pass.set_scissor_rect(0, 0, width, height);
    if let Err(err) = phase.render(&mut pass, world, view) {
        error!("Could not draw shadow casters: {err:?}");
    }
    span.end(&mut pass);
}
