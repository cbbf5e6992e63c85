//! Casters that move: maps hold what rests, and what moves is drawn over them in each frame.

use bevy::ecs::entity::{Entity, EntityHashMap};

/// For so many frames a caster has to rest before maps hold it again.
const QUIET: u32 = 60;

/// They come to rest together, every so many frames: each time, maps are drawn anew.
const BATCH: u32 = 20;

/// Casters that have moved of late.
#[derive(Debug, Default)]
pub struct MovingCasters {
    /// For how many frames each has rested.
    casters: EntityHashMap<u32>,
    frame: u32,
}

impl MovingCasters {
    pub fn len(&self) -> usize {
        self.casters.len()
    }

    pub fn contains(&self, caster: Entity) -> bool {
        !self.casters.is_empty() && self.casters.contains_key(&caster)
    }

    pub fn iter(&self) -> impl Iterator<Item = Entity> {
        self.casters.keys().copied()
    }

    pub fn clear(&mut self) {
        self.casters.clear();
    }

    /// Whether it was one of them.
    pub fn remove(&mut self, caster: Entity) -> bool {
        self.casters.remove(&caster).is_some()
    }

    /// Takes those in that have moved in this frame, and gives those back that have come to rest.
    pub fn update(&mut self, moved: Vec<Entity>) -> Vec<Entity> {
        // Counted from the first that moves, so that the same motion has the same maps drawn.
        self.frame = if self.casters.is_empty() {
            0
        } else {
            self.frame.wrapping_add(1)
        };
        for rested in self.casters.values_mut() {
            *rested = rested.saturating_add(1);
        }
        self.casters
            .extend(moved.into_iter().map(|caster| (caster, 0)));
        if !self.frame.is_multiple_of(BATCH) {
            return Vec::new();
        }
        let resting = self.casters.extract_if(|_, rested| *rested > QUIET);
        resting.map(|(caster, _)| caster).collect()
    }
}
