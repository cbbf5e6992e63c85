//! What is published in Bevy's components, for whatever reads those.

use bevy::{
    camera::{
        primitives::{CascadesFrusta, Frustum},
        visibility::{CascadesVisibleEntities, VisibleMeshEntities},
    },
    ecs::{
        component::Component,
        entity::{Entity, EntityHashMap},
        query::QueryData,
    },
    light::{CascadeShadowConfig, Cascades, cascade::Cascade},
    math::{Mat4, Vec3},
};

use crate::{
    config::ParallelSplitShadows,
    plan::{CascadePlan, split_planes},
};

/// What is published of a managed light, while Bevy is not to see it.
#[derive(Component, Debug, Default, Clone)]
pub struct HiddenCascades {
    cascades: EntityHashMap<Vec<Cascade>>,
    frusta: EntityHashMap<Vec<Frustum>>,
    lists: EntityHashMap<Vec<VisibleMeshEntities>>,
}

/// Where a managed light's cascades, frusta and lists are published.
#[derive(QueryData)]
#[query_data(mutable)]
pub struct PublishedCascades {
    pub cascades: &'static mut Cascades,
    pub frusta: &'static mut CascadesFrusta,
    pub lists: &'static mut CascadesVisibleEntities,
    hidden: &'static mut HiddenCascades,
}

impl PublishedCascadesItem<'_, '_> {
    /// Takes all of it away, and what Bevy has put there, until it is shown again: Bevy would cull for what it
    /// sees of cascades, and drop lists of views that it culls nothing for.
    pub fn hide(&mut self) {
        *self.hidden = HiddenCascades {
            cascades: core::mem::take(&mut self.cascades.cascades),
            frusta: core::mem::take(&mut self.frusta.frusta),
            lists: core::mem::take(&mut self.lists.entities),
        };
    }

    /// Brings back what was hidden, of the views that it is still for.
    pub fn show(&mut self, is_for: impl Fn(Entity) -> bool) {
        let HiddenCascades {
            mut cascades,
            mut frusta,
            mut lists,
        } = core::mem::take(&mut *self.hidden);
        cascades.retain(|view, _| is_for(*view));
        frusta.retain(|view, _| is_for(*view));
        lists.retain(|view, _| is_for(*view));
        self.cascades.cascades = cascades;
        self.frusta.frusta = frusta;
        self.lists.entities = lists;
    }
}

/// Publishes for a guest what is published for its host. Whether there is any.
pub(super) fn publish_alike<T: Clone>(
    published: &mut EntityHashMap<Vec<T>>,
    guest: Entity,
    host: Entity,
) -> bool {
    let Some(of_host) = published.remove(&host) else {
        return false;
    };
    published.entry(guest).or_default().clone_from(&of_host);
    published.insert(host, of_host);
    true
}

/// A plan in the terms of Bevy's component.
pub(super) fn published_cascade(plan: &CascadePlan) -> Cascade {
    plan.map.as_ref().map_or_else(empty_cascade, |map| Cascade {
        world_from_cascade: map.world_from_cascade.as_mat4(),
        clip_from_cascade: map.clip_from_cascade.as_mat4(),
        clip_from_world: map.clip_from_world.as_mat4(),
        texel_size: map.texel.max_element() as f32,
    })
}

/// A cascade that covers nothing anyone will see, with matrices that can still be inverted.
pub(crate) fn empty_cascade() -> Cascade {
    const FAR_OUT: f32 = 1e9;
    let clip_from_world = Mat4::from_translation(Vec3::splat(FAR_OUT));
    Cascade {
        world_from_cascade: Mat4::from_translation(Vec3::splat(-FAR_OUT)),
        clip_from_cascade: Mat4::IDENTITY,
        clip_from_world,
        texel_size: 1.0,
    }
}

/// The configuration in the terms of Bevy's component.
pub(super) fn published_config(config: &ParallelSplitShadows) -> CascadeShadowConfig {
    let (near, far) = (f64::from(config.near), f64::from(config.far));
    let planes = split_planes(&config.splits, near, far, config.cascades as usize);
    // Bevy has one proportion of the far bound for all cascades: the least of the slices'.
    let overlap = planes
        .windows(2)
        .map(|slice| f64::from(config.blend) * (slice[1] - slice[0]) / slice[1])
        .fold(f64::INFINITY, f64::min);
    CascadeShadowConfig {
        bounds: planes[1..].iter().map(|plane| *plane as f32).collect(),
        overlap_proportion: overlap as f32,
        minimum_distance: config.near,
    }
}
