//! A few of very many meshes that change, to tell whether they still do.

use bevy::ecs::entity::Entity;

use super::caster_state::Found;

/// Some of the meshes that may have changed, while records are old: theirs alone are kept up to date.
#[derive(Debug, Default)]
pub(super) struct Sample {
    pub meshes: Vec<Entity>,
    /// One of so many.
    share: usize,
    /// Frames for which it has told.
    age: u32,
}

impl Sample {
    /// Meshes of a sample.
    const SIZE: usize = 128;

    /// Frames for which it is believed: others may change by then.
    const LIFE: u32 = 16;

    /// Others in each `frame`: some may always be suspects, and never change.
    pub fn new<'a>(meshes: impl Iterator<Item = &'a [Entity]> + Clone, frame: u64) -> Self {
        let count: usize = meshes.clone().map(<[Entity]>::len).sum();
        let share = count.div_ceil(Self::SIZE).max(1);
        let first = (frame % share as u64) as usize;
        Self {
            meshes: meshes
                .flatten()
                .skip(first)
                .step_by(share)
                .copied()
                .collect(),
            share,
            age: 0,
        }
    }

    pub fn is_empty(&self) -> bool {
        self.meshes.is_empty()
    }

    /// Whether more than so many meshes change by what is found of these.
    pub fn is_flood(&mut self, found: &Found, most: usize) -> bool {
        self.age += 1;
        found.is_flood(most / self.share.max(1))
    }

    /// Whether others are to tell from now on.
    pub fn is_old(&self) -> bool {
        self.age >= Self::LIFE
    }
}
