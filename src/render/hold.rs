//! Maps that stay as they are: what each layer holds, and whether that is whole.
//!
//! The main world says which maps still serve. The renderer draws them all the same until all their
//! casters have been drawn: meshes and materials load, pipelines are compiled, layers are allocated anew.

use bevy::{
    ecs::{
        entity::{Entity, EntityHashMap},
        query::QueryData,
        resource::Resource,
        system::{Commands, Local, Query, Res, ResMut, SystemParam},
    },
    math::Mat4,
    mesh::Mesh3d,
    pbr::{
        LightEntity, MeshesToReextractNextFrame, PendingShadowQueues, RenderMeshInstances, Shadow,
    },
    platform::collections::{HashMap, HashSet},
    render::{
        camera::DirtySpecializations,
        render_phase::{BinnedRenderPhase, ViewBinnedRenderPhases},
        render_resource::{
            CachedPipelineState, CachedRenderPipelineId, PipelineCache, PipelineDescriptor,
        },
        sync_world::{MainEntity, MainEntityHashSet},
        view::{ExtractedView, RenderShadowMapVisibleEntities, RetainedViewEntity},
    },
    shader::ShaderCacheError,
};

use super::{ExtractedShadows, added::AddedViews, layout::AdoptedMap, target::ShadowTarget};
use crate::systems::{EditedCasters, UnplannedMaps};

/// What the layers hold, by view.
#[derive(Resource, Debug, Default)]
pub(super) struct DrawnMaps {
    maps: EntityHashMap<DrawnMap>,
    /// Pipelines of casters that have lacked shaders, and for how many frames with maps that were drawn.
    lacking: HashMap<CachedRenderPipelineId, u32>,
    /// The last extraction that was drawn.
    frame: u64,
}

#[derive(Debug, Clone)]
struct DrawnMap {
    content: Content,
    view: RetainedViewEntity,
    drawn: Drawn,
    is_empty: bool,
    /// For how many frames it has been held.
    age: u32,
    /// How often in a row it has been drawn with all that it should hold.
    whole: u32,
}

/// What is drawn of a map in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Drawn {
    All,
    /// Casters that it does not hold yet.
    Added,
    Nothing,
}

/// What tells one map from another, as far as the renderer knows.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Content {
    layer: u32,
    size: [u32; 2],
    /// Of the target.
    generation: u64,
    is_apart: bool,
    clip_from_world: Mat4,
}

/// A transform may reach the GPU a frame late while Bevy's own pipelines are compiled.
const WHOLE_AT_LEAST: u32 = 2;

impl DrawnMaps {
    fn is(&self, view: Entity, drawn: Drawn) -> bool {
        self.maps.get(&view).is_some_and(|map| map.drawn == drawn)
    }

    /// Whether a view's layer keeps what it holds in this frame, and that is anything.
    pub fn holds_casters(&self, view: Entity) -> bool {
        (self.is_held(view) || self.is_added_to(view)) && !self.is_empty(view)
    }

    /// Whether a view's layer stays as it is in this frame.
    pub fn is_held(&self, view: Entity) -> bool {
        self.is(view, Drawn::Nothing)
    }

    /// Whether only casters that a view's layer does not hold yet are drawn in this frame.
    pub fn is_added_to(&self, view: Entity) -> bool {
        self.is(view, Drawn::Added)
    }

    /// Has all maps drawn anew, and what they lacked waited for.
    pub fn forget(&mut self) {
        self.maps.clear();
        self.lacking.clear();
    }

    /// For how many frames a view's layer has stayed as it is.
    pub fn age(&self, view: Entity) -> u32 {
        self.maps.get(&view).map_or(0, |map| map.age)
    }

    /// Whether a view has no casters, so that nothing is drawn.
    pub fn is_empty(&self, view: Entity) -> bool {
        self.maps.get(&view).is_none_or(|map| map.is_empty)
    }
}

#[derive(QueryData)]
pub(super) struct HoldableView {
    entity: Entity,
    map: &'static AdoptedMap,
    light: &'static LightEntity,
    extracted: &'static ExtractedView,
}

/// What may be missing in a view, or has changed in it.
#[derive(SystemParam)]
pub(super) struct Unsettled<'w, 's> {
    lists: Query<'w, 's, &'static RenderShadowMapVisibleEntities>,
    dirty: Res<'w, DirtySpecializations>,
    extracted: Res<'w, ExtractedShadows>,
    edited: Res<'w, EditedCasters>,
    unplanned: Res<'w, UnplannedMaps>,
    pending: Res<'w, PendingShadowQueues>,
}

/// More edits than this in a frame are no one's habit.
const MOST_EDITS: usize = 4096;

impl Unsettled<'_, '_> {
    fn tell_of_edits(&self) {
        let edited = &self.dirty.changed_renderables;
        if !edited.is_empty() && edited.len() <= MOST_EDITS {
            self.edited.note(edited.iter().map(MainEntity::id));
        }
    }

    /// Whether any of a view's casters is another one than it was, by mesh, material or being there: but for those
    /// that are added.
    fn is_in(&self, light: Entity, view: RetainedViewEntity, added: &[MainEntity]) -> bool {
        if self.dirty.views.contains(&view) {
            return true;
        }
        let is_waiting = self
            .pending
            .get(&view)
            .is_some_and(|queues| queues.prev_frame != queues.current_frame);
        let lists = self.lists.get(light).ok();
        let class = lists.and_then(|lists| lists.subviews.get(&view)?.1.get::<Mesh3d>());
        let Some(class) = class else {
            return is_waiting;
        };
        let is_caster = |entity: &MainEntity| {
            let listed = &class.entities_cpu_culling;
            class.entities_gpu_culling.contains_key(entity)
                || listed
                    .binary_search_by_key(entity, |(_, main)| *main)
                    .is_ok()
        };
        let DirtySpecializations {
            changed_renderables,
            removed_renderables,
            ..
        } = &*self.dirty;
        let is_added = |entity: &MainEntity| added.binary_search(entity).is_ok();
        let is_unheeded = |it: &MainEntity| self.extracted.unheeded.contains(it);
        let mut changed = changed_renderables
            .iter()
            .filter(|it| !is_added(it) && !is_unheeded(it));
        is_waiting
            || !class.added_entities.iter().all(|(_, main)| is_added(main))
            || !class.removed_entities.is_empty()
            || changed.any(is_caster)
            || removed_renderables.iter().any(is_caster)
    }
}

/// Takes the views whose layers still serve, or are only added to, out of this frame: no draw, no preprocessing.
pub(super) fn hold_maps(
    mut commands: Commands,
    views: Query<HoldableView>,
    unsettled: Unsettled,
    phases: Res<ViewBinnedRenderPhases<Shadow>>,
    target: Res<ShadowTarget>,
    added: Res<AddedViews>,
    mut drawn: ResMut<DrawnMaps>,
) {
    unsettled.tell_of_edits();
    let extracted = &unsettled.extracted;
    // What was planned in a frame that was not drawn is not known here.
    if core::mem::replace(&mut drawn.frame, extracted.frame) + 1 != extracted.frame {
        drawn.maps.clear();
    }
    let mut known = core::mem::take(&mut drawn.maps);
    for it in &views {
        let LightEntity::Directional { light_entity, .. } = it.light else {
            continue;
        };
        let content = Content {
            layer: it.map.layer,
            size: it.map.size.to_array(),
            generation: target.generation(),
            is_apart: target.is_apart(it.map.layer),
            clip_from_world: it.extracted.clip_from_world.unwrap_or_default(),
        };
        let view = it.extracted.retained_view_entity;
        let is_empty = phases.get(&view).is_none_or(BinnedRenderPhase::is_empty);
        let before = known.remove(&it.entity);
        let whole = before.as_ref().map_or(0, |before| before.whole);
        let age = before.as_ref().map_or(0, |before| before.age);
        let is_same = before
            .as_ref()
            .is_some_and(|before| before.content == content);
        let added = added.casters(it.entity);
        // Layers of maps without casters are not cleared.
        let may_keep =
            it.map.may_keep && (added.is_empty() || before.is_some_and(|it| !it.is_empty));
        let keeps = may_keep
            && is_same
            && whole >= WHOLE_AT_LEAST
            && !unsettled.is_in(*light_entity, view, added);
        let is_drawn = match keeps {
            false => Drawn::All,
            true if added.is_empty() => Drawn::Nothing,
            true => Drawn::Added,
        };
        if keeps {
            commands.entity(it.entity).remove::<ExtractedView>();
        }
        let is_unplanned = it.map.may_keep && !keeps;
        unsettled.unplanned.note(is_unplanned.into());
        let map = DrawnMap {
            content,
            view,
            drawn: is_drawn,
            is_empty,
            age: if is_drawn == Drawn::Nothing {
                age.saturating_add(1)
            } else {
                0
            },
            whole,
        };
        drawn.maps.insert(it.entity, map);
    }
}

/// What is missing for so many frames may never come: it is waited for no longer.
const PATIENCE: u32 = 60;

/// What maps wait for that is not theirs to know.
#[derive(Default, PartialEq)]
pub(super) struct Missing {
    meshes: MainEntityHashSet,
    /// Such as Bevy's that cull and lay out what is drawn.
    computes: Vec<usize>,
}

/// Counts how often maps have been drawn whole.
pub(super) fn note_whole_maps(
    mut drawn: ResMut<DrawnMaps>,
    phases: Res<ViewBinnedRenderPhases<Shadow>>,
    pipelines: Res<PipelineCache>,
    meshes: Res<RenderMeshInstances>,
    late: Option<Res<MeshesToReextractNextFrame>>,
    mut last: Local<(Missing, u32)>,
) {
    let DrawnMaps { maps, lacking, .. } = &mut *drawn;
    let drawn = || maps.values().filter(|map| map.drawn != Drawn::Nothing);
    if drawn().next().is_none() {
        return;
    }
    let phases = |map: &DrawnMap| phases.get(&map.view);
    let all_of = |map: &DrawnMap| phases(map).into_iter().flat_map(pipelines_of);
    let state = |pipeline| pipelines.get_render_pipeline_state(pipeline);
    let lack_now: HashSet<_> = drawn()
        .flat_map(all_of)
        .filter(|pipeline| lacks_shaders(state(*pipeline)))
        .collect();
    lacking.values_mut().for_each(|frames| *frames += 1);
    for pipeline in lack_now {
        lacking.entry(pipeline).or_default();
    }
    let is_drawn = |entity: &&MainEntity| meshes.render_mesh_queue_data(**entity).is_some();
    let computes = pipelines.pipelines().enumerate().filter(|(_, pipeline)| {
        let descriptor = &pipeline.descriptor;
        matches!(descriptor, PipelineDescriptor::ComputePipelineDescriptor(_))
            && is_on_its_way(&pipeline.state)
    });
    let missing = Missing {
        // There are none where the CPU preprocesses.
        meshes: late
            .iter()
            .flat_map(|late| late.iter())
            .filter(is_drawn)
            .copied()
            .collect(),
        computes: computes.map(|(index, _)| index).collect(),
    };
    let is_nothing = missing == Missing::default();
    last.1 = if missing == last.0 { last.1 + 1 } else { 0 };
    last.0 = missing;
    let is_there = is_nothing || last.1 > PATIENCE;
    for map in maps.values_mut().filter(|it| it.drawn != Drawn::Nothing) {
        let is_waited_for = |pipeline| {
            let may_come = lacking
                .get(&pipeline)
                .is_none_or(|frames| *frames < PATIENCE);
            may_come && is_on_its_way(state(pipeline))
        };
        let is_whole = is_there && !all_of(map).any(is_waited_for);
        map.whole = if is_whole { map.whole + 1 } else { 0 };
    }
}

/// The pipelines that a phase draws with.
fn pipelines_of(
    phase: &BinnedRenderPhase<Shadow>,
) -> impl Iterator<Item = CachedRenderPipelineId> + '_ {
    let sets = phase.multidrawable_meshes.keys();
    let keys = phase
        .batchable_meshes
        .keys()
        .chain(phase.unbatchable_meshes.keys());
    let sets = sets.chain(keys.map(|(set, _)| set));
    sets.map(|set| set.pipeline)
}

/// Whether a pipeline may yet be made.
fn is_on_its_way(state: &CachedPipelineState) -> bool {
    let is_made = matches!(
        state,
        CachedPipelineState::Queued | CachedPipelineState::Creating(_)
    );
    is_made || lacks_shaders(state)
}

/// Whether a pipeline waits for shaders, which may never come.
fn lacks_shaders(state: &CachedPipelineState) -> bool {
    matches!(
        state,
        CachedPipelineState::Err(
            ShaderCacheError::ShaderNotLoaded(_) | ShaderCacheError::ShaderImportNotYetAvailable
        )
    )
}
