//! What shadows cost: counts, which repeat exactly, and times, which do not.

use bevy::{
    camera::visibility::{CascadesVisibleEntities, VisibilitySystems},
    ecs::schedule::{SingleThreadedExecutor, SystemSet},
    light::{DirectionalLightShadowMap, SimulationLightSystems},
    mesh::Indices,
    platform::time::Instant,
    prelude::*,
};
use bevy_pssm::{PssmSystems, prelude::*};

use crate::measure::Counts;

/// What one frame did.
#[derive(Debug, Clone, Default)]
pub struct Frame {
    /// On the GPU: of the frame before.
    pub gpu: Counts,
    /// Planning and culling on the CPU (microseconds).
    pub cpu: [f64; 2],
    /// Casters drawn, by cascade.
    pub casters: Vec<usize>,
    /// Their triangles, by cascade.
    pub triangles: Vec<usize>,
    /// Texels per side, by cascade.
    pub maps: Vec<u32>,
}

impl Frame {
    /// Reads a frame's costs off the world.
    pub fn of(world: &World, gpu: Counts, camera: Entity, sun: Entity, ours: bool) -> Self {
        let clock = world.resource::<CpuClock>();
        let meshes = world.resource::<Assets<Mesh>>();
        let triangles_of = |entity: &Entity| {
            let mesh = world.get::<Mesh3d>(*entity).and_then(|m| meshes.get(&m.0));
            mesh.map_or(0, |mesh| {
                mesh.indices().map_or(mesh.count_vertices(), Indices::len) / 3
            })
        };
        let lists = world
            .get::<CascadesVisibleEntities>(sun)
            .and_then(|lists| lists.entities.get(&camera));
        let lists: Vec<&[Entity]> = lists
            .into_iter()
            .flatten()
            .map(|list| list.entities.as_slice())
            .collect();
        let config = world.get::<ParallelSplitShadows>(sun).filter(|_| ours);
        let stock = world.resource::<DirectionalLightShadowMap>().size as u32;
        let size = |index: usize| config.map_or(stock, |config| config.map_size.of_cascade(index));
        Self {
            gpu,
            cpu: [clock.lap(ours, 0), clock.lap(ours, 1)],
            casters: lists.iter().map(|list| list.len()).collect(),
            triangles: lists
                .iter()
                .map(|list| list.iter().map(triangles_of).sum())
                .collect(),
            maps: (0..lists.len()).map(size).collect(),
        }
    }

    /// Texels of all maps.
    pub fn texels(&self) -> u64 {
        self.maps.iter().map(|size| u64::from(*size).pow(2)).sum()
    }

    /// Memory of the array texture (MiB): four bytes a texel, layers as large as the largest.
    pub fn mib(&self) -> f64 {
        let largest = self.maps.iter().max().copied().unwrap_or(0);
        let texels = u64::from(largest).pow(2) * self.maps.len() as u64;
        (texels * 4) as f64 / f64::from(1 << 20)
    }
}

/// Times planning and culling, the plugin's and Bevy's alike, by looking at the clock before
/// and after their system sets. The schedule runs on one thread meanwhile, so that nothing else
/// is timed.
pub struct CpuClockPlugin;

#[derive(Resource, Default)]
struct CpuClock {
    laps: [[Option<(Instant, Instant)>; 2]; 2],
}

impl CpuClock {
    fn lap(&self, ours: bool, stage: usize) -> f64 {
        self.laps[usize::from(ours)][stage]
            .map_or(0.0, |(start, end)| (end - start).as_secs_f64() * 1e6)
    }
}

fn start<const OURS: usize, const STAGE: usize>(mut clock: ResMut<CpuClock>) {
    let now = Instant::now();
    clock.laps[OURS][STAGE] = Some((now, now));
}

fn stop<const OURS: usize, const STAGE: usize>(mut clock: ResMut<CpuClock>) {
    if let Some((_, end)) = &mut clock.laps[OURS][STAGE] {
        *end = Instant::now();
    }
}

impl CpuClockPlugin {
    fn time<const OURS: usize, const STAGE: usize>(
        app: &mut App,
        set: impl SystemSet + Clone,
        ready: impl SystemSet,
    ) {
        app.add_systems(
            PostUpdate,
            (
                start::<OURS, STAGE>.after(ready).before(set.clone()),
                stop::<OURS, STAGE>.after(set),
            ),
        );
    }
}

impl Plugin for CpuClockPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<CpuClock>();
        app.edit_schedule(PostUpdate, |schedule| {
            schedule.set_executor(SingleThreadedExecutor::new());
        });
        Self::time::<0, 0>(
            app,
            SimulationLightSystems::UpdateDirectionalLightCascades,
            TransformSystems::Propagate,
        );
        Self::time::<0, 1>(
            app,
            SimulationLightSystems::CheckLightVisibility,
            VisibilitySystems::CheckVisibility,
        );
        Self::time::<1, 0>(
            app,
            PssmSystems::PlanCascades,
            SimulationLightSystems::UpdateDirectionalLightCascades,
        );
        Self::time::<1, 1>(
            app,
            PssmSystems::CullCasters,
            SimulationLightSystems::CheckLightVisibility,
        );
    }
}
