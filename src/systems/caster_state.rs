//! What a caster's shadow depends on, and whether that has changed.

use core::hash::BuildHasher;

use bevy::{
    asset::AssetId,
    camera::{
        Camera3d, ShadowLodOrigin,
        primitives::Aabb,
        visibility::{
            InheritedVisibility, NoAutoAabb, NoCpuCulling, NoFrustumCulling, RenderLayers,
            VisibilityRange, VisibleEntityRanges,
        },
    },
    ecs::{
        change_detection::{ContiguousRef, DetectChanges, DetectChangesMut, Ref, Tick},
        component::Component,
        entity::{Entity, EntityHashSet},
        query::{Has, Or, QueryData, With},
        reflect::ReflectComponent,
        system::{Query, Res, SystemParam},
    },
    light::{NotShadowCaster, NotShadowReceiver},
    math::Affine3A,
    mesh::{
        Mesh, Mesh3d,
        morph::{MeshMorphWeights, MorphWeights},
        skinning::SkinnedMesh,
    },
    platform::hash::FixedHasher,
    reflect::{Reflect, std_traits::ReflectDefault},
    transform::components::GlobalTransform,
};

use super::{
    bounds::{BoundsMargin, DisplacedMeshes, Margin, world_bounds},
    casters::is_somewhere,
    moving::MovingCasters,
    rows::{ROWS, any_newer, newer, rows_where},
};
use crate::geometry::oriented_box::OrientedBox;

/// How often a caster's shadow is drawn anew. Without it: when it has changed ([`Self::Automatic`]).
///
/// On a managed light, `Always` has all its maps drawn in every frame, those without casters too: for other
/// crates' systems that draw into them, in [`DrawShadowMap`](crate::DrawShadowMap).
#[derive(Component, Reflect, Debug, Default, Clone, Copy, PartialEq, Eq, Hash)]
#[reflect(Component, Default, Debug, Clone, PartialEq, Hash)]
pub enum ShadowUpdates {
    /// When its transform, mesh, material, visibility, layers, level of detail or pose has changed; in
    /// every frame if its material has a vertex shader of its own, or while its mesh or material changes again and again.
    #[default]
    Automatic,
    /// In every frame.
    Always,
    /// When it is spawned, despawned, shown or hidden, and when the map is drawn anew for another reason. For what
    /// changes and need not show it, as a vertex shader that does not move anything, or a material that glows: its first
    /// few edits show, for it may be loading, and then none.
    Never,
}

/// What a mesh's shadow depends on, as of the last frame.
#[derive(Component, Debug, Default, Clone, PartialEq)]
// A copy of a mesh is in no map.
#[component(clone_behavior = Ignore)]
pub enum CasterRecord {
    /// It is not there, or hidden.
    #[default]
    Nothing,
    Known(CasterState),
}

#[derive(Debug, Clone, PartialEq)]
pub struct CasterState {
    transform: Affine3A,
    /// `None` if it is not culled.
    bounds: Option<(Aabb, Margin)>,
    kind: CasterKind,
    updates: ShadowUpdates,
}

/// What a mesh is, wherever it is.
#[derive(Debug, Clone, PartialEq)]
struct CasterKind {
    casts: bool,
    receives: bool,
    has_no_auto_aabb: bool,
    is_gpu_culled: bool,
    mesh: AssetId<Mesh>,
    is_skinned: bool,
    is_morphed: bool,
    layers: RenderLayers,
    /// A hash of the views for which it is in the range of its level of detail.
    ranges: u64,
}

impl CasterRecord {
    /// Where it casts from, if it does; `Some(None)` for anywhere. What the GPU culls is drawn into all of a map, also
    /// where its casters do not matter yet.
    pub fn caster(&self) -> Option<Option<OrientedBox>> {
        match self {
            Self::Nothing => None,
            Self::Known(state) => state.kind.casts.then(|| {
                let bounds = state.bounds.as_ref();
                let (aabb, margin) = bounds.filter(|_| !state.kind.is_gpu_culled)?;
                Some(world_bounds(aabb, &state.transform, *margin))
            }),
        }
    }

    fn casts(&self) -> bool {
        matches!(self, Self::Known(state) if state.kind.casts)
    }

    /// Whether it is the same somewhere else.
    fn differs_by_place(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Known(one), Self::Known(other)) => {
                one.transform != other.transform && one.kind == other.kind
            }
            _ => false,
        }
    }
}

#[derive(QueryData)]
#[query_data(mutable, contiguous(immutable))]
pub struct ChangingCaster {
    pub entity: Entity,
    pub record: &'static mut CasterRecord,
    transform: Ref<'static, GlobalTransform>,
    inherited: Ref<'static, InheritedVisibility>,
    mesh: Ref<'static, Mesh3d>,
    aabb: Option<Ref<'static, Aabb>>,
    margin: Option<Ref<'static, BoundsMargin>>,
    layers: Option<Ref<'static, RenderLayers>>,
    updates: Option<Ref<'static, ShadowUpdates>>,
    skin: Option<Ref<'static, SkinnedMesh>>,
    morph: Option<Ref<'static, MeshMorphWeights>>,
    unculled: Option<Ref<'static, NoFrustumCulling>>,
    gpu_culled: Option<Ref<'static, NoCpuCulling>>,
    no_caster: Option<Ref<'static, NotShadowCaster>>,
    no_receiver: Option<Ref<'static, NotShadowReceiver>>,
    no_auto_aabb: Option<Ref<'static, NoAutoAabb>>,
    has_range: Has<VisibilityRange>,
}

impl ChangingCasterReadOnlyContiguousItem<'_, '_> {
    /// The meshes that may have changed: whatever of theirs has been written since the system last ran, or changes by
    /// something else.
    pub fn suspects(&self, suspects: &mut Vec<Entity>) {
        let changes_unwritten = self.has_range || self.skin.is_some() || self.morph.is_some();
        if changes_unwritten {
            suspects.extend(self.entity);
            return;
        }
        fn ticks<'a, T>(column: &Option<ContiguousRef<'a, T>>) -> Option<&'a [Tick]> {
            Some(column.as_ref()?.changed_ticks_slice())
        }
        let columns = [
            Some(self.transform.changed_ticks_slice()),
            Some(self.inherited.changed_ticks_slice()),
            Some(self.mesh.changed_ticks_slice()),
            ticks(&self.aabb),
            ticks(&self.margin),
            ticks(&self.updates),
            ticks(&self.layers),
            ticks(&self.unculled),
            ticks(&self.gpu_culled),
            ticks(&self.no_caster),
            ticks(&self.no_receiver),
            ticks(&self.no_auto_aabb),
        ];
        let columns = || columns.iter().flatten();
        let updates = self.updates.as_deref().unwrap_or_default();
        let [last_run, this_run] = [
            self.transform.last_run_tick(),
            self.transform.this_run_tick(),
        ];
        for first in (0..self.entity.len()).step_by(ROWS) {
            let rows = first..self.entity.len().min(first + ROWS);
            let mut written = columns()
                .map(|ticks| &ticks[rows.clone()])
                .filter(|ticks| any_newer(ticks, last_run, this_run))
                .fold(0, |rows, ticks| rows | newer(ticks, last_run, this_run));
            // Whether written or not.
            let updates = updates.get(rows).unwrap_or_default();
            written |= rows_where(updates.iter(), |it| *it == ShadowUpdates::Always);
            while written != 0 {
                suspects.push(self.entity[first + written.trailing_zeros() as usize]);
                written &= written - 1;
            }
        }
    }
}

impl ChangingCasterReadOnlyItem<'_, '_> {
    pub fn is_never_updated(&self) -> bool {
        self.updates.as_deref() == Some(&ShadowUpdates::Never)
    }
}

impl ChangingCasterItem<'_, '_> {
    fn state(&self, surroundings: &Surroundings, displaced: &EntityHashSet) -> CasterRecord {
        // What is nowhere would differ from itself in every frame.
        if !self.inherited.get() || !is_somewhere(&self.transform) {
            return CasterRecord::Nothing;
        }
        let margin = Margin::of(self.entity, self.margin.as_deref(), displaced);
        let bounds = self.aabb.as_deref().map(|aabb| (*aabb, margin));
        CasterRecord::Known(CasterState {
            transform: self.transform.affine(),
            bounds: bounds.filter(|_| self.unculled.is_none()),
            kind: CasterKind {
                casts: self.no_caster.is_none(),
                receives: self.no_receiver.is_none(),
                has_no_auto_aabb: self.no_auto_aabb.is_some(),
                is_gpu_culled: self.gpu_culled.is_some(),
                mesh: self.mesh.id(),
                is_skinned: self.skin.is_some(),
                is_morphed: self.morph.is_some(),
                layers: self.layers.as_deref().cloned().unwrap_or_default(),
                ranges: surroundings.ranges(self),
            },
            updates: self.updates(),
        })
    }

    fn updates(&self) -> ShadowUpdates {
        self.updates.as_deref().copied().unwrap_or_default()
    }

    /// Whether it counts as moving though it may be the same.
    fn is_restless(&self, surroundings: &Surroundings, displaced: &EntityHashSet) -> bool {
        match self.updates() {
            ShadowUpdates::Automatic => {
                displaced.contains(&self.entity) || surroundings.may_have_changed(self)
            }
            ShadowUpdates::Always => true,
            ShadowUpdates::Never => false,
        }
    }

    /// Whether it can be drawn over maps of what rests.
    fn can_move(&self, state: &CasterRecord) -> bool {
        self.gpu_culled.is_none() && state.casts()
    }

    /// Notes what it is, whatever it was, and says whether it counts as moving.
    pub fn note(&mut self, surroundings: &Surroundings, displaced: &EntityHashSet) -> bool {
        let state = self.state(surroundings, displaced);
        let moves = self.is_restless(surroundings, displaced) && self.can_move(&state);
        *self.record.bypass_change_detection() = state;
        moves
    }
}

/// What casters depend on beside their own components.
#[derive(SystemParam)]
pub struct Surroundings<'w, 's> {
    pub displaced: Res<'w, DisplacedMeshes>,
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
        let may_switch = it.has_range && it.gpu_culled.is_some();
        let is_switched = may_switch && self.cameras.iter().any(has_moved);
        is_bent || is_morphed || is_switched
    }

    /// A hash of the views, in whatever order, and however many there are besides.
    fn ranges(&self, it: &ChangingCasterItem) -> u64 {
        let Some(ranges) = self.ranges.as_ref().filter(|_| it.has_range) else {
            return u64::MAX;
        };
        let views = self.cameras.iter();
        let views = views.filter(|view| ranges.entity_is_in_range_of_view(it.entity, *view));
        views.fold(0, |hash, view| hash ^ FixedHasher.hash_one(view))
    }
}

/// What has been found of meshes.
#[derive(Default)]
pub struct Found {
    /// Where casters were and are; `None` for anywhere.
    pub casters: Vec<Option<OrientedBox>>,
    /// Where those are that have come, and that no map holds; and which, if they may yet move.
    pub come: Vec<(OrientedBox, Option<Entity>)>,
    /// Some are in no map any more.
    pub has_left: bool,
    /// Casters that have moved, or bent.
    pub moving: Vec<Entity>,
    /// Casters that are to count as resting, whatever they do.
    pub resting: Vec<Entity>,
    pub has_receiver: bool,
}

impl Found {
    /// Whether more has changed than is told apart. What begins to move is in both places, and more may have
    /// changed where it is.
    pub fn is_flood(&self, most: usize) -> bool {
        self.moving.len() > most || self.casters.len() + self.come.len() > 4 * most
    }

    /// Takes what another has found.
    pub fn append(&mut self, other: &mut Self) {
        self.casters.append(&mut other.casters);
        self.come.append(&mut other.come);
        self.moving.append(&mut other.moving);
        self.resting.append(&mut other.resting);
        self.has_left |= core::mem::take(&mut other.has_left);
        self.has_receiver |= core::mem::take(&mut other.has_receiver);
    }

    /// Compares a mesh with what it was. `known_moving` have been found moving before: no map of what rests
    /// holds them.
    pub fn compare(
        &mut self,
        it: &mut ChangingCasterItem,
        surroundings: &Surroundings,
        displaced: &EntityHashSet,
        known_moving: &MovingCasters,
    ) {
        let state = it.state(surroundings, displaced);
        let updates = it.updates();
        let never = ShadowUpdates::Never;
        if updates == never && known_moving.contains(it.entity) {
            self.resting.push(it.entity);
        }
        let was_never = matches!(&*it.record, CasterRecord::Known(it) if it.updates == never);
        // Maps may have it where it was long ago.
        let may_be_anywhere = was_never && it.record.casts() && updates != never;
        if may_be_anywhere {
            self.casters.push(None);
        }
        let is_edited =
            updates == ShadowUpdates::Automatic && known_moving.edited().contains(&it.entity);
        let is_restless = is_edited || it.is_restless(surroundings, displaced);
        let is_same = *it.record == state;
        self.has_receiver |= !is_same;
        // Whatever does not count while it is there, what comes and what goes does.
        let comes_or_goes = || !(it.record.casts() && state.casts());
        if is_restless || !is_same && (updates != never || comes_or_goes()) {
            let moves = is_restless || it.record.differs_by_place(&state);
            let is_over_maps = moves && it.can_move(&state);
            if is_over_maps {
                self.moving.push(it.entity);
            }
            let is_in_maps = !known_moving.contains(it.entity) || it.gpu_culled.is_some();
            if is_in_maps && !may_be_anywhere {
                let (before, now) = (it.record.caster(), state.caster());
                match (before, now) {
                    (None, Some(Some(_))) if is_over_maps => {}
                    (None, Some(Some(bounds))) => {
                        let may_move = updates != never;
                        self.come.push((bounds, may_move.then_some(it.entity)));
                    }
                    (before, now) => {
                        self.has_left |= before.is_some() && (now.is_none() || is_over_maps);
                        self.casters.extend(now);
                        self.casters.extend(before.filter(|_| !is_same));
                    }
                }
            }
        }
        if !is_same {
            *it.record.bypass_change_detection() = state;
        }
    }
}
