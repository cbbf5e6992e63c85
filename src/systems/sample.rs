//! A few of very many meshes that change, to tell whether they still do.

use bevy::ecs::entity::Entity;

use super::caster_state::Found;

/// Some of the meshes that may have changed, while records are old: theirs are of the last frame.
#[derive(Debug, Default)]
pub(super) struct Sample {
    pub meshes: Vec<Entity>,
    /// One of so many.
    share: usize,
    /// Frames for which it has told, and for which it is believed: others may change by then.
    age: u32,
    life: u32,
}

impl Sample {
    /// Meshes of a sample.
    const SIZE: usize = 128;

    /// Frames for which the first is believed, and any: twice as long as the one before.
    const LIFE: u32 = 16;
    const MOST_LIFE: u32 = 64;

    /// The next one, of others in each `frame`: some may always be suspects, and never change.
    pub fn renewed(&self, suspects: &[Entity], frame: u64) -> Self {
        let share = suspects.len().div_ceil(Self::SIZE).max(1);
        let first = (frame % share as u64) as usize;
        let suspects = suspects.iter().copied();
        Self {
            meshes: suspects.skip(first).step_by(share).collect(),
            share,
            age: 0,
            life: (2 * self.life).clamp(Self::LIFE, Self::MOST_LIFE),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.meshes.is_empty()
    }

    /// Has it tell for one more frame whether more than so many meshes change, by what is found of these.
    pub fn tell_flood(&mut self, found: &Found, most: usize) -> bool {
        self.age += 1;
        found.is_flood(most / self.share.max(1))
    }

    /// Whether it is not too old to tell.
    pub fn is_believed(&self) -> bool {
        self.age < self.life
    }
}
