//! Which meshes have changed since the last frame: maps that hold none of them stay as they are.

use bevy::{
    asset::{AssetEvent, AssetId, Assets},
    camera::{
        primitives::Aabb,
        visibility::{NoAutoAabb, NoCpuCulling, NoFrustumCulling, RenderLayers, VisibilityRange},
    },
    ecs::{
        entity::Entity,
        entity_disabling::Disabled,
        lifecycle::{Add, Remove, RemovedComponents},
        message::MessageReader,
        observer::On,
        query::{With, Without},
        resource::Resource,
        system::{Commands, Local, Query, Res, ResMut, SystemParam},
    },
    image::Image,
    light::{NotShadowCaster, NotShadowReceiver},
    material::AlphaMode,
    mesh::{Mesh3d, morph::MeshMorphWeights, skinning::SkinnedMesh},
    pbr::StandardMaterial,
    platform::collections::HashSet,
    utils::Parallel,
};

use super::{
    ManagedLight,
    bounds::BoundsMargin,
    caster_state::{CasterRecord, ChangingCaster, Found, ShadowUpdates, Surroundings},
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
    /// Meshes that have been without a record until then.
    late: Vec<Entity>,
    /// Whether meshes may have changed since their records were made.
    are_records_old: bool,
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

    /// Takes it that everything has changed.
    fn forget(&mut self) {
        self.moving.clear();
        self.changes = CasterChanges::Anywhere;
        self.have_receivers_changed = true;
    }

    fn note_removed(&mut self, caster: Entity, record: &mut CasterRecord) {
        let record = core::mem::take(record);
        self.has_receiver_gone = true;
        if !self.moving.remove(caster) && record != CasterRecord::Nothing {
            self.removed.push(record);
        }
    }
}

/// More changed casters than this are not told apart: most maps hold some.
const MOST: usize = 4096;

/// If more meshes than this are written to in a frame in which too many had changed before, a few of them tell whether
/// they still do.
const MANY: usize = 2 * MOST;
const FEW: usize = 256;

/// Finds the meshes that have changed since the last frame.
pub fn find_changes(
    mut commands: Commands,
    mut meshes: Query<ChangingCaster>,
    surroundings: Surroundings,
    unknown: Query<Entity, (With<Mesh3d>, Without<CasterRecord>)>,
    lights: Query<(), With<ManagedLight>>,
    mut lost: LostComponents,
    mut changed: ResMut<ChangedCasters>,
    mut local: Local<Parallel<(Vec<Entity>, Found)>>,
) {
    if lights.is_empty() {
        lost.clear();
        changed.removed.clear();
        changed.are_records_old = true;
        changed.forget();
        return;
    }
    let changed = &mut *changed;
    let displaced = surroundings.displaced.get();
    let mut suspects = core::mem::take(&mut changed.late);
    if let Ok(tables) = meshes.contiguous_par_iter() {
        tables.for_each_init(
            || local.borrow_local_mut(),
            |found, table| table.suspects(&mut found.0),
        );
        for (found, _) in local.iter_mut() {
            suspects.append(found);
        }
    } else {
        // Never with components as Bevy stores them.
        suspects.extend(meshes.iter().map(|it| it.entity));
    }
    let mut found = Found {
        has_receiver: core::mem::take(&mut changed.has_receiver_gone),
        ..Found::default()
    };
    let removed = changed.removed.drain(..);
    found
        .casters
        .extend(removed.filter_map(|record| record.caster()));
    if lost.updates.read().count() > 0 || core::mem::take(&mut changed.has_new_mask) {
        found.casters.push(None);
    }
    let with_lost = lost.read();
    // Spawned before the plugin was there.
    for entity in &unknown {
        found.casters.push(None);
        commands.entity(entity).try_insert(CasterRecord::default());
        changed.late.push(entity);
    }

    if changed.are_records_old {
        let mut few = suspects.iter().take(FEW);
        let still_changes = suspects.len() > MANY
            && few.any(|entity| {
                let it = meshes.get_mut(*entity);
                it.is_ok_and(|mut it| {
                    !found.compare(&mut it, &surroundings, &displaced, &changed.moving)
                })
            });
        changed.forget();
        if still_changes {
            return;
        }
        meshes.par_iter_mut().for_each_init(
            || local.borrow_local_mut(),
            |found, mut it| found.1.note(&mut it, &surroundings, &displaced),
        );
        let moving = local
            .iter_mut()
            .flat_map(|(_, found)| found.moving.drain(..));
        let moving: Vec<Entity> = moving.collect();
        if moving.len() <= MOST {
            changed.moving.update(moving);
        }
        changed.are_records_old = false;
        return;
    }

    suspects.extend(with_lost);
    suspects.extend(displaced.iter());
    for entity in suspects {
        if let Ok(mut it) = meshes.get_mut(entity) {
            found.compare(&mut it, &surroundings, &displaced, &changed.moving);
        }
        // What begins to move is in both places.
        if found.moving.len() > MOST || found.casters.len() > 4 * MOST {
            changed.are_records_old = true;
            changed.forget();
            return;
        }
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
    let resting = resting.filter_map(|caster| meshes.get(caster).ok()?.record.caster());
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
