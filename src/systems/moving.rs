//! Casters that move: maps hold what rests, and what moves is drawn over them in each frame.

use bevy::ecs::entity::{Entity, EntityHashMap, EntityHashSet};

/// For so many frames a caster has to rest before maps hold it again.
const QUIET: u32 = 60;

/// A caster that has just come, and is taken to move, has come to rest after so many frames.
const TRIED: u32 = 4;

/// Nothing has moved of late once nothing has for so many frames: maps are then drawn in one piece again.
pub const STILL: u32 = 120;

/// They come to rest together, every so many frames: each time, maps are drawn anew.
const BATCH: u32 = 20;

/// Once its mesh or material has been edited so many times, with less than `QUIET` frames in between, a caster counts
/// as moving: one that is loaded may change as it comes, and as its mesh and its material are there.
const EDITS: u32 = 4;

/// Casters that have moved of late.
#[derive(Debug, Default)]
pub struct MovingCasters {
    /// For how many frames each has rested.
    casters: EntityHashMap<u32>,
    /// For how many more frames there have been some of late.
    lately: u32,
    frame: u32,
    /// How often each has been edited, and when last.
    edits: EntityHashMap<(u32, u32)>,
    /// Frames in which edits have been noted.
    edit_frame: u32,
    /// Those that are edited again and again, and have been since the last frame.
    edited: EntityHashSet,
    /// Those of `edits` whose mesh was not there.
    late: EntityHashSet,
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

    /// Whether any moves, or has done so of late.
    pub fn has_moved_of_late(&self) -> bool {
        self.lately > 0
    }

    /// Takes those in that have just come and may move: they rest soon if they do not.
    pub fn try_out(&mut self, come: impl Iterator<Item = Entity>) {
        for caster in come {
            self.casters.entry(caster).or_insert(QUIET + 1 - TRIED);
        }
    }

    /// Whether it was one of them.
    pub fn remove(&mut self, caster: Entity) -> bool {
        self.casters.remove(&caster).is_some()
    }

    /// Those that count as moving for being edited.
    pub fn edited(&self) -> &EntityHashSet {
        &self.edited
    }

    /// Whether it has been edited again and again, up to now.
    pub fn is_edited_often(&self, caster: Entity) -> bool {
        let is_often = |(times, last): &(u32, u32)| {
            *times >= EDITS && self.edit_frame.wrapping_sub(*last) < QUIET
        };
        self.edits.get(&caster).is_some_and(is_often)
    }

    /// Takes in whose mesh, material or mask has changed since the last frame. Whatever has been edited before its mesh
    /// was there, is new once that is.
    pub fn note_edits(
        &mut self,
        edited: impl Iterator<Item = Entity>,
        has_mesh: impl Fn(Entity) -> bool,
    ) {
        for caster in self.late.extract_if(|caster| has_mesh(*caster)) {
            self.edits.remove(&caster);
        }
        self.edited.clear();
        self.edit_frame = self.edit_frame.wrapping_add(1);
        let frame = self.edit_frame;
        if frame.is_multiple_of(QUIET) {
            self.edits
                .retain(|_, (_, last)| frame.wrapping_sub(*last) < QUIET);
            self.late.retain(|caster| self.edits.contains_key(caster));
        }
        for caster in edited {
            let (times, last) = self.edits.entry(caster).or_default();
            let age = frame.wrapping_sub(*last);
            *times = match age {
                0 => *times,
                _ if age < QUIET => *times + 1,
                _ => 1,
            };
            *last = frame;
            if !has_mesh(caster) {
                self.late.insert(caster);
            }
            if *times >= EDITS {
                self.edited.insert(caster);
            }
        }
    }

    /// Takes those in that have moved in this frame, and gives those back that have come to rest.
    pub fn update(&mut self, moved: Vec<Entity>) -> Vec<Entity> {
        // Counted from the first that moves, so that the same motion has the same maps drawn.
        self.frame = if self.casters.is_empty() {
            0
        } else {
            self.frame.wrapping_add(1)
        };
        // Those that are only tried do not have more tried.
        let is_any_left = self.casters.values().any(|rested| *rested < QUIET - TRIED);
        self.lately = if moved.is_empty() && !is_any_left {
            self.lately.saturating_sub(1)
        } else {
            STILL
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
