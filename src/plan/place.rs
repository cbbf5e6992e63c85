//! Placing all maps of a view: each over what its cascade covers, and together where the view turns.

use glam::UVec2;

use super::{
    CascadeHistory, PlanInputs,
    map::{PlacedMap, place},
    turning::Turning,
    volume::CascadeVolume,
};
use crate::{config::MapFit, geometry::light_frame::LightFrame};

/// What maps are placed by, for each cascade.
pub(super) struct Placing<'a> {
    pub inputs: &'a PlanInputs<'a>,
    pub volumes: &'a [Option<CascadeVolume>],
    pub fits: &'a [MapFit],
    pub sizes: &'a [UVec2],
    /// That maps are laid in: closer to the sun where a map's texels are finer than those that it could wait with.
    pub frames: &'a mut [LightFrame],
}

impl Placing<'_> {
    /// The maps of all cascades.
    ///
    /// When a steady one has to grow while the view turns, all are widened: otherwise one after the other would.
    pub fn place_all(
        &mut self,
        kept: &mut [CascadeHistory],
        turning: &mut Turning,
    ) -> Vec<Option<PlacedMap>> {
        let cascades = 0..self.sizes.len();
        let before: Vec<_> = kept.iter().map(|kept| kept.extent).collect();
        let mut placed: Vec<_> = cascades
            .clone()
            .map(|index| self.place(index, &mut kept[index]))
            .collect();
        // Of those that see something.
        let is_steady = |index: &usize| {
            placed[*index].is_some() && self.fits.get(*index) == Some(&MapFit::Steady)
        };
        let steady: Vec<usize> = cascades.filter(is_steady).collect();
        let has_grown = |index: &usize| {
            let mut extents = kept[*index].extent.iter().zip(&before[*index]);
            extents.any(|(now, before)| now.has_grown(before))
        };
        let grown: Vec<usize> = steady.iter().copied().filter(has_grown).collect();
        let slack = self.inputs.slack();
        if !grown.is_empty()
            && let Some(widening) = turning.widen(slack)
        {
            for index in if widening.of_all { steady } else { grown } {
                let kept = &mut kept[index];
                kept.extent
                    .iter_mut()
                    .for_each(|extent| extent.spread(widening.steps));
                placed[index] = self.place(index, kept);
            }
        }
        placed
    }

    fn place(&mut self, index: usize, kept: &mut CascadeHistory) -> Option<PlacedMap> {
        let volume = self.volumes.get(index)?.as_ref()?;
        let CascadeHistory { extent, sun, .. } = kept;
        let mut place_in = |light: &LightFrame| {
            let inputs = PlanInputs {
                light,
                ..*self.inputs
            };
            let slack = inputs.slack();
            let (fit, size) = (self.fits[index], self.sizes[index]);
            place(&inputs, volume, fit, size, slack, extent)
        };
        let frame = &mut self.frames[index];
        let mut placed = place_in(frame)?;
        let closer = sun.frame_for(self.inputs, volume.middle(), placed.texel);
        if let Some(closer) = closer {
            *frame = closer;
            placed = place_in(frame)?;
        }
        sun.texel = placed.texel;
        Some(placed)
    }
}
