//! What is drawn along a path where maps that serve are held.

use bevy::{light::NotShadowCaster, platform::collections::HashSet, prelude::*};
use bevy_pssm::{CasterCascades, MapUpdates, ParallelSplitShadows, ShadowPlans, plan::Redraw};

use super::{
    cost::{Frame, area, triangles_of},
    studio::{Stance, Studio},
};

/// What is drawn along a path, by how much moves besides the camera.
#[derive(Debug, Default, Clone, Copy, PartialEq)]
pub struct Drawn {
    /// If all maps are, in every frame.
    pub always: Work,
    /// If they are as needed: no caster moves,
    pub still: Work,
    /// one in a hundred does,
    pub few: Work,
    /// all do.
    pub all: Work,
}

/// How far what moves goes in a frame (meters).
const STEP: f32 = 0.125;

/// What is drawn.
#[derive(Debug, Default, Clone, Copy, PartialEq)]
pub struct Work {
    /// Maps, those included that casters are only added to.
    pub maps: usize,
    /// Casters into maps.
    pub casters: usize,
    /// Their triangles.
    pub triangles: usize,
    /// Texels of maps that are cleared, or copied from what rests.
    pub texels: u64,
}

impl core::ops::AddAssign for Work {
    fn add_assign(&mut self, other: Self) {
        self.maps += other.maps;
        self.casters += other.casters;
        self.triangles += other.triangles;
        self.texels += other.texels;
    }
}

pub fn percent(part: usize, whole: usize) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}

impl Studio {
    /// What is drawn along a path, if always drawing takes so much; Bevy's maps are never held.
    pub fn drawn_along(&mut self, stances: &[Stance], always: Work) -> Drawn {
        let Some(still) = self.needed_work(stances, &[]) else {
            return Drawn {
                always,
                still: always,
                few: always,
                all: always,
            };
        };
        let casters = self.casters();
        let few: Vec<_> = casters.iter().skip(50).step_by(100).copied().collect();
        let mut moving = |movers: &[Entity]| self.needed_work(stances, movers).unwrap_or(always);
        Drawn {
            always,
            still,
            few: moving(&few),
            all: moving(&casters),
        }
    }

    /// What is drawn along a path if maps are held, while some casters tremble; `None` for Bevy's, which
    /// never are.
    fn needed_work(&mut self, stances: &[Stance], movers: &[Entity]) -> Option<Work> {
        self.set_updates(MapUpdates::WhenNeeded)?;
        self.forget();
        let mut needed = Work::default();
        for (frame, stance) in stances.iter().enumerate() {
            let by = if frame % 2 == 0 { STEP } else { -STEP };
            self.shift(movers, by);
            self.pass(stance);
            needed += self.work();
        }
        if stances.len() % 2 == 1 {
            self.shift(movers, -STEP);
        }
        self.set_updates(MapUpdates::EveryFrame)?;
        Some(needed)
    }

    /// In the order of their entities.
    fn casters(&mut self) -> Vec<Entity> {
        let world = self.world();
        let mut casters = world
            .query_filtered::<Entity, (With<Mesh3d>, With<Transform>, Without<NotShadowCaster>)>();
        let mut casters: Vec<Entity> = casters.iter(world).collect();
        casters.sort_unstable();
        casters
    }

    fn shift(&mut self, movers: &[Entity], by: f32) {
        for mover in movers {
            if let Some(mut at) = self.world().get_mut::<Transform>(*mover) {
                at.translation.y += by;
            }
        }
    }

    pub fn set_updates(&mut self, updates: MapUpdates) -> Option<()> {
        let sun = self.sun;
        let mut shadows = self.world().get_mut::<ParallelSplitShadows>(sun)?;
        shadows.comparison.updates = updates;
        Some(())
    }

    /// What has to be drawn in this frame.
    pub fn work(&mut self) -> Work {
        let (camera, sun, is_ours) = (self.camera, self.sun, self.is_ours());
        let world = self.world();
        let frame = Frame::of(world, default(), camera, sun, is_ours);
        let costs = frame.casters.iter().zip(&frame.triangles).zip(&frame.maps);
        let maps = costs.map(|((casters, triangles), size)| Work {
            maps: 1,
            casters: *casters,
            triangles: *triangles,
            texels: area(*size),
        });
        let plans = world.get::<ShadowPlans>(sun).filter(|_| is_ours);
        let plans = plans.and_then(|plans| plans.views.get(&camera));
        let mut work = Work::default();
        let Some(plans) = plans else {
            maps.for_each(|map| work += map);
            return work;
        };
        for (plan, whole) in plans.iter().zip(maps) {
            work += match plan.map.as_ref().and_then(|map| map.redraw) {
                None => Work::default(),
                Some(Redraw::Added) => Work {
                    maps: 1,
                    ..default()
                },
                Some(_) => whole,
            };
        }
        let Some(casters) = world.get::<CasterCascades>(sun) else {
            return work;
        };
        let drawn_over = [&casters.added, &casters.moving].map(|views| views.get(&camera));
        for (caster, cascades) in drawn_over.into_iter().flatten().flatten() {
            let count = cascades.iter().count();
            work.casters += count;
            work.triangles += count * triangles_of(world, *caster);
        }
        // What moves is drawn over a copy.
        let moving = casters.moving.get(&camera).into_iter().flatten();
        let has_moving: HashSet<usize> = moving.flat_map(|(_, it)| it.iter()).collect();
        let copied = has_moving.iter().filter_map(|index| frame.maps.get(*index));
        work.texels += copied.map(|size| area(*size)).sum::<u64>();
        work
    }
}
