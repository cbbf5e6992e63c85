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
        entity::{Entity, EntityHashSet},
        query::{Has, QueryData, With, Without},
        system::{ParamSet, Query, Res},
    },
    light::{Cascades, DirectionalLight, NotShadowCaster, SpotLight},
    mesh::Mesh3d,
    shape::ViewFrustum,
    tasks::{ComputeTaskPool, TaskPool},
    transform::components::GlobalTransform,
};

use super::{
    CascadeSet, CasterCascades, ChangedCasters, ManagedLight, ShadowPlans, ShadowUpdates,
    SharedViews,
    bounds::{BoundsMargin, DisplacedMeshes, Margin, bounding_sphere, coarse_sphere, world_bounds},
    moving::MovingCasters,
    publish::{empty_cascade, published_cascade},
};
use crate::{
    config::{CasterCulling, MapUpdates},
    geometry::hull::{CasterHull, CoarseSweep, Sweep},
    plan::{CascadeMap, CascadePlan},
    support::ShadowSupport,
};

#[derive(QueryData)]
#[query_data(contiguous(all))]
pub struct Caster {
    entity: Entity,
    inherited: &'static InheritedVisibility,
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
    With<ViewVisibility>,
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
    /// What some of the cascades' maps are for, on its way to the light.
    fn sweeps(&self, among: CascadeSet) -> Vec<Sweep> {
        let mut sweeps: Vec<Sweep> = Vec::new();
        // The largest first, for it holds most of the others.
        for index in (0..self.plan.len())
            .rev()
            .filter(|index| among.contains(*index))
        {
            let Some(map) = &self.plan[index].map else {
                continue;
            };
            let sweep = map.hull.sweep;
            let both = sweeps.iter_mut().find_map(|it| {
                *it = it.and(sweep)?;
                Some(())
            });
            if both.is_none() {
                sweeps.push(sweep);
            }
        }
        sweeps
    }

    /// Whether a caster is not far from all of the sweeps: most are.
    fn is_near(&self, caster: &CasterItem, sweeps: &[Sweep]) -> bool {
        let (Some(aabb), Some(transform)) = (caster.aabb, caster.transform) else {
            return true;
        };
        if !self.is_on || caster.is_unculled {
            return true;
        }
        let margin = Margin::of(caster.entity, caster.margin, self.displaced);
        let (center_ws, radius) = bounding_sphere(aabb, &transform.affine(), margin);
        sweeps.iter().any(|sweep| !sweep.is_far(center_ws, radius))
    }

    /// As [`Self::is_near`], sooner. `None` if that has to tell.
    fn is_coarsely_near(
        &self,
        table: &CasterContiguousItem,
        row: usize,
        sweeps: &[CoarseSweep],
    ) -> Option<bool> {
        let (Some(aabbs), Some(transforms), None) = (table.aabb, table.transform, table.margin)
        else {
            return None;
        };
        if !self.is_on || table.is_unculled {
            return Some(true);
        }
        let (center, radius, magnitude) = coarse_sphere(&aabbs[row], &transforms[row].affine());
        // Any of them may reach out of its box.
        let radius = if self.displaced.is_empty() {
            radius
        } else {
            4.0 * radius
        };
        let is_far = |sweep: &CoarseSweep| sweep.is_far(center, radius, magnitude);
        Some(!sweeps.iter().all(is_far))
    }

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
                let bounds = world_bounds(aabb, &affine, margin);
                let (center_ws, radius) = (bounds.center, bounds.radius());
                let is_near = |map: &CascadeMap| hull(map).intersects_sphere(center_ws, radius);
                let near = among.and(maps_where(self.plan, is_near));
                if near.is_empty() {
                    return near;
                }
                near.and(maps_where(self.plan, |map| {
                    hull(map).intersects_box(&bounds)
                }))
            }
            // Without bounds it matters to all.
            _ => among,
        }
    }
}

/// Rows of tables that are looked over together.
const ROWS: usize = 4096;

/// Casters that maps of some cascades hold, and those.
fn cull(
    casters: &Query<Caster, IsCaster>,
    culling: &Culling,
    among: CascadeSet,
) -> Vec<(Entity, CascadeSet)> {
    let found = |caster: &CasterItem| {
        let cascades = culling.cascades(caster, among, |map| &map.hull);
        (!cascades.is_empty()).then_some((caster.entity, cascades))
    };
    let Ok(tables) = casters.contiguous_iter() else {
        // Never with components as Bevy stores them.
        return casters.iter().filter_map(|it| found(&it)).collect();
    };
    let sweeps = culling.sweeps(among);
    let coarse: Vec<_> = sweeps.iter().map(Sweep::coarse).collect();
    let tables: Vec<_> = tables.collect();
    // Many a table has few rows.
    let (mut batches, mut batch, mut rows) = (Vec::new(), Vec::new(), 0);
    for table in &tables {
        for first in (0..table.entity.len()).step_by(ROWS) {
            let piece = first..table.entity.len().min(first + ROWS);
            if rows + piece.len() > ROWS {
                batches.push(core::mem::take(&mut batch));
                rows = 0;
            }
            rows += piece.len();
            batch.push((table, piece));
        }
    }
    batches.push(batch);
    let pool = ComputeTaskPool::get_or_init(TaskPool::default);
    let all = pool.scope(|scope| {
        for batch in batches {
            let (found, sweeps, coarse) = (&found, &sweeps, &coarse);
            scope.spawn(async move {
                let mut all = Vec::new();
                for (table, rows) in batch {
                    let near = rows.filter(|row| {
                        let is_near = || culling.is_near(&table.row(*row), sweeps);
                        let coarsely = culling.is_coarsely_near(table, *row, coarse);
                        coarsely.unwrap_or_else(is_near)
                    });
                    let near = near.map(|row| table.row(row));
                    all.extend(near.filter_map(|caster| found(&caster)));
                }
                all
            });
        }
    });
    all.concat()
}

impl CasterContiguousItem<'_, '_> {
    fn row(&self, row: usize) -> CasterItem<'_, '_> {
        CasterItem {
            entity: self.entity[row],
            inherited: &self.inherited[row],
            layers: self.layers.map(|it| &it[row]),
            aabb: self.aabb.map(|it| &it[row]),
            transform: self.transform.map(|it| &it[row]),
            margin: self.margin.map(|it| &it[row]),
            has_range: self.has_range,
            is_unculled: self.is_unculled,
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
    (changed, shared): (Res<ChangedCasters>, Res<SharedViews>),
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
            if held.is_empty() {
                known.clear();
            }
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
                let found = cull(&casters.p0(), &culling, culled);
                let mut visibilities = casters.p1();
                let found = found.into_iter().filter(|(it, _)| !moving.contains(*it));
                for (caster, cascades) in found {
                    if let Ok((_, mut visibility)) = visibilities.get_mut(caster) {
                        visibility.set_visible();
                    }
                    known.push((caster, cascades));
                }
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
                let movable = casters.p0();
                over.extend(moving.iter().filter_map(|caster| {
                    let caster = movable.get(caster).ok()?;
                    let cascades = culling.cascades(&caster, mapped, |map| &map.hull_now);
                    (!cascades.is_empty()).then_some((caster.entity, cascades))
                }));
                let mut visibilities = casters.p1();
                for (caster, _) in over.iter() {
                    if let Ok((_, mut visibility)) = visibilities.get_mut(*caster) {
                        visibility.set_visible();
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
        // What is published for a camera that looks up another one's maps: those, and nothing to draw.
        for (guest, host) in shared.pairs() {
            let (Some(published), Some(frusta)) = (
                it.cascades.cascades.get(&host).cloned(),
                it.frusta.frusta.get(&host).cloned(),
            ) else {
                continue;
            };
            it.cascades.cascades.insert(guest, published);
            it.frusta.frusta.insert(guest, frusta);
            let lists = it.lists.entities.entry(guest).or_default();
            lists.clear();
            lists.resize_with(count, VisibleMeshEntities::default);
        }
    }
}

/// The cascades that have a map of which something is true.
fn maps_where(plan: &[CascadePlan], is: impl Fn(&CascadeMap) -> bool) -> CascadeSet {
    let maps = plan.iter().enumerate();
    let maps = maps.filter(|(_, cascade)| cascade.map.as_ref().is_some_and(&is));
    CascadeSet::of(maps.map(|(index, _)| index))
}
