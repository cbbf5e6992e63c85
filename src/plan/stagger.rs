//! Which of the maps that are due are drawn in a frame.

use glam::UVec2;

use super::{PlanInputs, Redraw, held::HeldMap};
use crate::config::{CascadeFit, UpdateBudget};

/// Whose turn it is to be drawn in a frame: who have waited longest, of those the nearest first.
#[derive(Debug)]
pub(super) struct Turn {
    budget: UpdateBudget,
    spent: u64,
    /// For whom a part of the budget is kept, and how much of it.
    reserved: Vec<(usize, u64)>,
}

impl Turn {
    pub fn new<'a>(budget: UpdateBudget, held: impl Iterator<Item = Option<&'a HeldMap>>) -> Self {
        let waited = held.enumerate().filter_map(|(index, held)| {
            let (frames, size) = held?.waiting()?;
            Some((frames, (index, budget.cost(size))))
        });
        let mut waited: Vec<_> = waited.collect();
        waited.sort_by_key(|(frames, _)| core::cmp::Reverse(*frames));
        let mut left = budget.whole();
        let fitting = waited
            .into_iter()
            .enumerate()
            .map_while(|(rank, (_, map))| {
                let fits = rank == 0 || map.1 <= left;
                left = left.saturating_sub(map.1);
                fits.then_some(map)
            });
        Self {
            budget,
            spent: 0,
            reserved: fitting.collect(),
        }
    }

    /// Whether a map that is due waits, for so many frames already.
    pub fn is_for_another(
        &self,
        inputs: &PlanInputs,
        (index, size): (usize, UVec2),
        (redraw, waited): (Redraw, u32),
    ) -> bool {
        let config = inputs.config;
        // Suns that move have turns of their own, and those that jump, or worlds that are moved, cannot wait.
        let can_wait = redraw != Redraw::Light
            // Another side's map may have taken its place.
            && config.fit != CascadeFit::Faces;
        let is_reserved = self.reserved.iter().any(|it| it.0 == index);
        let kept: u64 = self.reserved.iter().map(|it| it.1).sum();
        let before = self
            .spent
            .saturating_add(if is_reserved { 0 } else { kept });
        let after = before.saturating_add(self.budget.cost(size));
        let is_anothers = before > 0 && after > self.budget.whole();
        can_wait && is_anothers && waited < config.delay
    }

    /// A map's turn is over, whether it has been drawn or not.
    pub fn pass(&mut self, (index, size): (usize, UVec2), is_drawn: bool) {
        self.reserved.retain(|it| it.0 != index);
        if is_drawn {
            self.spent = self.spent.saturating_add(self.budget.cost(size));
        }
    }
}
