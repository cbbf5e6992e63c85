//! The pass that draws one adopted map through Bevy's caster phase.

use bevy::{
    core_pipeline::schedule::RootNonCameraView,
    ecs::{
        entity::Entity,
        query::With,
        schedule::{
            IntoScheduleConfigs, Schedule, ScheduleBuildSettings, ScheduleLabel,
            common_conditions::resource_exists,
        },
        system::{Commands, Query, Res, ScheduleSystem},
        world::World,
    },
    log::error,
    pbr::{
        LightEntity, PreprocessPipelines, Shadow, ViewLightEntities, allocate_uniforms,
        early_gpu_preprocess, main_build_indirect_parameters, unpack_bins,
    },
    render::{
        diagnostic::RecordDiagnostics,
        render_phase::{BinnedRenderPhase, ViewBinnedRenderPhases},
        render_resource::{
            LoadOp, Operations, RenderPassDepthStencilAttachment, RenderPassDescriptor, StoreOp,
            TextureView,
        },
        renderer::{CurrentView, RenderContext, ViewQuery},
        sync_world::TemporaryRenderEntity,
        view::ExtractedView,
    },
};

use super::{
    PssmRenderSystems,
    added::AddedViews,
    hold::DrawnMaps,
    layout::AdoptedMap,
    moving::MovingViews,
    second_view::{Over, SecondView},
    target::ShadowTarget,
};

/// Name under which `RenderDiagnosticsPlugin` reports map `i` of the target (the first camera's
/// cascades come first): `render/pssm_shadow_map_{i}/elapsed_gpu`, `…/vertex_shader_invocations`
/// and so on.
pub const SHADOW_PASS_SPAN: &str = "pssm_shadow_map";

/// As [`SHADOW_PASS_SPAN`], of what moves in a map.
pub const MOVING_PASS_SPAN: &str = "pssm_moving_casters";

/// The schedule that draws all maps that are drawn in a frame, but for spot lights'.
#[derive(ScheduleLabel, Debug, Clone, PartialEq, Eq, Hash)]
struct DrawShadowMaps;

/// Bevy's preprocessing of what is in them.
#[derive(ScheduleLabel, Debug, Clone, PartialEq, Eq, Hash)]
struct PreprocessCasters;

/// The schedule that draws the map of one directional light's cascade.
#[derive(ScheduleLabel, Debug, Clone, PartialEq, Eq, Hash)]
pub struct DrawShadowMap;

/// The schedule that draws what a second view has over such a map.
#[derive(ScheduleLabel, Debug, Clone, PartialEq, Eq, Hash)]
pub(super) struct DrawSecondView;

pub(super) fn schedules() -> [Schedule; 4] {
    let mut maps = Schedule::new(DrawShadowMaps);
    maps.add_systems(draw_maps);
    let preprocessing = (allocate_uniforms, unpack_bins, early_gpu_preprocess);
    [
        maps,
        schedule(PreprocessCasters, preprocessing.chain()),
        map_schedule(
            DrawShadowMap,
            shadow_map_pass.in_set(PssmRenderSystems::DrawMaps),
        ),
        map_schedule(DrawSecondView, second_view_pass),
    ]
}

/// What a map takes: its draws, and the pass.
fn map_schedule<M>(
    label: impl ScheduleLabel,
    pass: impl IntoScheduleConfigs<ScheduleSystem, M>,
) -> Schedule {
    let draws = main_build_indirect_parameters.run_if(resource_exists::<PreprocessPipelines>);
    schedule(label, (draws, pass).chain())
}

fn schedule<M>(
    label: impl ScheduleLabel,
    systems: impl IntoScheduleConfigs<ScheduleSystem, M>,
) -> Schedule {
    let mut schedule = Schedule::new(label);
    schedule.set_build_settings(ScheduleBuildSettings {
        auto_insert_apply_deferred: false,
        ..Default::default()
    });
    schedule.add_systems(systems);
    schedule
}

/// Makes the root that all maps of the frame are drawn from, so that Bevy preprocesses what is in them together: maps' own
/// views, or those of what is added, each followed by the one of what moves over it.
pub(super) fn collect_drawn_views(
    mut commands: Commands,
    maps: Query<(Entity, &LightEntity), With<AdoptedMap>>,
    drawn: Res<DrawnMaps>,
    added: Res<AddedViews>,
    moving: Res<MovingViews>,
) {
    let mut lights = Vec::new();
    for (map, light) in &maps {
        if !matches!(light, LightEntity::Directional { .. }) {
            continue;
        }
        if drawn.is_added_to(map) {
            lights.extend(added.view(map));
        } else if !drawn.is_held(map) {
            lights.push(map);
        }
        lights.extend(moving.drawn_view(map));
    }
    if !lights.is_empty() {
        commands.spawn((
            RootNonCameraView(DrawShadowMaps.intern()),
            ViewLightEntities { lights },
            TemporaryRenderEntity::default(),
        ));
    }
}

fn draw_maps(world: &mut World) {
    let Some(root) = world.get_resource::<CurrentView>().copied() else {
        return;
    };
    if world.contains_resource::<PreprocessPipelines>() {
        world.run_schedule(PreprocessCasters);
    }
    let views = world.get::<ViewLightEntities>(root.0);
    for view in views.map(|it| it.lights.clone()).unwrap_or_default() {
        world.insert_resource(CurrentView(view));
        if world.get::<SecondView>(view).is_some() {
            world.run_schedule(DrawSecondView);
        } else {
            world.run_schedule(DrawShadowMap);
        }
    }
    world.insert_resource(root);
}

/// Draws the map of the current view, if the plugin has adopted it. Runs in [`DrawShadowMap`], and for
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
