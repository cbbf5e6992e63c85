//! What is drawn along a path where maps that serve are held.

use bevy::{light::NotShadowCaster, prelude::*};
use bevy_pssm::{CasterCascades, MapUpdates, ParallelSplitShadows, ShadowPlans, plan::Redraw};

use super::{
    cost::{triangles_of, triangles_of_cascades},
    studio::{Stance, Studio},
};

/// In percent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrawnShare {
    /// Of maps.
    pub maps: f64,
    /// Of their casters' triangles.
    pub triangles: f64,
    /// Of the same, with one in a hundred casters moving.
    pub triangles_moving: f64,
    /// And with all of them.
    pub triangles_all_moving: f64,
}

impl Default for DrawnShare {
    fn default() -> Self {
        Self {
            maps: 100.0,
            triangles: 100.0,
            triangles_moving: 100.0,
            triangles_all_moving: 100.0,
        }
    }
}

/// How far what moves goes in a frame (meters).
const STEP: f32 = 0.125;

/// Maps drawn, and what into them.
#[derive(Default, Clone, Copy)]
pub struct Work {
    maps: usize,
    triangles: usize,
}

impl core::ops::AddAssign for Work {
    fn add_assign(&mut self, other: Self) {
        self.maps += other.maps;
        self.triangles += other.triangles;
    }
}

pub fn percent(part: usize, whole: usize) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}

impl Studio {
    /// What is drawn along a path if maps are held, of what drawing them in every frame takes; all of Bevy's, which
    /// never are.
    pub fn share_drawn(&mut self, stances: &[Stance], every: Work) -> DrawnShare {
        let Some(resting) = self.needed_work(stances, &[]) else {
            return DrawnShare::default();
        };
        let casters = self.casters();
        let few: Vec<_> = casters.iter().skip(50).step_by(100).copied().collect();
        let mut with_moving = |movers: &[Entity]| {
            let work = self.needed_work(stances, movers).unwrap_or_default();
            percent(work.triangles, every.triangles)
        };
        DrawnShare {
            maps: percent(resting.maps, every.maps),
            triangles: percent(resting.triangles, every.triangles),
            triangles_moving: with_moving(&few),
            triangles_all_moving: with_moving(&casters),
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

    /// What the plugin has to draw in this frame.
    pub fn work(&mut self) -> Work {
        let (camera, sun) = (self.camera, self.sun);
        let world = self.world();
        let plans = world.get::<ShadowPlans>(sun);
        let Some(plans) = plans.and_then(|plans| plans.views.get(&camera)) else {
            return Work::default();
        };
        let triangles = triangles_of_cascades(world, camera, sun);
        let mut work = Work::default();
        for (plan, triangles) in plans.iter().zip(triangles) {
            work += match plan.map.as_ref().and_then(|map| map.redraw) {
                None => Work::default(),
                Some(Redraw::Added) => Work {
                    maps: 1,
                    triangles: 0,
                },
                Some(_) => Work { maps: 1, triangles },
            };
        }
        if let Some(casters) = world.get::<CasterCascades>(sun) {
            let drawn_over = [&casters.added, &casters.moving].map(|views| views.get(&camera));
            for (caster, cascades) in drawn_over.into_iter().flatten().flatten() {
                work.triangles += cascades.iter().count() * triangles_of(world, *caster);
            }
        }
        work
    }
}
