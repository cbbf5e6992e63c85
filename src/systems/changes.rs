//! Which meshes have changed since the last frame: maps that hold none of them stay as they are.

use bevy::{
    asset::{AssetEvent, AssetId, Assets},
    camera::{
        primitives::Aabb,
        visibility::{
            InheritedVisibility, NoAutoAabb, NoCpuCulling, NoFrustumCulling, RenderLayers,
            VisibilityRange,
        },
    },
    ecs::{
        entity::Entity,
        entity_disabling::Disabled,
        lifecycle::{Add, Remove, RemovedComponents},
        message::MessageReader,
        observer::On,
        query::{Added, Changed, Or, With, Without},
        resource::Resource,
        system::{Commands, Local, ParamSet, Query, Res, ResMut, SystemParam},
    },
    image::Image,
    light::{NotShadowCaster, NotShadowReceiver},
    material::AlphaMode,
    mesh::{Mesh3d, morph::MeshMorphWeights, skinning::SkinnedMesh},
    pbr::StandardMaterial,
    platform::collections::HashSet,
    transform::components::GlobalTransform,
    utils::Parallel,
};

use super::{
    ManagedLight,
    bounds::BoundsMargin,
    caster_state::{CasterRecord, ChangingCaster, Found, MOST, ShadowUpdates, Surroundings},
    moving::MovingCasters,
};
use crate::plan::CasterChanges;

/// Where meshes have changed since the last frame.
#[derive(Resource, Debug, Default)]
pub struct ChangedCasters {
    changes: CasterChanges,
    /// What changes in these is no change of the maps of what rests.
    moving: MovingCasters,
    /// Whether anything has changed of what meshes receive shadows with.
    have_receivers_changed: bool,
    /// What has gone since then, and whether anything has.
    removed: Vec<CasterRecord>,
    has_receiver_gone: bool,
    /// Whether an image that masks casters has changed since then.
    has_new_mask: bool,
}

impl ChangedCasters {
    /// Of casters that rest, those included that have begun or ceased to move.
    pub fn get(&self) -> &CasterChanges {
        &self.changes
    }

    pub fn moving(&self) -> &MovingCasters {
        &self.moving
    }

    /// Whether any mesh may receive shadows in another place than in the last frame.
    pub fn have_receivers_changed(&self) -> bool {
        self.have_receivers_changed
    }

    fn note_removed(&mut self, caster: Entity, record: &mut CasterRecord) {
        let record = core::mem::take(record);
        self.has_receiver_gone = true;
        if !self.moving.remove(caster) && record != CasterRecord::Nothing {
            self.removed.push(record);
        }
    }
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
        Added<NotShadowReceiver>,
        Added<NoAutoAabb>,
        Or<(
            Added<CasterRecord>,
            Added<NoCpuCulling>,
            With<ShadowUpdates>,
            With<VisibilityRange>,
            With<SkinnedMesh>,
            With<MeshMorphWeights>,
        )>,
    )>,
);

/// Finds the meshes that have changed since the last frame.
pub fn find_changes(
    mut commands: Commands,
    mut meshes: ParamSet<(
        Query<ChangingCaster, MayHaveChanged>,
        Query<ChangingCaster, With<Mesh3d>>,
    )>,
    surroundings: Surroundings,
    unknown: Query<Entity, (With<Mesh3d>, Without<CasterRecord>)>,
    lights: Query<(), With<ManagedLight>>,
    mut lost: LostComponents,
    mut changed: ResMut<ChangedCasters>,
    mut was_idle: Local<bool>,
    mut local: Local<Parallel<Found>>,
) {
    if lights.is_empty() {
        lost.clear();
        changed.removed.clear();
        changed.moving.clear();
        changed.changes = CasterChanges::Anywhere;
        changed.have_receivers_changed = true;
        *was_idle = true;
        return;
    }
    let changed = &mut *changed;
    let displaced = surroundings.displaced.get();
    if core::mem::take(&mut *was_idle) {
        // Nobody has looked at them in the meantime.
        meshes.p1().par_iter_mut().for_each_init(
            || local.borrow_local_mut(),
            |found, mut it| found.compare(&mut it, &surroundings, &displaced, &changed.moving),
        );
    }
    meshes.p0().par_iter_mut().for_each_init(
        || local.borrow_local_mut(),
        |found, mut it| found.compare(&mut it, &surroundings, &displaced, &changed.moving),
    );
    let mut found = Found {
        has_receiver: core::mem::take(&mut changed.has_receiver_gone),
        ..Found::default()
    };
    let removed = changed.removed.drain(..);
    found
        .casters
        .extend(removed.filter_map(|record| record.caster()));
    for of_thread in local.iter_mut() {
        found.casters.append(&mut of_thread.casters);
        found.moving.append(&mut of_thread.moving);
        found.resting.append(&mut of_thread.resting);
        found.has_receiver |= core::mem::take(&mut of_thread.has_receiver);
    }
    let mut all = meshes.p1();
    if lost.updates.read().count() > 0 {
        found.casters.push(None);
    }
    let entities = lost.read().into_iter().chain(displaced.iter().copied());
    for entity in entities {
        if let Ok(mut it) = all.get_mut(entity) {
            found.compare(&mut it, &surroundings, &displaced, &changed.moving);
        }
    }
    if core::mem::take(&mut changed.has_new_mask) {
        found.casters.push(None);
    }
    // Spawned before the plugin was there.
    for entity in &unknown {
        found.casters.push(None);
        commands.entity(entity).try_insert(CasterRecord::default());
    }
    changed.have_receivers_changed = found.has_receiver;
    let stopped = found.resting.into_iter();
    let stopped: Vec<Entity> = stopped.filter(|it| changed.moving.remove(*it)).collect();
    let resting = changed.moving.update(found.moving);
    let too_many = found.casters.len() > MOST || changed.moving.len() > MOST;
    if changed.moving.len() > MOST {
        changed.moving.clear();
    }
    let resting = resting.into_iter().chain(stopped);
    let resting = resting.filter_map(|caster| all.get(caster).ok()?.record.caster());
    let casters = found.casters.into_iter().chain(resting);
    let bounds: Option<Vec<_>> = casters.filter(|_| !too_many).collect();
    changed.changes = match bounds {
        Some(bounds) if !too_many => CasterChanges::At(bounds),
        _ => CasterChanges::Anywhere,
    };
}

/// Components whose loss changes a shadow.
#[derive(SystemParam)]
pub struct LostComponents<'w, 's> {
    bounds: RemovedComponents<'w, 's, Aabb>,
    margins: RemovedComponents<'w, 's, BoundsMargin>,
    layers: RemovedComponents<'w, 's, RenderLayers>,
    unculled: RemovedComponents<'w, 's, NoFrustumCulling>,
    gpu_culled: RemovedComponents<'w, 's, NoCpuCulling>,
    no_casters: RemovedComponents<'w, 's, NotShadowCaster>,
    no_receivers: RemovedComponents<'w, 's, NotShadowReceiver>,
    own_bounds: RemovedComponents<'w, 's, NoAutoAabb>,
    ranges: RemovedComponents<'w, 's, VisibilityRange>,
    skins: RemovedComponents<'w, 's, SkinnedMesh>,
    morphs: RemovedComponents<'w, 's, MeshMorphWeights>,
    disabled: RemovedComponents<'w, 's, Disabled>,
    updates: RemovedComponents<'w, 's, ShadowUpdates>,
}

impl LostComponents<'_, '_> {
    fn read(&mut self) -> Vec<Entity> {
        let mut entities = Vec::new();
        entities.extend(self.bounds.read());
        entities.extend(self.margins.read());
        entities.extend(self.layers.read());
        entities.extend(self.unculled.read());
        entities.extend(self.gpu_culled.read());
        entities.extend(self.no_casters.read());
        entities.extend(self.no_receivers.read());
        entities.extend(self.own_bounds.read());
        entities.extend(self.ranges.read());
        entities.extend(self.skins.read());
        entities.extend(self.morphs.read());
        entities.extend(self.disabled.read());
        entities
    }

    fn clear(&mut self) {
        self.read();
        self.updates.clear();
    }
}

/// Materials do not change with their images.
pub(super) fn note_changed_masks(
    mut images: MessageReader<AssetEvent<Image>>,
    materials: Res<Assets<StandardMaterial>>,
    mut changed: ResMut<ChangedCasters>,
) {
    let modified = images.read().filter_map(|event| match event {
        AssetEvent::Modified { id } => Some(*id),
        _ => None,
    });
    let modified: HashSet<AssetId<Image>> = modified.collect();
    if modified.is_empty() {
        return;
    }
    changed.has_new_mask |= materials.iter().any(|(_, material)| {
        let image = material.base_color_texture.as_ref();
        let is_modified = image.is_some_and(|image| modified.contains(&image.id()));
        is_modified && material.alpha_mode != AlphaMode::Opaque
    });
}

/// What goes leaves its shadow behind in maps that hold it.
pub(super) fn note_removed(
    removed: On<Remove<Mesh3d>>,
    mut casters: Query<&mut CasterRecord>,
    mut changed: ResMut<ChangedCasters>,
) {
    let entity = removed.entity;
    if let Ok(mut record) = casters.get_mut(entity) {
        changed.note_removed(entity, &mut record);
    }
}

/// What is disabled is not found any more.
pub(super) fn note_disabled(
    disabled: On<Add<Disabled>>,
    mut casters: Query<&mut CasterRecord, With<Disabled>>,
    mut changed: ResMut<ChangedCasters>,
) {
    let entity = disabled.entity;
    if let Ok(mut record) = casters.get_mut(entity) {
        changed.note_removed(entity, &mut record);
    }
}
