//! Drawing adopted maps through Bevy's caster phase.

use bevy::{
    core_pipeline::schedule::RootNonCameraView,
    ecs::{
        entity::Entity,
        query::{With, Without},
        schedule::{IntoScheduleConfigs, Schedule, ScheduleLabel, Schedules},
        system::{Commands, Query, Res, SystemParam, SystemState},
        world::World,
    },
    log::error,
    pbr::{
        BuildIndirectParametersBindGroups, LightEntity, PreprocessPipelines, Shadow, ShadowView,
        ViewLightEntities, allocate_uniforms, early_gpu_preprocess, main_build_indirect_parameters,
        unpack_bins,
    },
    render::{
        batching::gpu_preprocessing::{BuildIndirectParametersMetadata, IndirectParametersBuffers},
        diagnostic::{DiagnosticsRecorder, RecordDiagnostics},
        render_phase::{BinnedRenderPhase, ViewBinnedRenderPhases},
        render_resource::{
            LoadOp, Operations, PipelineCache, RenderPassDepthStencilAttachment,
            RenderPassDescriptor, StoreOp, TextureView,
        },
        renderer::{CurrentView, RenderContext, ViewQuery},
        sync_world::TemporaryRenderEntity,
        view::ExtractedView,
    },
    tasks::ComputeTaskPool,
};

use super::{
    added::AddedViews,
    hold::{DrawnMaps, note_whole_maps},
    layout::AdoptedMap,
    moving::MovingViews,
    one_thread::schedule,
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

/// The schedule in which other crates draw into the map of one directional light's cascade: the current view is the
/// map's, which has been drawn.
#[derive(ScheduleLabel, Debug, Clone, PartialEq, Eq, Hash)]
pub struct DrawShadowMap;

pub(super) fn schedules() -> [Schedule; 3] {
    let preprocessing = (allocate_uniforms, unpack_bins, early_gpu_preprocess);
    [
        schedule(DrawShadowMaps, (draw_maps, note_whole_maps).chain()),
        schedule(PreprocessCasters, preprocessing.chain()),
        Schedule::new(DrawShadowMap),
    ]
}

/// Whether there are maps that are drawn in `Core3d`.
pub(super) fn are_spots_drawn(maps: Query<&AdoptedMap>) -> bool {
    maps.iter().any(|map| map.spot_index.is_some())
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

/// Draws all maps of a frame: with one command encoder, unless others draw into them too.
fn draw_maps(world: &mut World, pass: &mut SystemState<MapPass>) {
    let Some(root) = world.get_resource::<CurrentView>().copied() else {
        return;
    };
    let schedules = world.resource::<Schedules>();
    let guests = schedules.get(DrawShadowMap);
    let has_guests = guests.is_some_and(|guests| guests.systems_len() > 0);
    let views = world.get::<ViewLightEntities>(root.0);
    let views = views.map(|it| it.lights.clone()).unwrap_or_default();
    let at_once = if has_guests { 1 } else { views.len() };
    for (index, views) in views.chunks(at_once.max(1)).enumerate() {
        let is_recorded = world.contains_resource::<DiagnosticsRecorder>();
        let mut draw = || {
            if index == 0 {
                preprocess(world);
            }
            views.iter().for_each(|view| draw_view(world, pass, *view));
        };
        if is_recorded {
            on_another_thread(draw);
        } else {
            draw();
        }
        if has_guests
            && views
                .iter()
                .all(|it| world.get::<SecondView>(*it).is_none())
        {
            pass.apply(world);
            world.run_schedule(DrawShadowMap);
        }
    }
    pass.apply(world);
    world.insert_resource(root);
}

/// Spans are named after those that are open on their thread, and Bevy has one open about all views that are no
/// camera's.
fn on_another_thread(run: impl FnOnce() + Send) {
    ComputeTaskPool::get().scope_with_executor(false, None, |scope| {
        scope.spawn(async { run() });
    });
}

fn preprocess(world: &mut World) {
    if world.contains_resource::<PreprocessPipelines>() {
        world.run_schedule(PreprocessCasters);
    }
}

fn draw_view(world: &mut World, pass: &mut SystemState<MapPass>, view: Entity) {
    world.insert_resource(CurrentView(view));
    if let Ok(pass) = pass.get(world) {
        pass.build_draws();
    }
    if let Ok(pass) = pass.get(world) {
        pass.draw(world, view);
    }
}

/// What it takes to draw the current view's map.
#[derive(SystemParam)]
struct MapPass<'w, 's> {
    view: ViewQuery<'w, 's, &'static ExtractedView, Without<ShadowView>>,
    preprocessing: Option<Res<'w, PreprocessPipelines>>,
    bind_groups: Option<Res<'w, BuildIndirectParametersBindGroups>>,
    cache: Res<'w, PipelineCache>,
    buffers: Option<Res<'w, IndirectParametersBuffers>>,
    metadata: Option<Res<'w, BuildIndirectParametersMetadata>>,
    maps: Query<'w, 's, &'static AdoptedMap>,
    second_views: Query<'w, 's, &'static SecondView>,
    drawn: Res<'w, DrawnMaps>,
    phases: Res<'w, ViewBinnedRenderPhases<Shadow>>,
    target: Res<'w, ShadowTarget>,
    ctx: RenderContext<'w, 's>,
}

impl MapPass<'_, '_> {
    /// Has Bevy build the view's draws. It may only do so when those of the view before have been drawn.
    fn build_draws(self) {
        let (Some(preprocessing), Some(metadata)) = (self.preprocessing, self.metadata) else {
            return;
        };
        main_build_indirect_parameters(
            self.view,
            preprocessing,
            self.bind_groups,
            self.cache,
            self.buffers,
            metadata,
            self.ctx,
        );
    }

    /// Draws a map, what is added to what it holds over that, or what moves over a copy of it.
    fn draw(mut self, world: &World, view: Entity) {
        let extracted = self.view.into_inner();
        let second = self.second_views.get(view).ok().copied();
        let of = second.map_or(view, |second| second.of);
        let (Ok(map), Some(phase)) = (
            self.maps.get(of),
            self.phases.get(&extracted.retained_view_entity),
        ) else {
            return;
        };
        let (layer, span) = match second.map(|second| second.over) {
            Some(Over::Moving) => (self.target.layer(map.layer), MOVING_PASS_SPAN),
            Some(Over::Added) | None => (self.target.resting(map.layer), SHADOW_PASS_SPAN),
        };
        let Some(layer) = layer else {
            return;
        };
        // Where nothing rests, nothing has been drawn.
        let load = match second {
            Some(second) if !self.drawn.is_empty(of) => {
                if second.over == Over::Moving {
                    let encoder = self.ctx.command_encoder();
                    self.target.copy_from_apart(encoder, map.layer);
                }
                LoadOp::Load
            }
            None if map.skip_if_empty && phase.is_empty() => return,
            _ => CLEARED,
        };
        draw(&mut self.ctx, world, view, map, phase, layer, load, span);
    }
}

/// Reverse z: nothing is farther than 0.
const CLEARED: LoadOp<f32> = LoadOp::Clear(0.0);

/// Draws the map of the current view, if the plugin has adopted it. Runs in `Core3d` for spot lights.
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
    let span = SHADOW_PASS_SPAN;
    draw(&mut ctx, world, entity, map, phase, layer, CLEARED, span);
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
