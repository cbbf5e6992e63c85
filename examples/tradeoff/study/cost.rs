//! What shadows cost: counts, which repeat exactly, and times, which do not.

use bevy::{
    camera::visibility::CascadesVisibleEntities,
    light::{
        DirectionalLightShadowMap, cascade::build_directional_light_cascades,
        check_dir_light_mesh_visibility, update_directional_light_frusta,
    },
    mesh::Indices,
    platform::time::Instant,
    prelude::*,
};
use bevy_pssm::{
    ShadowPlans,
    systems::{cull_casters, plan_shadows},
};

use crate::measure::Counts;

/// What one frame did.
#[derive(Debug, Clone, Default)]
pub struct Frame {
    /// On the GPU; known two frames later.
    pub gpu: Counts,
    /// Planning and culling on the CPU (microseconds): [`time_systems`].
    pub cpu: [f64; 2],
    /// Casters drawn, by cascade.
    pub casters: Vec<usize>,
    /// Their triangles, by cascade.
    pub triangles: Vec<usize>,
    /// Texels along the axes, by cascade.
    pub maps: Vec<UVec2>,
}

/// Texels of a map.
pub fn area(size: UVec2) -> u64 {
    u64::from(size.x) * u64::from(size.y)
}

impl Frame {
    /// Reads a frame's costs off the world.
    pub fn of(world: &World, gpu: Counts, camera: Entity, sun: Entity, ours: bool) -> Self {
        let lists = lists(world, camera, sun);
        let plans = world.get::<ShadowPlans>(sun).filter(|_| ours);
        let plans = plans.and_then(|plans| plans.views.get(&camera));
        let stock = UVec2::splat(world.resource::<DirectionalLightShadowMap>().size as u32);
        let size = |index: usize| {
            let plan = plans.and_then(|plans| plans.get(index));
            plan.map_or(stock, |plan| plan.map_size)
        };
        Self {
            gpu,
            cpu: [0.0; 2],
            casters: lists.iter().map(|list| list.len()).collect(),
            triangles: triangles_of_cascades(world, camera, sun),
            maps: (0..lists.len()).map(size).collect(),
        }
    }

    /// Texels of all maps.
    pub fn texels(&self) -> u64 {
        self.maps.iter().map(|size| area(*size)).sum()
    }

    /// Memory of the array texture (MiB): four bytes a texel, layers as large as the largest.
    pub fn mib(&self) -> f64 {
        let layer = self
            .maps
            .iter()
            .copied()
            .reduce(UVec2::max)
            .unwrap_or_default();
        let texels = area(layer) * self.maps.len() as u64;
        (texels * 4) as f64 / f64::from(1 << 20)
    }
}

fn lists(world: &World, camera: Entity, sun: Entity) -> Vec<&[Entity]> {
    let lists = world.get::<CascadesVisibleEntities>(sun);
    let lists = lists.and_then(|lists| lists.entities.get(&camera));
    let lists = lists.into_iter().flatten();
    lists.map(|list| list.entities.as_slice()).collect()
}

/// Triangles of casters, by cascade.
pub fn triangles_of_cascades(world: &World, camera: Entity, sun: Entity) -> Vec<usize> {
    let lists = lists(world, camera, sun).into_iter();
    let sum = |list: &[Entity]| list.iter().map(|caster| triangles_of(world, *caster)).sum();
    lists.map(sum).collect()
}

/// Triangles of a caster.
pub fn triangles_of(world: &World, caster: Entity) -> usize {
    let meshes = world.resource::<Assets<Mesh>>();
    let mesh = world.get::<Mesh3d>(caster).and_then(|m| meshes.get(&m.0));
    mesh.map_or(0, |mesh| {
        mesh.indices().map_or(mesh.count_vertices(), Indices::len) / 3
    })
}

/// Runs of the systems that are timed.
const RUNS: usize = 5;

/// Times planning and culling: runs their systems again, on what the frame has left, in the
/// schedule's order. For the plugin Bevy's own count too, which still run, on next to nothing.
/// Medians (microseconds).
pub fn time_systems(world: &mut World, ours: bool) -> [f64; 2] {
    let mut times: [Vec<f64>; 2] = Default::default();
    for _ in 0..RUNS {
        let planning = [
            clocked(world, build_directional_light_cascades),
            clocked(world, plan_shadows),
        ];
        clocked(world, update_directional_light_frusta);
        let culling = [
            clocked(world, check_dir_light_mesh_visibility),
            clocked(world, cull_casters),
        ];
        for (times, [stock, own]) in times.iter_mut().zip([planning, culling]) {
            times.push(if ours { stock + own } else { stock });
        }
    }
    times.map(|mut times| {
        times.sort_by(f64::total_cmp);
        times[RUNS / 2]
    })
}

fn clocked<M, S: IntoSystem<(), (), M> + 'static>(world: &mut World, system: S) -> f64 {
    let start = Instant::now();
    if let Err(error) = world.run_system_cached(system) {
        warn!("A system could not be timed: {error}");
    }
    start.elapsed().as_secs_f64() * 1e6
}
