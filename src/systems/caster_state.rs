//! What a caster's shadow depends on, and whether that has changed.

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
        change_detection::{DetectChanges, DetectChangesMut, Ref},
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
    reflect::{Reflect, std_traits::ReflectDefault},
    transform::components::GlobalTransform,
};

use super::{
    bounds::{BoundsMargin, DisplacedMeshes, Margin, world_bounds},
    moving::MovingCasters,
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

/// More changed casters than this are not told apart: most maps hold some.
pub const MOST: usize = 4096;

impl CasterRecord {
    /// Where it casts from, if it does; `Some(None)` for anywhere.
    pub fn caster(&self) -> Option<Option<OrientedBox>> {
        match self {
            Self::Nothing => None,
            Self::Unknown => Some(None),
            Self::Known(state) => state.casts.then(|| {
                let (aabb, margin) = state.bounds.as_ref()?;
                Some(world_bounds(aabb, &state.transform, *margin))
            }),
        }
    }

    /// Whether it is the same somewhere else.
    fn differs_by_place(&self, other: &Self) -> bool {
        let (Self::Known(one), Self::Known(other)) = (self, other) else {
            return false;
        };
        one.transform != other.transform
            && *one
                == CasterState {
                    transform: one.transform,
                    bounds: one.bounds,
                    ..other.clone()
                }
    }
}

#[derive(QueryData)]
#[query_data(mutable)]
pub struct ChangingCaster {
    entity: Entity,
    pub record: &'static mut CasterRecord,
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
    pub casters: Vec<Option<OrientedBox>>,
    /// Casters that have moved, or bent.
    pub moving: Vec<Entity>,
    /// Casters that are to count as resting, whatever they do.
    pub resting: Vec<Entity>,
    pub has_receiver: bool,
}

impl Found {
    /// Compares a mesh with what it was. `known_moving` have been found moving before: no map of what rests
    /// holds them.
    pub fn compare(
        &mut self,
        it: &mut ChangingCasterItem,
        surroundings: &Surroundings,
        displaced: &EntityHashSet,
        known_moving: &MovingCasters,
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
        if has_new_updates {
            match updates {
                ShadowUpdates::Never => self.resting.push(it.entity),
                // Maps may have it where it was long ago.
                ShadowUpdates::Automatic | ShadowUpdates::Always => self.casters.push(None),
            }
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
            let moves = is_restless || record.differs_by_place(&state);
            if moves && !it.is_gpu_culled && state.caster().is_some() {
                self.moving.push(it.entity);
            }
            if !known_moving.contains(it.entity) || it.is_gpu_culled {
                self.casters.extend(state.caster());
                if !is_same {
                    self.casters.extend(record.caster());
                }
            }
        }
        if !is_same {
            *record = state;
        }
    }
}
