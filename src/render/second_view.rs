//! Second views of maps: they draw some casters over what the maps' own views have drawn.

use core::any::TypeId;

use bevy::{
    camera::{primitives::Frustum, visibility::RenderLayers},
    ecs::{
        component::Component,
        entity::Entity,
        query::{Has, QueryData},
        resource::Resource,
        system::{Commands, Query, Res, ResMut, SystemChangeTick, SystemParam},
    },
    mesh::Mesh3d,
    pbr::{
        LightEntity, LightKeyCache, MeshPipelineKey, Shadow,
        SpecializedShadowMaterialPipelineCache, SpecializedShadowMaterialViewPipelineCache,
    },
    platform::collections::HashMap,
    render::{
        batching::gpu_preprocessing::{GpuPreprocessingMode, GpuPreprocessingSupport},
        render_phase::ViewBinnedRenderPhases,
        sync_world::MainEntity,
        view::{
            ExtractedView, NoIndirectDrawing, RenderShadowMapVisibleEntities,
            RenderVisibleEntities, RenderVisibleEntitiesClass, RetainedViewEntity,
        },
    },
};

use super::ExtractedShadows;
use crate::config::MAX_CASCADES;

/// A view that draws some casters over a map.
#[derive(Component, Debug, Clone, Copy)]
pub(super) struct SecondView {
    /// The map's own view.
    pub of: Entity,
    pub over: Over,
}

/// What a second view draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Over {
    /// Casters that move.
    Moving,
    /// Casters that are added to those that the map holds.
    Added,
}

impl Over {
    /// Bevy counts a camera's maps of a light from 0.
    fn subview_offset(self) -> u32 {
        let offset = match self {
            Self::Moving => MAX_CASCADES,
            Self::Added => 2 * MAX_CASCADES,
        };
        offset as u32
    }
}

/// Which pipelines draw what second views show, while Bevy drops them with what is of no view of its own.
#[derive(Resource, Default)]
pub(super) struct KeptPipelines(HashMap<RetainedViewEntity, ViewPipelines>);

type ViewPipelines = (MeshPipelineKey, SpecializedShadowMaterialViewPipelineCache);

/// The pipelines of views, as Bevy knows them.
#[derive(SystemParam)]
pub(super) struct Pipelines<'w> {
    keys: ResMut<'w, LightKeyCache>,
    of_casters: ResMut<'w, SpecializedShadowMaterialPipelineCache>,
    kept: ResMut<'w, KeptPipelines>,
}

impl Pipelines<'_> {
    /// Keeps those of views of what moves, which show nearly the same in each frame.
    pub fn keep(&mut self, views: &Query<(&SecondView, &ExtractedView)>) {
        self.kept.0.clear();
        let moving = views.iter().filter(|(view, _)| view.over == Over::Moving);
        for view in moving.map(|(_, extracted)| extracted.retained_view_entity) {
            if let (Some(key), Some(of_casters)) =
                (self.keys.remove(&view), self.of_casters.remove(&view))
            {
                self.kept.0.insert(view, (key, of_casters));
            }
        }
    }

    fn give_back(&mut self, view: RetainedViewEntity) {
        if let Some((key, of_casters)) = self.kept.0.remove(&view) {
            self.keys.insert(view, key);
            self.of_casters.insert(view, of_casters);
        }
    }
}

#[derive(QueryData)]
pub(super) struct MapView {
    pub entity: Entity,
    pub extracted: &'static ExtractedView,
    light: &'static LightEntity,
    frustum: &'static Frustum,
    layers: &'static RenderLayers,
    has_no_indirect: Has<NoIndirectDrawing>,
}

/// What it takes to make second views, anew in each frame: Bevy knows nothing of them.
#[derive(SystemParam)]
pub(super) struct SecondViews<'w, 's> {
    pub commands: Commands<'w, 's>,
    lights: Query<
        'w,
        's,
        (
            &'static MainEntity,
            &'static mut RenderShadowMapVisibleEntities,
        ),
    >,
    extracted: Res<'w, ExtractedShadows>,
    support: Res<'w, GpuPreprocessingSupport>,
    tick: SystemChangeTick,
    phases: ResMut<'w, ViewBinnedRenderPhases<Shadow>>,
    pipelines: Pipelines<'w>,
}

impl SecondViews<'_, '_> {
    /// The casters that are to be drawn over a map; `None` if its light has none drawn over any.
    pub fn casters(&self, map: &MapViewItem, over: Over) -> Option<&[(Entity, MainEntity)]> {
        let LightEntity::Directional {
            light_entity,
            cascade_index,
        } = *map.light
        else {
            return None;
        };
        let (main, _) = self.lights.get(light_entity).ok()?;
        let light = self.extracted.lights.get(main)?;
        let by_camera = match over {
            Over::Moving => &light.moving,
            Over::Added => &light.added,
        };
        let camera = map.extracted.retained_view_entity.auxiliary_entity?;
        Some(by_camera.get(&camera)?.get(cascade_index)?)
    }

    /// Makes `view` draw some casters.
    pub fn draw(
        &mut self,
        view: Entity,
        map: &MapViewItem,
        over: Over,
        casters: RenderVisibleEntities,
    ) {
        let LightEntity::Directional {
            light_entity,
            cascade_index,
        } = *map.light
        else {
            return;
        };
        let Ok((_, mut lists)) = self.lights.get_mut(light_entity) else {
            return;
        };
        let own = map.extracted.retained_view_entity;
        let retained = RetainedViewEntity {
            subview_index: own.subview_index + over.subview_offset(),
            ..own
        };
        let mut view = self.commands.entity(view);
        view.insert((
            SecondView {
                of: map.entity,
                over,
            },
            ExtractedView {
                retained_view_entity: retained,
                ..copy_of(map.extracted)
            },
            *map.frustum,
            map.layers.clone(),
            LightEntity::Directional {
                light_entity,
                cascade_index,
            },
        ));
        let most = if map.has_no_indirect {
            view.insert(NoIndirectDrawing);
            GpuPreprocessingMode::PreprocessingOnly
        } else {
            view.remove::<NoIndirectDrawing>();
            GpuPreprocessingMode::Culling
        };
        self.pipelines.give_back(retained);
        // Where a frame was cut short, the last one's are still there.
        self.phases.remove(&retained);
        self.phases
            .prepare_for_new_frame(retained, self.support.min(most));
        lists
            .subviews
            .insert(retained, (self.tick.this_run(), casters));
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

/// Casters as Bevy lists them for a view that is new.
pub(super) fn listed(casters: &[(Entity, MainEntity)]) -> RenderVisibleEntities {
    let class = RenderVisibleEntitiesClass {
        added_entities: casters.to_vec(),
        entities_cpu_culling: casters.to_vec(),
        ..Default::default()
    };
    RenderVisibleEntities {
        classes: [(TypeId::of::<Mesh3d>(), class)].into_iter().collect(),
    }
}
