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
        entity::{Entity, EntityHashMap, EntityHashSet},
        query::{Has, QueryData, With, Without},
        system::{Local, ParamSet, Query, Res},
    },
    light::{Cascades, DirectionalLight, NotShadowCaster, SpotLight},
    mesh::Mesh3d,
    shape::ViewFrustum,
    transform::components::GlobalTransform,
    utils::Parallel,
};

use super::{
    ChangedCasters, ManagedLight, ShadowPlans, ShadowUpdates,
    bounds::{BoundsMargin, DisplacedMeshes, Margin, bounding_sphere, world_bounds},
    moving::MovingCasters,
    publish::{empty_cascade, published_cascade},
};
use crate::{
    config::{CasterCulling, MAX_CASCADES, MapUpdates},
    geometry::hull::CasterHull,
    plan::{CascadeMap, CascadePlan},
    support::ShadowSupport,
};

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

    fn of(cascades: impl Iterator<Item = usize>) -> Self {
        Self(cascades.fold(0, |set, index| set | (1 << index)))
    }

    fn and(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    fn or(self, other: Self) -> Self {
        Self(self.0 | other.0)
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
    /// By camera: casters that maps hold, in the order of their entities. Casters that are drawn into no
    /// cascade are absent, and those with `NoCpuCulling`, which only the GPU culls.
    pub views: EntityHashMap<Vec<(Entity, CascadeSet)>>,
    /// By camera: casters that move, in the order of their entities. They are drawn over maps in each frame.
    pub moving: EntityHashMap<Vec<(Entity, CascadeSet)>>,
}

impl CasterCascades {
    /// The cascades that `caster` is drawn into for camera `view`; `None` if it is in none.
    pub fn get(&self, view: Entity, caster: Entity) -> Option<CascadeSet> {
        [&self.views, &self.moving].into_iter().find_map(|views| {
            let casters = views.get(&view)?;
            let index = casters
                .binary_search_by_key(&caster, |(entity, _)| *entity)
                .ok()?;
            Some(casters[index].1)
        })
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
    updates: Option<&'static ShadowUpdates>,
    casters: &'static mut CasterCascades,
    cascades: &'static mut Cascades,
    frusta: &'static mut CascadesFrusta,
    lists: &'static mut CascadesVisibleEntities,
}

/// What decides where a light's casters are drawn for a camera.
struct Culling<'a> {
    view: Entity,
    plan: &'a [CascadePlan],
    light_layers: &'a RenderLayers,
    ranges: Option<&'a VisibleEntityRanges>,
    displaced: &'a EntityHashSet,
    is_on: bool,
}

impl Culling<'_> {
    /// Those of the cascades that a caster matters to, by one of the hulls of their maps.
    fn cascades(
        &self,
        caster: &CasterItem,
        among: CascadeSet,
        hull: fn(&CascadeMap) -> &CasterHull,
    ) -> CascadeSet {
        let layers_meet = self
            .light_layers
            .intersects(caster.layers.unwrap_or_default());
        let is_out_of_range = caster.has_range
            && self
                .ranges
                .is_some_and(|ranges| !ranges.entity_is_in_range_of_view(caster.entity, self.view));
        if !caster.inherited.get() || !layers_meet || is_out_of_range {
            return CascadeSet::default();
        }
        match (caster.aabb, caster.transform) {
            (Some(aabb), Some(transform)) if self.is_on && !caster.is_unculled => {
                let margin = Margin::of(caster.entity, caster.margin, self.displaced);
                let affine = transform.affine();
                let (center_ws, radius) = bounding_sphere(aabb, &affine, margin);
                let is_near = |map: &CascadeMap| hull(map).intersects_sphere(center_ws, radius);
                let near = among.and(maps_where(self.plan, is_near));
                if near.is_empty() {
                    return near;
                }
                let bounds = world_bounds(aabb, &affine, margin);
                near.and(maps_where(self.plan, |map| {
                    hull(map).intersects_box(&bounds)
                }))
            }
            // Without bounds it matters to all.
            _ => among,
        }
    }
}

/// Finds the casters of each cascade, and publishes cascades, frusta and lists in Bevy's
/// components. Runs in [`PssmSystems::CullCasters`](super::PssmSystems::CullCasters).
pub fn cull_casters(
    mut lights: Query<CulledLight, Without<SpotLight>>,
    mut casters: ParamSet<(
        Query<Caster, IsCaster>,
        Query<(&InheritedVisibility, &mut ViewVisibility), IsCaster>,
    )>,
    ranges: Option<Res<VisibleEntityRanges>>,
    displaced: Res<DisplacedMeshes>,
    support: Res<ShadowSupport>,
    changed: Res<ChangedCasters>,
    mut found: Local<Parallel<Vec<(Entity, CascadeSet)>>>,
) {
    let displaced = displaced.get();
    let none_moving = MovingCasters::default();
    for mut it in &mut lights {
        let Some(config) = it.managed.config() else {
            *it.casters = CasterCascades::default();
            continue;
        };
        let count = config.cascades as usize;
        let casts = it.light.shadow_maps_enabled && it.visibility.get();
        let is_planned = |view: &Entity| casts && it.plans.views.contains_key(view);
        it.casters.views.retain(|view, _| is_planned(view));
        it.casters.moving.retain(|view, _| is_planned(view));
        if !it.lists.entities.keys().all(is_planned) {
            it.lists.entities.retain(|view, _| is_planned(view));
        }
        // Where all is drawn in each frame, and by Bevy, nothing is drawn over it.
        let is_split = support.draws_maps()
            && config.comparison.updates == MapUpdates::WhenNeeded
            && it.updates != Some(&ShadowUpdates::Always);
        let moving = if is_split {
            changed.moving()
        } else {
            &none_moving
        };

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
            let is_known = it.casters.views.contains_key(view);
            let CasterCascades {
                views: known,
                moving: of_views,
            } = &mut *it.casters;
            let known = known.entry(*view).or_default();
            let mapped = maps_where(plan, |_| true);
            // Lists of what moves are not there when Bevy draws.
            let held = if is_known && is_split {
                maps_where(plan, |map| map.redraw.is_none())
            } else {
                CascadeSet::default()
            };
            let mut visibilities = casters.p1();
            let mut with_lost = CascadeSet::default();
            known.retain_mut(|(caster, cascades)| {
                *cascades = cascades.and(held);
                match visibilities.get_mut(*caster) {
                    _ if cascades.is_empty() => false,
                    Ok((inherited, mut visibility))
                        if inherited.get() && !moving.contains(*caster) =>
                    {
                        visibility.set_visible();
                        true
                    }
                    _ => {
                        with_lost = with_lost.or(*cascades);
                        false
                    }
                }
            });
            let culling = Culling {
                view: *view,
                plan,
                light_layers: it.layers.unwrap_or_default(),
                ranges: ranges.as_deref(),
                displaced: &displaced,
                is_on: config.comparison.culling == CasterCulling::Hull,
            };
            let culled = mapped.without(held);
            if !culled.is_empty() {
                casters.p0().par_iter_mut().for_each_init(
                    || found.borrow_local_mut(),
                    |found, mut caster| {
                        if moving.contains(caster.entity) {
                            return;
                        }
                        let cascades = culling.cascades(&caster, culled, |map| &map.hull);
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
                        *cascades = cascades.or(*more);
                    }
                    is_same
                });
            }
            if is_split {
                let over = of_views.entry(*view).or_default();
                over.clear();
                let mut movable = casters.p0();
                for caster in moving.iter() {
                    let Ok(mut caster) = movable.get_mut(caster) else {
                        continue;
                    };
                    let cascades = culling.cascades(&caster, mapped, |map| &map.hull_now);
                    if !cascades.is_empty() {
                        caster.visibility.set_visible();
                        over.push((caster.entity, cascades));
                    }
                }
                over.sort_unstable_by_key(|(entity, _)| *entity);
            } else {
                of_views.remove(view);
            }

            let view_lists = it.lists.entities.entry(*view).or_default();
            // Bevy drops those of views that it culls nothing for.
            let kept = if view_lists.len() == count {
                held.without(with_lost)
            } else {
                CascadeSet::default()
            };
            view_lists.resize_with(count, VisibleMeshEntities::default);
            for index in (0..count).filter(|index| !kept.contains(*index)) {
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

/// The cascades that have a map of which something is true.
fn maps_where(plan: &[CascadePlan], is: impl Fn(&CascadeMap) -> bool) -> CascadeSet {
    let maps = plan.iter().enumerate();
    let maps = maps.filter(|(_, cascade)| cascade.map.as_ref().is_some_and(&is));
    CascadeSet::of(maps.map(|(index, _)| index))
}
