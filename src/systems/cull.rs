//! Own culling of casters: each cascade gets what meets its slice's hull swept to the light.

use bevy::{
    camera::{
        primitives::{Aabb, CascadesFrusta, Frustum},
        visibility::{
            CascadesVisibleEntities, InheritedVisibility, NoCpuCulling, NoFrustumCulling,
            RenderLayers, SetViewVisibility, ViewVisibility, VisibilityRange, VisibleEntityRanges,
            VisibleMeshEntities,
        },
    },
    ecs::{
        component::Component,
        entity::{Entity, EntityHashMap},
        query::{Has, QueryData, With, Without},
        system::{Local, Query, Res},
    },
    light::{Cascades, DirectionalLight, NotShadowCaster, SpotLight},
    mesh::Mesh3d,
    shape::ViewFrustum,
    transform::components::GlobalTransform,
    utils::Parallel,
};

use super::{
    ManagedLight, ShadowPlans,
    bounds::{BoundsMargin, DisplacedMeshes, Margin, world_bounds},
    publish::{empty_cascade, published_cascade},
};
use crate::{config::CasterCulling, geometry::oriented_box::OrientedBox, plan::CascadePlan};

/// The first and last cascade that a caster is drawn into. One in between may do without it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CascadeRange {
    /// Index of the first.
    pub first: u8,
    /// Index of the last.
    pub last: u8,
}

/// Where a managed light draws its casters, for each active 3D camera.
#[derive(Component, Debug, Default, Clone)]
pub struct CasterCascades {
    /// By camera: casters in the order of their entities. Casters that are drawn into no
    /// cascade are absent, and those with `NoCpuCulling`, which only the GPU culls.
    pub views: EntityHashMap<Vec<(Entity, CascadeRange)>>,
}

impl CasterCascades {
    /// The cascades that `caster` is drawn into for camera `view`; `None` if it is in none.
    pub fn get(&self, view: Entity, caster: Entity) -> Option<CascadeRange> {
        let casters = self.views.get(&view)?;
        let index = casters
            .binary_search_by_key(&caster, |(entity, _)| *entity)
            .ok()?;
        Some(casters[index].1)
    }
}

#[derive(QueryData)]
#[query_data(mutable)]
pub struct Caster {
    entity: Entity,
    inherited: &'static InheritedVisibility,
    visibility: &'static mut ViewVisibility,
    layers: Option<&'static RenderLayers>,
    aabb: Option<&'static Aabb>,
    transform: Option<&'static GlobalTransform>,
    margin: Option<&'static BoundsMargin>,
    has_range: Has<VisibilityRange>,
    is_unculled: Has<NoFrustumCulling>,
}

type IsCaster = (
    Without<NotShadowCaster>,
    Without<DirectionalLight>,
    Without<NoCpuCulling>,
    With<Mesh3d>,
);

#[derive(QueryData)]
#[query_data(mutable)]
pub struct CulledLight {
    light: &'static DirectionalLight,
    managed: &'static ManagedLight,
    plans: &'static ShadowPlans,
    visibility: &'static ViewVisibility,
    layers: Option<&'static RenderLayers>,
    casters: &'static mut CasterCascades,
    cascades: &'static mut Cascades,
    frusta: &'static mut CascadesFrusta,
    lists: &'static mut CascadesVisibleEntities,
}

/// Finds the casters of each cascade, and publishes cascades, frusta and lists in Bevy's
/// components. Runs in [`PssmSystems::CullCasters`](super::PssmSystems::CullCasters).
pub fn cull_casters(
    mut lights: Query<CulledLight, Without<SpotLight>>,
    mut casters: Query<Caster, IsCaster>,
    ranges: Option<Res<VisibleEntityRanges>>,
    displaced: Res<DisplacedMeshes>,
    mut found: Local<Parallel<Vec<(Entity, u8)>>>,
) {
    let displaced = displaced.get();
    for mut it in &mut lights {
        it.casters.views.clear();
        let Some(config) = it.managed.config() else {
            continue;
        };
        let count = config.cascades as usize;
        let casts = it.light.shadow_maps_enabled && it.visibility.get();
        it.lists
            .entities
            .retain(|view, _| casts && it.plans.views.contains_key(view));

        for (view, plan) in &it.plans.views {
            let published: Vec<_> = (0..count)
                .map(|index| {
                    plan.get(index)
                        .map_or_else(empty_cascade, published_cascade)
                })
                .collect();
            let view_frusta = published
                .iter()
                .map(|cascade| Frustum(ViewFrustum::from_clip_from_world(&cascade.clip_from_world)))
                .collect();
            it.cascades.cascades.insert(*view, published);
            it.frusta.frusta.insert(*view, view_frusta);
            if !casts {
                continue;
            }

            casters.par_iter_mut().for_each_init(
                || found.borrow_local_mut(),
                |found, mut caster| {
                    let light_layers = it.layers.unwrap_or_default();
                    let layers_meet = light_layers.intersects(caster.layers.unwrap_or_default());
                    let is_out_of_range = caster.has_range
                        && ranges.as_ref().is_some_and(|ranges| {
                            !ranges.entity_is_in_range_of_view(caster.entity, *view)
                        });
                    if !caster.inherited.get() || !layers_meet || is_out_of_range {
                        return;
                    }
                    let is_culled = config.comparison.culling == CasterCulling::Hull;
                    let bounds = match (caster.aabb, caster.transform) {
                        (Some(aabb), Some(transform)) if is_culled && !caster.is_unculled => {
                            let margin = Margin::of(caster.entity, caster.margin, &displaced);
                            Some(world_bounds(aabb, &transform.affine(), margin))
                        }
                        _ => None,
                    };
                    let mask = cascade_mask(plan, bounds.as_ref());
                    if mask != 0 {
                        caster.visibility.set_visible();
                        found.push((caster.entity, mask));
                    }
                },
            );

            let mut found_casters: Vec<(Entity, u8)> = Vec::new();
            found.drain_into(&mut found_casters);
            found_casters.sort_unstable_by_key(|(entity, _)| *entity);

            let view_lists = it.lists.entities.entry(*view).or_default();
            view_lists.resize_with(count, VisibleMeshEntities::default);
            for (index, list) in view_lists.iter_mut().enumerate() {
                list.entities.clear();
                list.entities.extend(
                    found_casters
                        .iter()
                        .filter(|(_, mask)| mask & (1 << index) != 0)
                        .map(|(entity, _)| *entity),
                );
                list.shrink();
            }
            let to_range = |(entity, mask): &(Entity, u8)| {
                let range = CascadeRange {
                    first: mask.trailing_zeros() as u8,
                    last: (7 - mask.leading_zeros()) as u8,
                };
                (*entity, range)
            };
            it.casters
                .views
                .insert(*view, found_casters.iter().map(to_range).collect());
        }
    }
}

/// Bit `i` is set if the caster matters to cascade `i`. Without bounds it matters to all that
/// have a map.
fn cascade_mask(plan: &[CascadePlan], bounds: Option<&OrientedBox>) -> u8 {
    plan.iter()
        .enumerate()
        .filter_map(|(index, cascade)| Some((index, cascade.map.as_ref()?)))
        .filter(|(_, map)| bounds.is_none_or(|bounds| map.hull.intersects_box(bounds)))
        .fold(0, |mask, (index, _)| mask | (1 << index))
}
