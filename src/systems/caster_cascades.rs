//! Which casters are drawn into which cascades.

use bevy::ecs::{
    component::Component,
    entity::{Entity, EntityHashMap},
};

use crate::config::MAX_CASCADES;

/// The cascades that a caster is drawn into.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct CascadeSet(u8);

impl CascadeSet {
    /// Whether a cascade is one of them.
    pub fn contains(self, cascade: usize) -> bool {
        cascade < MAX_CASCADES && self.0 & (1 << cascade) != 0
    }

    /// Their indices, in order.
    pub fn iter(self) -> impl Iterator<Item = usize> {
        (0..MAX_CASCADES).filter(move |index| self.contains(*index))
    }

    pub(super) fn of(cascades: impl Iterator<Item = usize>) -> Self {
        Self(cascades.fold(0, |set, index| set | (1 << index)))
    }

    pub(super) fn insert(&mut self, cascade: usize) {
        self.0 |= 1 << cascade;
    }

    pub(super) fn and(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    pub(super) fn or(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    pub(super) fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    pub(super) fn is_empty(self) -> bool {
        self.0 == 0
    }
}

/// Where a managed light draws its casters, for each active 3D camera.
#[derive(Component, Debug, Default, Clone)]
pub struct CasterCascades {
    /// By camera: casters that maps hold, in the order of their entities. Casters that are drawn into no
    /// cascade are absent, and those with `NoCpuCulling`, which only the GPU culls.
    pub views: EntityHashMap<Vec<(Entity, CascadeSet)>>,
    /// By camera: those of them that are drawn in this frame into maps that hold the others already
    /// ([`Redraw::Added`](crate::plan::Redraw::Added)), with the cascades of those maps.
    pub added: EntityHashMap<Vec<(Entity, CascadeSet)>>,
    /// By camera: casters that move, in the order of their entities. They are drawn over maps in each frame.
    pub moving: EntityHashMap<Vec<(Entity, CascadeSet)>>,
}

impl CasterCascades {
    /// The cascades that `caster` is drawn into for camera `view`; `None` if it is in none.
    pub fn get(&self, view: Entity, caster: Entity) -> Option<CascadeSet> {
        [&self.views, &self.moving].into_iter().find_map(|views| {
            let cascades = cascades_of(views.get(&view)?, caster);
            (!cascades.is_empty()).then_some(cascades)
        })
    }
}

/// Those of a caster in a list in the order of entities; none if it is not in it.
pub(super) fn cascades_of(casters: &[(Entity, CascadeSet)], caster: Entity) -> CascadeSet {
    let found = casters.binary_search_by_key(&caster, |(entity, _)| *entity);
    found.map_or_else(|_| CascadeSet::default(), |index| casters[index].1)
}
