//! Casters that move, drawn over the maps of those that rest.
//!
//! A map's own view draws what rests, seldom, and then apart from the map that is looked up; a second
//! view draws what moves, over a copy of that.

use core::any::TypeId;

use bevy::{
    camera::{primitives::Frustum, visibility::RenderLayers},
    core_pipeline::schedule::RootNonCameraView,
    ecs::{
        component::Component,
        entity::{Entity, EntityHashMap},
        query::{Has, QueryData, With, Without},
        resource::Resource,
        schedule::ScheduleLabel,
        system::{Commands, Query, Res, ResMut, SystemChangeTick},
        world::World,
    },
    math::UVec4,
    mesh::Mesh3d,
    pbr::{LightEntity, Shadow},
    platform::collections::HashSet,
    render::{
        batching::gpu_preprocessing::{GpuPreprocessingMode, GpuPreprocessingSupport},
        render_phase::ViewBinnedRenderPhases,
        renderer::{CurrentView, RenderDevice},
        sync_world::MainEntity,
        view::{
            ExtractedView, NoIndirectDrawing, RenderShadowMapVisibleEntities,
            RenderVisibleEntities, RenderVisibleEntitiesClass, RetainedViewEntity,
        },
    },
};

use super::{
    ExtractedShadows,
    hold::DrawnMaps,
    layout::AdoptedMap,
    pass::{DrawMovingCasters, DrawShadowMap},
    target::ShadowTarget,
};
use crate::config::MAX_CASCADES;

/// The view of what moves in a map.
#[derive(Component, Debug, Clone, Copy)]
pub(super) struct MovingView {
    /// The map's own view.
    pub of: Entity,
}

/// Views of what moves, by the maps' own.
#[derive(Resource, Debug, Default)]
pub(super) struct MovingViews(EntityHashMap<MovingMap>);

#[derive(Debug)]
struct MovingMap {
    view: Entity,
    casters: usize,
    /// For how many frames there have been none.
    idle: u32,
    /// The map that is looked up shows some.
    shows_any: bool,
}

/// After so many frames without anything that moves, what rests is drawn into the map itself again.
const PATIENCE: u32 = 120;

impl MovingViews {
    /// Whether a map's own view draws apart from it.
    pub fn are_over(&self, view: Entity) -> bool {
        self.0.contains_key(&view)
    }

    /// Whether anything that moves casts shadows into a map.
    pub fn hold_casters(&self, view: Entity) -> bool {
        self.0.get(&view).is_some_and(|map| map.casters > 0)
    }
}

#[derive(QueryData)]
pub(super) struct MapView {
    entity: Entity,
    light: &'static LightEntity,
    extracted: &'static ExtractedView,
    frustum: &'static Frustum,
    layers: &'static RenderLayers,
    has_no_indirect: Has<NoIndirectDrawing>,
}

/// Makes a second view of each map in which something moves, anew in each frame: Bevy knows nothing of it.
pub(super) fn add_moving_views(
    mut commands: Commands,
    maps: Query<MapView, Without<MovingView>>,
    mut lights: Query<(&MainEntity, &mut RenderShadowMapVisibleEntities)>,
    extracted: Res<ExtractedShadows>,
    support: Res<GpuPreprocessingSupport>,
    tick: SystemChangeTick,
    mut phases: ResMut<ViewBinnedRenderPhases<Shadow>>,
    mut views: ResMut<MovingViews>,
) {
    let mut known = core::mem::take(&mut views.0);
    for it in &maps {
        let LightEntity::Directional {
            light_entity,
            cascade_index,
        } = *it.light
        else {
            continue;
        };
        let Ok((main, mut lists)) = lights.get_mut(light_entity) else {
            continue;
        };
        let own = it.extracted.retained_view_entity;
        let casters = extracted.lights.get(main).and_then(|light| {
            let of_camera = light.moving.get(&own.auxiliary_entity?)?;
            of_camera.get(cascade_index)
        });
        // Nothing is drawn over the maps of this light.
        let Some(casters) = casters else {
            continue;
        };
        let before = known.remove(&it.entity);
        if casters.is_empty() && before.is_none() {
            continue;
        }
        let mut map = before.unwrap_or_else(|| MovingMap {
            view: commands.spawn_empty().id(),
            casters: 0,
            idle: 0,
            shows_any: false,
        });
        map.casters = casters.len();
        map.idle = if casters.is_empty() { map.idle + 1 } else { 0 };
        if map.idle > PATIENCE {
            commands.entity(map.view).despawn();
            continue;
        }
        let retained = RetainedViewEntity {
            subview_index: own.subview_index + MAX_CASCADES as u32,
            ..own
        };
        let mut view = commands.entity(map.view);
        view.insert((
            MovingView { of: it.entity },
            ExtractedView {
                retained_view_entity: retained,
                ..copy_of(it.extracted)
            },
            *it.frustum,
            it.layers.clone(),
            LightEntity::Directional {
                light_entity,
                cascade_index,
            },
        ));
        let most = if it.has_no_indirect {
            view.insert(NoIndirectDrawing);
            GpuPreprocessingMode::PreprocessingOnly
        } else {
            view.remove::<NoIndirectDrawing>();
            GpuPreprocessingMode::Culling
        };
        // Where a frame was cut short, the last one's are still there.
        phases.remove(&retained);
        phases.prepare_for_new_frame(retained, support.min(most));
        lists
            .subviews
            .insert(retained, (tick.this_run(), listed(casters)));
        views.0.insert(it.entity, map);
    }
    for map in known.values() {
        commands.entity(map.view).despawn();
    }
}

fn copy_of(view: &ExtractedView) -> ExtractedView {
    ExtractedView {
        retained_view_entity: view.retained_view_entity,
        clip_from_view: view.clip_from_view,
        world_from_view: view.world_from_view,
        clip_from_world: view.clip_from_world,
        target_format: view.target_format,
        viewport: view.viewport,
        color_grading: view.color_grading.clone(),
        invert_culling: view.invert_culling,
    }
}

fn listed(casters: &[(Entity, MainEntity)]) -> RenderVisibleEntities {
    let class = RenderVisibleEntitiesClass {
        added_entities: casters.to_vec(),
        entities_cpu_culling: casters.to_vec(),
        ..Default::default()
    };
    RenderVisibleEntities {
        classes: [(TypeId::of::<Mesh3d>(), class)].into_iter().collect(),
    }
}

/// Makes room for what rests, apart from the maps that are looked up.
pub(super) fn make_room_apart(
    maps: Query<(Entity, &AdoptedMap)>,
    mut moving: Query<&mut ExtractedView, With<MovingView>>,
    views: Res<MovingViews>,
    device: Res<RenderDevice>,
    mut target: ResMut<ShadowTarget>,
) {
    let mut layers = HashSet::default();
    for (view, map) in &maps {
        let Some(over) = views.0.get(&view) else {
            continue;
        };
        layers.insert(map.layer);
        if let Ok(mut extracted) = moving.get_mut(over.view) {
            extracted.viewport = UVec4::new(0, 0, map.size.x, map.size.y);
        }
    }
    target.keep_apart(&device, layers);
}

/// Decides which maps are put together anew: where what rests has been drawn, or something moves or did.
pub(super) fn choose_moving_views(
    mut commands: Commands,
    drawn: Res<DrawnMaps>,
    phases: Res<ViewBinnedRenderPhases<Shadow>>,
    extracted: Query<&ExtractedView>,
    mut views: ResMut<MovingViews>,
) {
    for (of, map) in &mut views.0 {
        let mut view = commands.entity(map.view);
        let phase = extracted
            .get(map.view)
            .ok()
            .and_then(|it| phases.get(&it.retained_view_entity));
        let shows_any = phase.is_some_and(|phase| !phase.is_empty());
        let is_held = drawn.is_held(*of);
        if is_held && !shows_any && !map.shows_any {
            view.remove::<(RootNonCameraView, ExtractedView)>();
        } else if is_held {
            view.insert(RootNonCameraView(DrawMovingCasters.intern()));
        } else {
            // The map's own view draws it, after what rests.
            view.remove::<RootNonCameraView>();
        }
        map.shows_any = shows_any;
    }
}

/// Draws what rests, and then what moves over a copy of it.
pub(super) fn draw_both(world: &mut World) {
    let Some(CurrentView(own)) = world.get_resource::<CurrentView>().copied() else {
        return;
    };
    world.run_schedule(DrawShadowMap);
    let Some(moving) = world
        .resource::<MovingViews>()
        .0
        .get(&own)
        .map(|map| map.view)
    else {
        return;
    };
    world.insert_resource(CurrentView(moving));
    world.run_schedule(DrawMovingCasters);
    world.insert_resource(CurrentView(own));
}
