//! How large maps are.

use glam::{DVec2, UVec2};

use super::{CascadeHistory, PlanInputs, layout::Layout, map, volume::CascadeVolume};
use crate::{
    config::{MIN_MAP_SIZE, MapFit, MapSize, ParallelSplitShadows},
    geometry::{aliasing::Aliasing, hysteresis::Slack},
};

/// Sizes from a budget change in steps no smaller than this: with the largest all memory is
/// allocated anew.
const MIN_SLACK: f64 = 0.05;

/// Of an even share, what every map gets.
const LEAST_SHARE: f64 = 0.25;

/// Sides are no longer than so many of an even share's: layers are as large as the largest map.
const MOST_SIDE: f64 = core::f64::consts::SQRT_2;

/// A size for predictions before sizes are known.
pub(super) fn even_size(config: &ParallelSplitShadows, index: usize) -> UVec2 {
    match config.map_size {
        MapSize::Budget(texels) => {
            let even = f64::from(texels) / f64::from(config.cascades);
            UVec2::splat(even.sqrt() as u32)
        }
        _ => config.map_size.of_cascade(index).unwrap_or_default(),
    }
}

/// Texels along the axes of all cascades: as configured, or shares of the budget.
///
/// `inputs_of` has those of each cascade that there is.
pub(super) fn map_sizes(
    inputs_of: &[PlanInputs],
    layout: &Layout,
    volumes: &[Option<CascadeVolume>],
    fits: &[MapFit],
    kept: &mut [CascadeHistory],
) -> Vec<UVec2> {
    let Some(inputs) = inputs_of.first() else {
        return Vec::new();
    };
    let config = inputs.config;
    let count = config.cascades as usize;
    let MapSize::Budget(budget) = config.map_size else {
        let of_cascade = |index| config.map_size.of_cascade(index);
        return (0..count).filter_map(of_cascade).collect();
    };
    let even = even_size(config, 0);
    let predicted = |index: usize| -> Option<Aliasing> {
        let (inputs, fit) = (&inputs_of[index], fits[index]);
        // A stable map's size must not depend on what is in its slice.
        let whole = (fit == MapFit::Stable)
            .then(|| CascadeVolume::of_slice(inputs, layout.interval(index)))
            .flatten();
        let volume = whole.as_ref().or(volumes[index].as_ref())?;
        let map = map::place(
            inputs,
            volume,
            fit,
            even,
            Slack(0.0),
            &mut Default::default(),
        )?;
        map.aliasing(inputs, volume)
    };
    let aliasing: Vec<_> = (0..volumes.len()).map(predicted).collect();
    let total: f64 = aliasing.iter().flatten().map(|it| it.storage()).sum();
    let slack = Slack(inputs.slack().0.max(MIN_SLACK));
    let even = even.as_dvec2();
    let (least, most) = (LEAST_SHARE * even.element_product(), MOST_SIDE * even);
    // What is left once all have the least.
    let rest = f64::from(budget) - least * count as f64;
    (0..count)
        .map(|index| {
            let Some(aliasing) = aliasing.get(index).copied().flatten() else {
                return UVec2::splat(MIN_MAP_SIZE);
            };
            let texels = least + rest * aliasing.storage() / total;
            let width = aliasing.balanced_resolution(texels).x;
            // Where one side is as long as can be, the other gets no more for it.
            let least_side = f64::from(MIN_MAP_SIZE);
            let widest = most.x.min(texels / least_side);
            let width = width.max(texels / most.y).max(least_side).min(widest);
            let wanted = DVec2::new(width, (texels / width).min(most.y));
            let [across, up] = &mut kept[index].size;
            let size = DVec2::new(
                slack.round_down(wanted.x, across),
                slack.round_down(wanted.y, up),
            );
            size.as_uvec2().max(UVec2::splat(MIN_MAP_SIZE))
        })
        .collect()
}
