//! Which meshes have changed since the last frame: maps that hold none of them stay as they are.

use bevy::{
    camera::{
        primitives::Aabb,
        visibility::{
            InheritedVisibility, NoAutoAabb, NoCpuCulling, NoFrustumCulling, RenderLayers,
            VisibilityRange,
        },
    },
    ecs::{
        change_detection::DetectChangesMut,
        component::ComponentId,
        entity::{Entity, EntityHashSet},
        entity_disabling::{DefaultQueryFilters, Disabled},
        lifecycle::{
            Add, Remove, RemovedComponentEntity, RemovedComponentMessages, RemovedComponents,
        },
        message::MessageCursor,
        observer::On,
        query::{With, Without},
        resource::Resource,
        system::{Commands, Local, Query, Res, ResMut, SystemParam},
    },
    light::{DirectionalLight, NotShadowCaster, NotShadowReceiver},
    math::DVec3,
    mesh::{Mesh3d, morph::MeshMorphWeights, skinning::SkinnedMesh},
    platform::collections::HashMap,
    utils::Parallel,
};

use super::{
    ManagedLight, ShadowGridOrigin,
    bounds::BoundsMargin,
    caster_state::{CasterRecord, ChangingCaster, Found, ShadowUpdates, Surroundings},
    edits::Edits,
    moving::MovingCasters,
    plan::shines,
    sample::Sample,
};
use crate::{geometry::oriented_box::OrientedBox, plan::CasterChanges};

/// Where meshes have changed since the last frame.
#[derive(Resource, Debug, Default)]
pub struct ChangedCasters {
    changes: CasterChanges,
    /// What changes in these is no change of the maps of what rests.
    moving: MovingCasters,
    /// Whether anything has changed of what meshes receive shadows with.
    have_receivers_changed: bool,
    frame: u64,
    /// What has gone since then, and whether anything has.
    removed: Vec<CasterRecord>,
    has_receiver_gone: bool,
    /// Meshes that have been without a record until then.
    late: Vec<Entity>,
    /// Whether meshes may have changed since their records were made.
    are_records_old: bool,
    sample: Sample,
}

impl ChangedCasters {
    /// Of casters that rest, those included that have begun or ceased to move.
    pub fn get(&self) -> &CasterChanges {
        &self.changes
    }

    pub fn moving(&self) -> &MovingCasters {
        &self.moving
    }

    /// Counts how often changes were looked for: they are those since the last time.
    pub fn frame(&self) -> u64 {
        self.frame
    }

    /// Whether any mesh may receive shadows in another place than in the last frame.
    pub fn have_receivers_changed(&self) -> bool {
        self.have_receivers_changed
    }

    /// Takes it that everything has changed.
    fn forget(&mut self) {
        self.changes = if self.moving.len() > 0 {
            CasterChanges::AtOnce(None)
        } else {
            CasterChanges::Anywhere
        };
        self.moving.clear();
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

/// The same of very many meshes, as a share of them: one in so many.
const SHARE: usize = 32;

/// While anything moves, up to so many casters that come in a frame are taken to move until they are seen to rest: what
/// is shot moves, and what comes with many others is a place that is loaded.
const MOST_TRIED: usize = 32;

/// Finds the meshes that have changed since the last frame. Rests while no managed light shines.
pub fn find_changes(
    mut commands: Commands,
    mut meshes: Query<ChangingCaster>,
    surroundings: Surroundings,
    unknown: Query<Entity, (With<Mesh3d>, Without<CasterRecord>)>,
    lights: Query<(&ManagedLight, &DirectionalLight, &InheritedVisibility)>,
    mut lost: LostComponents,
    mut edits: Edits,
    (origin, mut last_origin): (Res<ShadowGridOrigin>, Local<DVec3>),
    mut changed: ResMut<ChangedCasters>,
    mut suspects: Local<Vec<Entity>>,
    (mut found_by, mut restless_by): (Local<Parallel<Found>>, Local<Parallel<Vec<Entity>>>),
) {
    changed.frame += 1;
    let (masked, edited) = edits.take();
    let mut lights = lights.iter();
    if !lights.any(|(it, light, inherited)| it.config().is_some() && shines(light, inherited)) {
        lost.clear();
        changed.removed.clear();
        changed.are_records_old = true;
        changed.forget();
        return;
    }
    let changed = &mut *changed;
    let displaced = surroundings.displaced.get();
    let mut found = Found {
        has_receiver: core::mem::take(&mut changed.has_receiver_gone),
        ..Found::default()
    };
    let removed = changed.removed.drain(..);
    found
        .casters
        .extend(removed.filter_map(|record| record.caster()));
    found.has_left = !found.casters.is_empty();
    for mesh in masked.iter().filter_map(|mesh| meshes.get(*mesh).ok()) {
        let need_not_show = mesh.is_never_updated() && changed.moving.is_edited_often(mesh.entity);
        if !changed.moving.contains(mesh.entity) && !need_not_show {
            found.casters.extend(mesh.record.caster());
        }
    }
    let edited = masked.into_iter().chain(edited);
    changed.moving.note_edits(edited, |it| edits.has_mesh(it));
    // All that the world's origin has been moved with is where it was.
    changed.are_records_old |= core::mem::replace(&mut *last_origin, origin.get()) != origin.get();
    // Spawned before the plugin was there.
    for entity in &unknown {
        found.casters.push(None);
        commands.entity(entity).try_insert(CasterRecord::default());
        changed.late.push(entity);
    }

    let most = MOST.max(meshes.iter().len() / SHARE);
    let mut is_flood = changed.are_records_old;
    if changed.are_records_old && !changed.sample.is_empty() {
        let mut of_sample = Found::default();
        let mut sample = meshes.iter_many_mut(&changed.sample.meshes);
        while let Some(it) = sample.fetch_next() {
            if let Ok(mut it) = it {
                of_sample.compare(&mut it, &surroundings, &displaced, &changed.moving);
            }
        }
        is_flood = changed.sample.tell_flood(&of_sample, most);
        if is_flood && changed.sample.is_believed() {
            lost.clear();
            changed.forget();
            return;
        }
    }
    suspects.clear();
    suspects.append(&mut changed.late);
    if let Ok(tables) = meshes.contiguous_iter() {
        tables.for_each(|table| table.suspects(&mut suspects));
    } else {
        // Never with components as Bevy stores them.
        suspects.extend(meshes.iter().map(|it| it.entity));
    }
    suspects.extend(lost.read());
    for enabled in lost.read_enabled() {
        // Queries did not find it: who drew without it has not been told.
        if let Ok(mut it) = meshes.get_mut(enabled) {
            *it.record.bypass_change_detection() = CasterRecord::Nothing;
            suspects.push(enabled);
        }
    }
    suspects.extend(displaced.iter());
    suspects.extend(changed.moving.edited());
    if changed.are_records_old {
        changed.forget();
        let last = core::mem::take(&mut changed.sample);
        if is_flood && suspects.len() > most {
            changed.sample = last.renewed(&suspects, changed.frame);
            let mut sample = meshes.iter_many_mut(&changed.sample.meshes);
            while let Some(it) = sample.fetch_next() {
                if let Ok(mut it) = it {
                    it.note(&surroundings, &displaced);
                }
            }
            return;
        }
        meshes.par_iter_mut().for_each_init(
            || restless_by.borrow_local_mut(),
            |restless, mut it| {
                if it.note(&surroundings, &displaced) {
                    restless.push(it.entity);
                }
            },
        );
        let mut restless = Vec::new();
        restless_by.drain_into(&mut restless);
        if restless.len() <= most {
            changed.moving.update(restless);
        }
        changed.are_records_old = false;
        return;
    }

    if suspects.len() > MOST {
        let suspects: EntityHashSet = suspects.drain(..).collect();
        let suspects = meshes.par_iter_many_unique_mut(suspects);
        suspects.for_each_init(
            || found_by.borrow_local_mut(),
            |found, it| match it {
                Ok(mut it) if !found.is_flood(most) => {
                    found.compare(&mut it, &surroundings, &displaced, &changed.moving);
                }
                _ => (),
            },
        );
        found_by
            .iter_mut()
            .for_each(|of_thread| found.append(of_thread));
    } else {
        suspects.sort_unstable();
        suspects.dedup();
        let mut suspects = meshes.iter_many_mut(&*suspects);
        while let Some(it) = suspects.fetch_next() {
            if let Ok(mut it) = it {
                found.compare(&mut it, &surroundings, &displaced, &changed.moving);
            }
        }
    }
    if found.is_flood(most) {
        // Not all have been compared.
        changed.are_records_old = true;
        changed.forget();
        return;
    }
    changed.have_receivers_changed = found.has_receiver;
    let stopped = core::mem::take(&mut found.resting).into_iter();
    let stopped: Vec<Entity> = stopped.filter(|it| changed.moving.remove(*it)).collect();
    let has_moved = changed.moving.has_moved_of_late();
    let moving = core::mem::take(&mut found.moving);
    let mut released = changed.moving.update(moving);
    let may_move = found.come.iter().filter(|it| it.1.is_some()).count();
    let are_tried = has_moved && may_move <= MOST_TRIED;
    let is_tried = |it: &(_, Option<_>)| are_tried && it.1.is_some();
    let (tried, come): (Vec<_>, Vec<_>) = found.come.into_iter().partition(is_tried);
    changed
        .moving
        .try_out(tried.into_iter().filter_map(|it| it.1));
    let mut come: Vec<OrientedBox> = come.into_iter().map(|it| it.0).collect();
    released.extend(stopped);
    let are_too_many = changed.moving.len() > most;
    if are_too_many {
        changed.moving.clear();
    }
    let is_urgent = are_too_many || found.has_left || !released.is_empty();
    let mut casters = found.casters;
    for caster in released {
        let record = meshes.get(caster).ok().map(|it| it.record.caster());
        match record.flatten() {
            Some(Some(bounds)) => come.push(bounds),
            anywhere => casters.extend(anywhere),
        }
    }
    let bounds: Option<Vec<_>> = if are_too_many || casters.len() + come.len() > MOST {
        None
    } else {
        casters.into_iter().collect()
    };
    changed.changes = match bounds {
        Some(changed) if !come.is_empty() => CasterChanges::Come {
            changed,
            come,
            is_urgent,
        },
        _ if is_urgent => CasterChanges::AtOnce(bounds),
        Some(bounds) => CasterChanges::At(bounds),
        None => CasterChanges::Anywhere,
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
    updates: RemovedComponents<'w, 's, ShadowUpdates>,
    /// What keeps entities out of queries, the game's own components included.
    disabling: Res<'w, DefaultQueryFilters>,
    all: &'w RemovedComponentMessages,
    enabled: Local<'s, HashMap<ComponentId, MessageCursor<RemovedComponentEntity>>>,
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
        entities.extend(self.updates.read());
        entities
    }

    /// What is enabled again.
    fn read_enabled(&mut self) -> Vec<Entity> {
        let mut entities = Vec::new();
        for component in self.disabling.disabling_ids() {
            if let Some(removed) = self.all.get(component) {
                let cursor = self.enabled.entry(component).or_default();
                entities.extend(cursor.read(removed).cloned().map(Entity::from));
            }
        }
        entities
    }

    fn clear(&mut self) {
        self.read();
        self.read_enabled();
    }
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
