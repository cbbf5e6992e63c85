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
use crate::{
    config::{CasterCulling, MAX_CASCADES},
    geometry::oriented_box::OrientedBox,
    plan::CascadePlan,
};

/// The cascades that a caster is drawn into.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CascadeSet(u8);

impl CascadeSet {
    /// Whether a cascade is one of them.
    pub fn contains(self, cascade: usize) -> bool {
        self.iter().any(|it| it == cascade)
    }

    /// Their indices, in order.
    pub fn iter(self) -> impl Iterator<Item = usize> {
        (0..MAX_CASCADES).filter(move |index| self.0 & (1 << index) != 0)
    }

    fn of(cascades: impl Iterator<Item = usize>) -> Self {
        Self(cascades.fold(0, |set, index| set | (1 << index)))
    }

    fn and(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    fn is_empty(self) -> bool {
        self.0 == 0
    }
}

/// Where a managed light draws its casters, for each active 3D camera.
#[derive(Component, Debug, Default, Clone)]
pub struct CasterCascades {
    /// By camera: casters in the order of their entities. Casters that are drawn into no
    /// cascade are absent, and those with `NoCpuCulling`, which only the GPU culls.
    pub views: EntityHashMap<Vec<(Entity, CascadeSet)>>,
}

impl CasterCascades {
    /// The cascades that `caster` is drawn into for camera `view`; `None` if it is in none.
    pub fn get(&self, view: Entity, caster: Entity) -> Option<CascadeSet> {
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
    mut found: Local<Parallel<Vec<(Entity, CascadeSet)>>>,
) {
    let displaced = displaced.get();
    for mut it in &mut lights {
        let Some(config) = it.managed.config() else {
            it.casters.views.clear();
            continue;
        };
        let count = config.cascades as usize;
        let casts = it.light.shadow_maps_enabled && it.visibility.get();
        let is_planned = |view: &Entity| casts && it.plans.views.contains_key(view);
        it.casters.views.retain(|view, _| is_planned(view));
        if !it.lists.entities.keys().all(is_planned) {
            it.lists.entities.retain(|view, _| is_planned(view));
        }

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

            // Lists of maps that are held stay as they are, and what is in them stays visible.
            let lists = it.lists.entities.get(view).map(Vec::len);
            let is_known = it.casters.views.contains_key(view) && lists == Some(count);
            let known = it.casters.views.entry(*view).or_default();
            let held = CascadeSet::of(held(plan).filter(|_| is_known));
            known.retain_mut(|(_, cascades)| {
                *cascades = cascades.and(held);
                !cascades.is_empty()
            });
            let mut still_visible = casters.iter_many_mut(known.iter().map(|(caster, _)| caster));
            while let Some(caster) = still_visible.fetch_next() {
                if let Ok(mut caster) = caster {
                    caster.visibility.set_visible();
                }
            }
            let culled = CascadeSet::of(0..count).without(held);
            if culled.is_empty() {
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
                    let cascades = cascades_of(plan, bounds.as_ref()).and(culled);
                    if !cascades.is_empty() {
                        caster.visibility.set_visible();
                        found.push((caster.entity, cascades));
                    }
                },
            );

            found.drain_into(known);
            known.sort_unstable_by_key(|(entity, _)| *entity);
            known.dedup_by(|(entity, more), (kept, cascades)| {
                let is_same = entity == kept;
                if is_same {
                    cascades.0 |= more.0;
                }
                is_same
            });

            let view_lists = it.lists.entities.entry(*view).or_default();
            view_lists.resize_with(count, VisibleMeshEntities::default);
            for index in culled.iter() {
                let list = &mut view_lists[index];
                let inside = known
                    .iter()
                    .filter(|(_, cascades)| cascades.contains(index));
                list.entities.clear();
                list.entities.extend(inside.map(|(entity, _)| *entity));
                list.shrink();
            }
        }
    }
}

/// The cascades whose maps stay as they are in this frame.
fn held(plan: &[CascadePlan]) -> impl Iterator<Item = usize> {
    let is_held = |cascade: &CascadePlan| {
        let map = cascade.map.as_ref();
        map.is_some_and(|map| map.redraw.is_none())
    };
    plan.iter()
        .enumerate()
        .filter(move |(_, it)| is_held(it))
        .map(|(index, _)| index)
}

/// The cascades that a caster matters to. Without bounds it matters to all that have a map.
fn cascades_of(plan: &[CascadePlan], bounds: Option<&OrientedBox>) -> CascadeSet {
    let maps = plan.iter().enumerate();
    let maps = maps.filter_map(|(index, cascade)| Some((index, cascade.map.as_ref()?)));
    let met = maps.filter(|(_, map)| bounds.is_none_or(|bounds| map.hull.intersects_box(bounds)));
    CascadeSet::of(met.map(|(index, _)| index))
}
