//! Which meshes have changed since the last frame: maps that hold none of them stay as they are.

use bevy::{
    asset::{AssetEvent, AssetId, Assets},
    camera::{
        Camera3d,
        primitives::Aabb,
        visibility::{
            InheritedVisibility, NoAutoAabb, NoFrustumCulling, RenderLayers, VisibilityRange,
            VisibleEntityRanges,
        },
    },
    ecs::{
        change_detection::{DetectChanges, DetectChangesMut, Ref},
        component::Component,
        entity::{Entity, EntityHashSet},
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
        Mesh3d,
        morph::{MeshMorphWeights, MorphWeights},
        skinning::SkinnedMesh,
    },
    pbr::StandardMaterial,
    platform::collections::HashSet,
    reflect::{Reflect, std_traits::ReflectDefault},
    transform::components::GlobalTransform,
    utils::Parallel,
};

use super::bounds::{BoundsMargin, DisplacedMeshes, Margin, world_bounds};
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
    updates: Option<&'static ShadowUpdates>,
    skin: Option<&'static SkinnedMesh>,
    morph: Option<Ref<'static, MeshMorphWeights>>,
    is_unculled: Has<NoFrustumCulling>,
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
        With<ShadowUpdates>,
        With<VisibilityRange>,
        With<SkinnedMesh>,
        With<MeshMorphWeights>,
    )>,
);

/// What casters depend on beside their own components.
#[derive(SystemParam)]
pub struct Surroundings<'w, 's> {
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
            layers: it.layers.cloned().unwrap_or_default(),
            ranges: surroundings.ranges(it),
        };
        let state = if it.inherited.get() {
            CasterRecord::Known(state)
        } else {
            CasterRecord::Nothing
        };
        let updates = it.updates.copied().unwrap_or_default();
        let is_restless = match updates {
            ShadowUpdates::Automatic => {
                displaced.contains(&it.entity) || surroundings.has_moved_inside(it)
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
    mut lost: LostComponents,
    mut changed: ResMut<ChangedCasters>,
    mut local: Local<Parallel<Found>>,
) {
    let displaced = surroundings.displaced.get();
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
    let entities = lost.read().chain(displaced.iter().copied());
    let mut all = meshes.p1();
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
        commands.entity(entity).insert(CasterRecord::default());
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
    no_casters: RemovedComponents<'w, 's, NotShadowCaster>,
    no_receivers: RemovedComponents<'w, 's, NotShadowReceiver>,
    own_bounds: RemovedComponents<'w, 's, NoAutoAabb>,
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
            no_receivers,
            own_bounds,
            ranges,
        } = self;
        let lists = bounds.read().chain(margins.read()).chain(layers.read());
        let lists = lists.chain(unculled.read()).chain(no_casters.read());
        let lists = lists.chain(no_receivers.read()).chain(own_bounds.read());
        lists.chain(ranges.read())
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
        changed.removed.push(core::mem::take(&mut *record));
    }
}
