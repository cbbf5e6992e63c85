//! Which casters have changed since the last frame: maps that hold none of them stay as they are.

use bevy::{
    camera::{
        Camera3d,
        primitives::Aabb,
        visibility::{
            InheritedVisibility, NoFrustumCulling, RenderLayers, VisibilityRange,
            VisibleEntityRanges,
        },
    },
    ecs::{
        change_detection::{DetectChanges, DetectChangesMut, Ref},
        component::Component,
        entity::{Entity, EntityHashSet},
        lifecycle::{Remove, RemovedComponents},
        observer::On,
        query::{Added, Changed, Has, Or, QueryData, With, Without},
        reflect::ReflectComponent,
        resource::Resource,
        system::{Commands, Local, ParamSet, Query, Res, ResMut, SystemParam},
    },
    light::NotShadowCaster,
    math::Affine3A,
    mesh::{
        Mesh3d,
        morph::{MeshMorphWeights, MorphWeights},
        skinning::SkinnedMesh,
    },
    reflect::{Reflect, std_traits::ReflectDefault},
    transform::components::GlobalTransform,
    utils::Parallel,
};

use super::bounds::{BoundsMargin, DisplacedMeshes, Margin, world_bounds};
use crate::{geometry::oriented_box::OrientedBox, plan::CasterChanges};

/// How often a caster's shadow is drawn anew. Without it: when it has changed ([`Self::Automatic`]).
#[derive(Component, Reflect, Debug, Default, Clone, Copy, PartialEq, Eq, Hash)]
#[reflect(Component, Default, Debug, Clone, PartialEq, Hash)]
pub enum ShadowUpdates {
    /// When its transform, mesh, material, visibility, layers, level of detail or pose has changed; in
    /// every frame if its material has a vertex shader of its own.
    #[default]
    Automatic,
    /// In every frame.
    Always,
    /// When the map is drawn for another reason. For what changes and need not show it, as a vertex
    /// shader that does not move anything does.
    Never,
}

/// What a mesh's shadow depends on, as of the last frame.
#[derive(Component, Debug, Default, Clone, PartialEq)]
pub struct CasterRecord(Option<CasterState>);

#[derive(Debug, Clone, PartialEq)]
struct CasterState {
    transform: Affine3A,
    /// `None` if it is not culled.
    bounds: Option<(Aabb, Margin)>,
    layers: RenderLayers,
    /// The views for which it is in the range of its level of detail.
    ranges: u32,
}

/// Where casters have changed since the last frame.
#[derive(Resource, Debug, Default)]
pub struct ChangedCasters {
    changes: CasterChanges,
    /// What has gone since then.
    removed: Vec<CasterState>,
}

impl ChangedCasters {
    pub fn get(&self) -> &CasterChanges {
        &self.changes
    }
}

/// More changed casters than this are not told apart: most maps hold some.
const MOST: usize = 4096;

impl CasterState {
    /// Where it is; `None` for anywhere.
    fn bounds(&self) -> Option<OrientedBox> {
        let (aabb, margin) = self.bounds.as_ref()?;
        Some(world_bounds(aabb, &self.transform, *margin))
    }
}

#[derive(QueryData)]
#[query_data(mutable)]
pub struct ChangingCaster {
    entity: Entity,
    record: &'static mut CasterRecord,
    transform: &'static GlobalTransform,
    inherited: &'static InheritedVisibility,
    aabb: Option<&'static Aabb>,
    margin: Option<&'static BoundsMargin>,
    layers: Option<&'static RenderLayers>,
    updates: Option<&'static ShadowUpdates>,
    skin: Option<&'static SkinnedMesh>,
    morph: Option<Ref<'static, MeshMorphWeights>>,
    is_unculled: Has<NoFrustumCulling>,
    casts_none: Has<NotShadowCaster>,
    has_range: Has<VisibilityRange>,
}

/// What may have changed: all that has been written, and what changes by something else.
type MayHaveChanged = (
    With<Mesh3d>,
    Or<(
        Changed<GlobalTransform>,
        Changed<InheritedVisibility>,
        Changed<Mesh3d>,
        Changed<Aabb>,
        Changed<BoundsMargin>,
        Changed<RenderLayers>,
        Added<NoFrustumCulling>,
        Added<NotShadowCaster>,
        With<ShadowUpdates>,
        With<VisibilityRange>,
        With<SkinnedMesh>,
        With<MeshMorphWeights>,
    )>,
);

/// What casters depend on beside their own components.
#[derive(SystemParam)]
pub(super) struct Surroundings<'w, 's> {
    displaced: Res<'w, DisplacedMeshes>,
    ranges: Option<Res<'w, VisibleEntityRanges>>,
    cameras: Query<'w, 's, Entity, With<Camera3d>>,
    transforms: Query<'w, 's, Ref<'static, GlobalTransform>>,
    morphs: Query<'w, 's, Ref<'static, MorphWeights>>,
}

impl Surroundings<'_, '_> {
    fn has_moved_inside(&self, it: &ChangingCasterItem) -> bool {
        let is_bent = it.skin.is_some_and(|skin| {
            let mut joints = self.transforms.iter_many(&skin.joints);
            joints.any(|joint| joint.is_ok_and(|joint| joint.is_changed()))
        });
        is_bent
            || it.morph.as_ref().is_some_and(|weights| match &**weights {
                MeshMorphWeights::Value { .. } => weights.is_changed(),
                MeshMorphWeights::Reference(entity) => self
                    .morphs
                    .get(*entity)
                    .is_ok_and(|weights| weights.is_changed()),
            })
    }

    fn ranges(&self, it: &ChangingCasterItem) -> u32 {
        let Some(ranges) = self.ranges.as_ref().filter(|_| it.has_range) else {
            return u32::MAX;
        };
        let in_range = |view| ranges.entity_is_in_range_of_view(it.entity, view);
        self.cameras
            .iter()
            .fold(0, |mask, view| (mask << 1) | u32::from(in_range(view)))
    }
}

/// Compares a caster with what it was, and notes where it is and was if that differs.
fn note_change(
    it: &mut ChangingCasterItem,
    surroundings: &Surroundings,
    displaced: &EntityHashSet,
    found: &mut Vec<Option<OrientedBox>>,
) {
    let margin = Margin::of(it.entity, it.margin, displaced);
    let bounds = it.aabb.map(|aabb| (*aabb, margin));
    let state = (it.inherited.get() && !it.casts_none).then(|| CasterState {
        transform: it.transform.affine(),
        bounds: bounds.filter(|_| !it.is_unculled),
        layers: it.layers.cloned().unwrap_or_default(),
        ranges: surroundings.ranges(it),
    });
    let updates = it.updates.copied().unwrap_or_default();
    let is_restless = match updates {
        ShadowUpdates::Automatic => {
            displaced.contains(&it.entity) || surroundings.has_moved_inside(it)
        }
        ShadowUpdates::Always => true,
        ShadowUpdates::Never => false,
    };
    let record = &mut it.record.bypass_change_detection().0;
    let is_same = *record == state;
    if is_restless || !is_same && updates != ShadowUpdates::Never {
        let now = state.as_ref().map(CasterState::bounds);
        let before = record.as_ref().filter(|_| !is_same);
        found.extend(now.into_iter().chain(before.map(CasterState::bounds)));
    }
    *record = state;
}

/// Finds the casters that have changed since the last frame.
pub(super) fn find_changes(
    mut commands: Commands,
    mut casters: ParamSet<(
        Query<ChangingCaster, MayHaveChanged>,
        Query<ChangingCaster, With<Mesh3d>>,
    )>,
    surroundings: Surroundings,
    unknown: Query<Entity, (With<Mesh3d>, Without<CasterRecord>)>,
    mut lost: LostComponents,
    mut changed: ResMut<ChangedCasters>,
    mut local: Local<Parallel<Vec<Option<OrientedBox>>>>,
) {
    let displaced = surroundings.displaced.get();
    let removed = changed.removed.drain(..);
    let mut found: Vec<Option<OrientedBox>> = removed.map(|state| state.bounds()).collect();
    casters.p0().par_iter_mut().for_each_init(
        || local.borrow_local_mut(),
        |found, mut it| note_change(&mut it, &surroundings, &displaced, found),
    );
    local.drain_into(&mut found);
    let entities = lost.read().chain(displaced.iter().copied());
    let mut all = casters.p1();
    for entity in entities {
        if let Ok(mut it) = all.get_mut(entity) {
            note_change(&mut it, &surroundings, &displaced, &mut found);
        }
    }
    // Spawned before the plugin was there.
    for entity in &unknown {
        found.push(None);
        commands.entity(entity).insert(CasterRecord::default());
    }
    let bounds = (found.len() <= MOST).then(|| found.into_iter().collect());
    changed.changes = bounds
        .flatten()
        .map_or(CasterChanges::Anywhere, CasterChanges::At);
}

/// Components whose loss changes a shadow.
#[derive(SystemParam)]
pub(super) struct LostComponents<'w, 's> {
    bounds: RemovedComponents<'w, 's, Aabb>,
    margins: RemovedComponents<'w, 's, BoundsMargin>,
    layers: RemovedComponents<'w, 's, RenderLayers>,
    unculled: RemovedComponents<'w, 's, NoFrustumCulling>,
    no_casters: RemovedComponents<'w, 's, NotShadowCaster>,
    ranges: RemovedComponents<'w, 's, VisibilityRange>,
}

impl LostComponents<'_, '_> {
    fn read(&mut self) -> impl Iterator<Item = Entity> {
        let Self {
            bounds,
            margins,
            layers,
            unculled,
            no_casters,
            ranges,
        } = self;
        let lists = bounds.read().chain(margins.read()).chain(layers.read());
        let lists = lists.chain(unculled.read()).chain(no_casters.read());
        lists.chain(ranges.read())
    }
}

/// What goes leaves its shadow behind in maps that hold it.
pub(super) fn note_removed(
    removed: On<Remove<Mesh3d>>,
    mut casters: Query<&mut CasterRecord>,
    mut changed: ResMut<ChangedCasters>,
) {
    if let Ok(mut record) = casters.get_mut(removed.entity) {
        changed.removed.extend(record.0.take());
    }
}
