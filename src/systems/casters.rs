//! Which casters the maps of a plan hold.

use core::ops::Range;

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
    bounds::{BoundsMargin, Margin, world_bounds},
};
use crate::{
    geometry::{
        coarse::{CoarseHull, CoarseSweep, FourSpheres},
        hull::{CasterHull, Sweep},
    },
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
    /// Quick tests of where casters cannot matter, by one of the hulls of some cascades' maps.
    fn coarse(&self, among: CascadeSet, hull: fn(&CascadeMap) -> &CasterHull) -> Coarse {
        let mut sweeps: Vec<Sweep> = Vec::new();
        let mut hulls = Vec::new();
        // The largest first, for it holds most of the others.
        for index in (0..self.plan.len()).rev().filter(|it| among.contains(*it)) {
            let Some(map) = &self.plan[index].map else {
                continue;
            };
            let hull = hull(map);
            hulls.push((index, CoarseHull::new(hull)));
            let both = sweeps.iter_mut().find_map(|it| {
                *it = it.and(hull.sweep)?;
                Some(())
            });
            if both.is_none() {
                sweeps.push(hull.sweep);
            }
        }
        Coarse {
            sweeps: sweeps.iter().map(CoarseSweep::new).collect(),
            hulls,
            // Any mesh may be displaced: by half of its longest side along each axis, so that it reaches 1 + √3 times as far
            // as the sphere at most.
            growth: if self.displaced.is_empty() { 1.0 } else { 4.0 },
        }
    }

    /// The boxes of a table's meshes, if spheres around them tell where those are not.
    fn boxes<'t>(
        &self,
        table: &'t CasterContiguousItem,
    ) -> Option<(&'t [Aabb], &'t [GlobalTransform])> {
        let is_culled = self.is_on && !table.is_unculled && table.margin.is_none();
        Some((table.aabb?, table.transform?)).filter(|_| is_culled)
    }

    /// The box of one caster, likewise.
    fn box_of<'t>(&self, caster: &CasterItem<'t, '_>) -> Option<(&'t Aabb, &'t GlobalTransform)> {
        let is_culled = self.is_on && !caster.is_unculled && caster.margin.is_none();
        Some((caster.aabb?, caster.transform?)).filter(|_| is_culled)
    }

    /// Visits the rows whose casters, by their places, may matter to some of the cascades.
    fn visit_near(
        &self,
        table: &CasterContiguousItem,
        rows: Range<usize>,
        among: CascadeSet,
        coarse: &Coarse,
        mut visit: impl FnMut(usize, CascadeSet),
    ) {
        let Some((aabbs, transforms)) = self.boxes(table) else {
            rows.for_each(|row| visit(row, among));
            return;
        };
        let aabbs = aabbs[rows.clone()].chunks(4);
        let transforms = transforms[rows.clone()].chunks(4);
        for (four, (aabbs, transforms)) in aabbs.zip(transforms).enumerate() {
            let lanes = [0, 1, 2, 3].map(|lane| lane.min(aabbs.len() - 1));
            let near = coarse.near(
                lanes.map(|lane| &aabbs[lane]),
                lanes.map(|lane| &transforms[lane]),
            );
            for (lane, near) in near.into_iter().enumerate().take(aabbs.len()) {
                if !near.is_empty() {
                    visit(rows.start + 4 * four + lane, near);
                }
            }
        }
    }

    /// Those of some cascades that a caster matters to, by one of the hulls of their maps.
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
        let is_somewhere = caster.transform.is_none_or(is_somewhere);
        if !caster.inherited.get() || !layers_meet || is_out_of_range || !is_somewhere {
            return CascadeSet::default();
        }
        match (caster.aabb, caster.transform) {
            (Some(aabb), Some(transform)) if self.is_on && !caster.is_unculled => {
                let margin = Margin::of(caster.entity, caster.margin, self.displaced);
                let affine = transform.affine();
                let bounds = world_bounds(aabb, &affine, margin);
                let is_met = |index: &usize| {
                    let map = self.plan[*index].map.as_ref();
                    map.is_some_and(|map| hull(map).intersects_box(&bounds))
                };
                CascadeSet::of(among.iter().filter(is_met))
            }
            // Without bounds it matters to all.
            _ => among,
        }
    }
}

/// The sweeps and hulls of some cascades' maps.
struct Coarse {
    sweeps: Vec<CoarseSweep>,
    hulls: Vec<(usize, CoarseHull)>,
    /// How many times as far a mesh may reach as the sphere around its box.
    growth: f32,
}

impl Coarse {
    /// For each of four casters the cascades that it may matter to, by its place.
    fn near(&self, aabbs: [&Aabb; 4], transforms: [&GlobalTransform; 4]) -> [CascadeSet; 4] {
        let mut near = [CascadeSet::default(); 4];
        let [a, b, c, d] = transforms.map(GlobalTransform::affine);
        let centers = aabbs.map(|aabb| aabb.center);
        let half_extents = aabbs.map(|aabb| aabb.half_extents);
        let spheres = FourSpheres::new([&a, &b, &c, &d], centers, half_extents);
        let spheres = spheres.scaled(self.growth);
        let are_far = |far, sweep: &CoarseSweep| far & sweep.are_far(&spheres);
        let far = self.sweeps.iter().fold(0b1111, are_far);
        if far == 0b1111 {
            return near;
        }
        for (cascade, hull) in &self.hulls {
            let outside = far | hull.are_outside(&spheres);
            for (lane, near) in near.iter_mut().enumerate() {
                if outside & (1 << lane) == 0 {
                    near.insert(*cascade);
                }
            }
        }
        near
    }
}

/// Whether a place is one: what has none is in no map.
pub(super) fn is_somewhere(transform: &GlobalTransform) -> bool {
    transform.affine().is_finite()
}

/// Rows of tables that are looked over together.
const ROWS: usize = 4096;

/// Casters that maps of some cascades hold, and those.
pub(super) fn cull(
    casters: &Query<Caster, IsCaster>,
    culling: &Culling,
    among: CascadeSet,
) -> Vec<(Entity, CascadeSet)> {
    let found = |caster: &CasterItem, among: CascadeSet| {
        let cascades = culling.cascades(caster, among, |map| &map.hull);
        (!cascades.is_empty()).then_some((caster.entity, cascades))
    };
    let Ok(tables) = casters.contiguous_iter() else {
        // Never with components as Bevy stores them.
        return casters.iter().filter_map(|it| found(&it, among)).collect();
    };
    let coarse = culling.coarse(among, |map| &map.hull);
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
            let (found, coarse) = (&found, &coarse);
            scope.spawn(async move {
                let mut all = Vec::new();
                for (table, rows) in batch {
                    culling.visit_near(table, rows, among, coarse, |row, near| {
                        all.extend(found(&table.row(row), near));
                    });
                }
                all
            });
        }
    });
    all.concat()
}

/// Of some casters, those that matter to what is seen now in maps of some cascades, and those.
pub(super) fn cull_some(
    casters: &Query<Caster, IsCaster>,
    some: impl Iterator<Item = Entity>,
    culling: &Culling,
    among: CascadeSet,
) -> Vec<(Entity, CascadeSet)> {
    let mut found = Vec::new();
    let mut visit = |caster: &CasterItem, near: CascadeSet| {
        let cascades = culling.cascades(caster, near, |map| &map.hull_now);
        if !cascades.is_empty() {
            found.push((caster.entity, cascades));
        }
    };
    let mut boxed = Vec::new();
    for caster in casters.iter_many(some).flatten() {
        match culling.box_of(&caster) {
            Some(its_box) => boxed.push((caster, its_box)),
            None => visit(&caster, among),
        }
    }
    if boxed.is_empty() {
        return found;
    }
    let coarse = culling.coarse(among, |map| &map.hull_now);
    for four in boxed.chunks(4) {
        let lanes = [0, 1, 2, 3].map(|lane| four[lane.min(four.len() - 1)].1);
        let near = coarse.near(lanes.map(|it| it.0), lanes.map(|it| it.1));
        for ((caster, _), near) in four.iter().zip(near).filter(|(_, near)| !near.is_empty()) {
            visit(caster, near);
        }
    }
    found
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
