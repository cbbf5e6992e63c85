//! What is drawn along a path where maps that serve are held.

use bevy_pssm::{MapUpdates, ParallelSplitShadows, ShadowPlans, plan::CascadePlan};

use super::{
    cost::triangles_of_cascades,
    studio::{Stance, Studio},
};

/// In percent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrawnShare {
    /// Of maps.
    pub maps: f64,
    /// Of their casters' triangles.
    pub triangles: f64,
}

impl Default for DrawnShare {
    fn default() -> Self {
        Self {
            maps: 100.0,
            triangles: 100.0,
        }
    }
}

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
        let needed = self.needed_work(stances).map(|needed| DrawnShare {
            maps: percent(needed.maps, every.maps),
            triangles: percent(needed.triangles, every.triangles),
        });
        needed.unwrap_or_default()
    }

    /// What is drawn along a path if maps are held; `None` for Bevy's, which never are.
    fn needed_work(&mut self, stances: &[Stance]) -> Option<Work> {
        self.set_updates(MapUpdates::WhenNeeded)?;
        self.forget();
        let mut needed = Work::default();
        for stance in stances {
            self.pass(stance);
            needed += self.work();
        }
        self.set_updates(MapUpdates::EveryFrame)?;
        Some(needed)
    }

    fn set_updates(&mut self, updates: MapUpdates) -> Option<()> {
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
        let is_drawn = |plan: &CascadePlan| {
            let map = plan.map.as_ref();
            map.is_some_and(|map| map.redraw.is_some())
        };
        let drawn = plans
            .iter()
            .zip(triangles)
            .filter(|(plan, _)| is_drawn(plan));
        drawn.fold(Work::default(), |mut work, (_, triangles)| {
            work += Work { maps: 1, triangles };
            work
        })
    }
}
