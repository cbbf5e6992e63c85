//! Which casters the maps of a plan hold.

use bevy::{
    camera::{
        primitives::Aabb,
        visibility::{
            InheritedVisibility, NoCpuCulling, NoFrustumCulling, RenderLayers, ViewVisibility,
            VisibilityRange, VisibleEntityRanges,
        },
    },
    ecs::{
        entity::{Entity, EntityHashSet},
        query::{Has, QueryData, With, Without},
        system::Query,
    },
    light::{DirectionalLight, NotShadowCaster},
    mesh::Mesh3d,
    tasks::{ComputeTaskPool, TaskPool},
    transform::components::GlobalTransform,
};

use super::{
    CascadeSet,
    bounds::{BoundsMargin, Margin, bounding_sphere, coarse_sphere, world_bounds},
};
use crate::{
    geometry::hull::{CasterHull, CoarseSweep, Sweep},
    plan::{CascadeMap, CascadePlan},
};

#[derive(QueryData)]
#[query_data(contiguous(all))]
pub struct Caster {
    pub entity: Entity,
    inherited: &'static InheritedVisibility,
    layers: Option<&'static RenderLayers>,
    aabb: Option<&'static Aabb>,
    transform: Option<&'static GlobalTransform>,
    margin: Option<&'static BoundsMargin>,
    has_range: Has<VisibilityRange>,
    is_unculled: Has<NoFrustumCulling>,
}

pub(super) type IsCaster = (
    Without<NotShadowCaster>,
    Without<DirectionalLight>,
    Without<NoCpuCulling>,
    With<Mesh3d>,
    With<ViewVisibility>,
);

/// What decides where a light's casters are drawn for a camera.
pub(super) struct Culling<'a> {
    pub view: Entity,
    pub plan: &'a [CascadePlan],
    pub light_layers: &'a RenderLayers,
    pub ranges: Option<&'a VisibleEntityRanges>,
    pub displaced: &'a EntityHashSet,
    pub is_on: bool,
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
    #[inline]
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
    pub fn cascades(
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
pub(super) fn cull(
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

/// The cascades that have a map of which something is true.
pub(super) fn maps_where(plan: &[CascadePlan], is: impl Fn(&CascadeMap) -> bool) -> CascadeSet {
    let maps = plan.iter().enumerate();
    let maps = maps.filter(|(_, cascade)| cascade.map.as_ref().is_some_and(&is));
    CascadeSet::of(maps.map(|(index, _)| index))
}
