//! Which meshes have changed since the last frame: maps that hold none of them stay as they are.

use bevy::{
    asset::{AssetEvent, AssetId, Assets},
    camera::{
        Camera3d, ShadowLodOrigin,
        primitives::Aabb,
        visibility::{
            InheritedVisibility, NoAutoAabb, NoCpuCulling, NoFrustumCulling, RenderLayers,
            VisibilityRange, VisibleEntityRanges,
        },
    },
    ecs::{
        change_detection::{DetectChanges, DetectChangesMut, Ref},
        component::Component,
        entity::{Entity, EntityHashSet},
        entity_disabling::Disabled,
        lifecycle::{Remove, RemovedComponents},
        message::MessageReader,
        observer::On,
        query::{Added, Changed, Has, Or, QueryData, With, Without},
        reflect::ReflectComponent,
        resource::Resource,
        system::{Commands, Local, ParamSet, Query, Res, ResMut, SystemParam},
    },
    image::Image,
    light::{NotShadowCaster, NotShadowReceiver},
    material::AlphaMode,
    math::Affine3A,
    mesh::{
        Mesh, Mesh3d,
        morph::{MeshMorphWeights, MorphWeights},
        skinning::SkinnedMesh,
    },
    pbr::StandardMaterial,
    platform::collections::HashSet,
    reflect::{Reflect, std_traits::ReflectDefault},
    transform::components::GlobalTransform,
    utils::Parallel,
};

use super::{
    ManagedLight,
    bounds::{BoundsMargin, DisplacedMeshes, Margin, world_bounds},
};
use crate::{geometry::oriented_box::OrientedBox, plan::CasterChanges};

/// How often a caster's shadow is drawn anew. Without it: when it has changed ([`Self::Automatic`]).
///
/// On a managed light, `Always` has all its maps drawn in every frame, those without casters too: for other
/// crates' systems that draw into them, in [`DrawShadowMap`](crate::DrawShadowMap).
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
pub enum CasterRecord {
    /// It is not there, or hidden.
    #[default]
    Nothing,
    /// Too much has changed at once to note it all.
    Unknown,
    Known(CasterState),
}

#[derive(Debug, Clone, PartialEq)]
pub struct CasterState {
    casts: bool,
    receives: bool,
    has_no_auto_aabb: bool,
    transform: Affine3A,
    /// `None` if it is not culled.
    bounds: Option<(Aabb, Margin)>,
    is_gpu_culled: bool,
    mesh: AssetId<Mesh>,
    is_skinned: bool,
    is_morphed: bool,
    layers: RenderLayers,
    /// The views for which it is in the range of its level of detail.
    ranges: u32,
}

/// Where meshes have changed since the last frame.
#[derive(Resource, Debug, Default)]
pub struct ChangedCasters {
    changes: CasterChanges,
    /// Whether anything has changed of what meshes receive shadows with.
    have_receivers_changed: bool,
    /// What has gone since then.
    removed: Vec<CasterRecord>,
    /// Whether an image that masks casters has changed since then.
    has_new_mask: bool,
}

impl ChangedCasters {
    pub fn get(&self) -> &CasterChanges {
        &self.changes
    }

    /// Whether any mesh may receive shadows in another place than in the last frame.
    pub fn have_receivers_changed(&self) -> bool {
        self.have_receivers_changed
    }
}

/// More changed casters than this are not told apart: most maps hold some.
const MOST: usize = 4096;

impl CasterRecord {
    /// Where it casts from, if it does; `Some(None)` for anywhere.
    fn caster(&self) -> Option<Option<OrientedBox>> {
        match self {
            Self::Nothing => None,
            Self::Unknown => Some(None),
            Self::Known(state) => state.casts.then(|| {
                let (aabb, margin) = state.bounds.as_ref()?;
                Some(world_bounds(aabb, &state.transform, *margin))
            }),
        }
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
    updates: Option<Ref<'static, ShadowUpdates>>,
    mesh: &'static Mesh3d,
    skin: Option<Ref<'static, SkinnedMesh>>,
    morph: Option<Ref<'static, MeshMorphWeights>>,
    is_unculled: Has<NoFrustumCulling>,
    is_gpu_culled: Has<NoCpuCulling>,
    casts_none: Has<NotShadowCaster>,
    receives_none: Has<NotShadowReceiver>,
    has_no_auto_aabb: Has<NoAutoAabb>,
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

/// What casters depend on beside their own components.
#[derive(SystemParam)]
pub struct Surroundings<'w, 's> {
    displaced: Res<'w, DisplacedMeshes>,
    ranges: Option<Res<'w, VisibleEntityRanges>>,
    cameras: Query<'w, 's, Entity, Or<(With<Camera3d>, With<ShadowLodOrigin>)>>,
    transforms: Query<'w, 's, Ref<'static, GlobalTransform>>,
    morphs: Query<'w, 's, Ref<'static, MorphWeights>>,
}

impl Surroundings<'_, '_> {
    /// Whether something that no component of its own tells may have changed its shadow.
    fn may_have_changed(&self, it: &ChangingCasterItem) -> bool {
        let has_moved = |entity| self.transforms.get(entity).is_ok_and(|at| at.is_changed());
        let is_bent = it.skin.as_ref().is_some_and(|skin| {
            skin.is_changed() || skin.joints.iter().any(|joint| has_moved(*joint))
        });
        let is_morphed = it.morph.as_ref().is_some_and(|weights| {
            let referred = match &**weights {
                MeshMorphWeights::Reference(entity) => self.morphs.get(*entity).ok(),
                MeshMorphWeights::Value { .. } => None,
            };
            weights.is_changed() || referred.is_some_and(|weights| weights.is_changed())
        });
        // Its level of detail is chosen on the GPU.
        let may_switch = it.has_range && it.is_gpu_culled;
        let is_switched = may_switch && self.cameras.iter().any(has_moved);
        is_bent || is_morphed || is_switched
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

/// What has been found of a thread's share of meshes.
#[derive(Default)]
pub struct Found {
    /// Where casters were and are; `None` for anywhere.
    casters: Vec<Option<OrientedBox>>,
    has_receiver: bool,
}

impl Found {
    /// Compares a mesh with what it was.
    fn compare(
        &mut self,
        it: &mut ChangingCasterItem,
        surroundings: &Surroundings,
        displaced: &EntityHashSet,
    ) {
        if self.casters.len() > MOST {
            self.has_receiver = true;
            *it.record.bypass_change_detection() = CasterRecord::Unknown;
            return;
        }
        let margin = Margin::of(it.entity, it.margin, displaced);
        let bounds = it.aabb.map(|aabb| (*aabb, margin));
        let state = CasterState {
            casts: !it.casts_none,
            receives: !it.receives_none,
            has_no_auto_aabb: it.has_no_auto_aabb,
            transform: it.transform.affine(),
            bounds: bounds.filter(|_| !it.is_unculled),
            is_gpu_culled: it.is_gpu_culled,
            mesh: it.mesh.id(),
            is_skinned: it.skin.is_some(),
            is_morphed: it.morph.is_some(),
            layers: it.layers.cloned().unwrap_or_default(),
            ranges: surroundings.ranges(it),
        };
        let state = if it.inherited.get() {
            CasterRecord::Known(state)
        } else {
            CasterRecord::Nothing
        };
        let updates = it
            .updates
            .as_ref()
            .map_or_else(ShadowUpdates::default, |it| **it);
        let has_new_updates = it.updates.as_ref().is_some_and(DetectChanges::is_changed);
        if has_new_updates && updates != ShadowUpdates::Never {
            // Maps may have it where it was long ago.
            self.casters.push(None);
        }
        let is_restless = match updates {
            ShadowUpdates::Automatic => {
                displaced.contains(&it.entity) || surroundings.may_have_changed(it)
            }
            ShadowUpdates::Always => true,
            ShadowUpdates::Never => false,
        };
        let record = it.record.bypass_change_detection();
        let is_same = *record == state;
        self.has_receiver |= !is_same;
        if is_restless || !is_same && updates != ShadowUpdates::Never {
            self.casters.extend(state.caster());
            if !is_same {
                self.casters.extend(record.caster());
            }
        }
        if !is_same {
            *record = state;
        }
    }
}

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
        changed.changes = CasterChanges::Anywhere;
        changed.have_receivers_changed = true;
        *was_idle = true;
        return;
    }
    let displaced = surroundings.displaced.get();
    if core::mem::take(&mut *was_idle) {
        // Nobody has looked at them in the meantime.
        meshes.p1().par_iter_mut().for_each_init(
            || local.borrow_local_mut(),
            |found, mut it| found.compare(&mut it, &surroundings, &displaced),
        );
    }
    meshes.p0().par_iter_mut().for_each_init(
        || local.borrow_local_mut(),
        |found, mut it| found.compare(&mut it, &surroundings, &displaced),
    );
    let mut found = Found {
        has_receiver: !changed.removed.is_empty(),
        casters: Vec::new(),
    };
    let removed = changed.removed.drain(..);
    found
        .casters
        .extend(removed.filter_map(|record| record.caster()));
    for of_thread in local.iter_mut() {
        found.casters.append(&mut of_thread.casters);
        found.has_receiver |= core::mem::take(&mut of_thread.has_receiver);
    }
    let mut all = meshes.p1();
    for entity in lost.enabled.read() {
        if let Ok(mut it) = all.get_mut(entity) {
            *it.record = CasterRecord::Nothing;
        }
    }
    if lost.updates.read().count() > 0 {
        found.casters.push(None);
    }
    let entities = lost.read().into_iter().chain(displaced.iter().copied());
    for entity in entities {
        if let Ok(mut it) = all.get_mut(entity) {
            found.compare(&mut it, &surroundings, &displaced);
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
    let bounds = (found.casters.len() <= MOST).then(|| found.casters.into_iter().collect());
    let bounds: Option<Vec<_>> = bounds.flatten();
    changed.changes = bounds.map_or(CasterChanges::Anywhere, CasterChanges::At);
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
    enabled: RemovedComponents<'w, 's, Disabled>,
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
        entities
    }

    fn clear(&mut self) {
        self.read();
        self.enabled.clear();
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
    if let Ok(mut record) = casters.get_mut(removed.entity) {
        let record = core::mem::take(&mut *record);
        if record != CasterRecord::Nothing {
            changed.removed.push(record);
        }
    }
}
