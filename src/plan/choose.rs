//! What [`CascadeFit::Auto`] chooses, from predictions.

use glam::UVec2;

use super::{
    CascadeHistory, PlanInputs,
    layout::{Layout, follows_receivers, is_focused, wedges},
    map,
    size::even_size,
    volume::CascadeVolume,
};
use crate::{
    config::{CascadeFit, MAX_CASCADES, MapFit, MapWarp, SplitScheme},
    geometry::hysteresis::{Kept, Slack},
};

/// Pixels across a texel; finer is not sharper.
const FINE_ENOUGH: f64 = 0.5;

/// A tight map takes a warped one's place if its texels are so many times smaller, and gives it back
/// when they are no smaller.
const CLEARLY: f64 = 1.25;

/// A choice is kept until another is better by so much.
const HOLD: f64 = 1.1;

/// Pixels across a texel of a map, as predicted where they are most.
fn coarseness(inputs: &PlanInputs, volume: &CascadeVolume, fit: MapFit, size: UVec2) -> f64 {
    map::place(
        inputs,
        volume,
        fit,
        size,
        Slack(0.0),
        &mut Default::default(),
    )
    .and_then(|map| map.aliasing(inputs, volume))
    .map_or(f64::INFINITY, |worst| {
        let pixels = worst.pixels_per_texel(size.as_dvec2(), inputs.image_height);
        (pixels.x * pixels.y).sqrt().max(FINE_ENOUGH)
    })
}

/// The least worst error warps even where a tight map is finer all over, as in streets that run along
/// the light's axes: the one of the two whose texels are smaller over what is seen, on average.
fn warped_or_tight(
    inputs: &PlanInputs,
    volume: Option<&CascadeVolume>,
    index: usize,
    kept: Option<MapFit>,
) -> MapFit {
    let warped = MapFit::Warped(MapWarp::Minimax);
    let kept = kept.unwrap_or(warped);
    let size = even_size(inputs.config, index);
    let coarseness = |fit: MapFit| {
        let (volume, kept) = (volume?, &mut Default::default());
        let map = map::place(inputs, volume, fit, size, Slack(0.0), kept)?;
        map.mean_aliasing(inputs, volume)
    };
    match (coarseness(warped), coarseness(MapFit::Tight)) {
        (Some(warp), Some(tight)) if warp > CLEARLY * tight => MapFit::Tight,
        (Some(warp), Some(tight)) if tight > warp => warped,
        _ => kept,
    }
}

/// The fit of a cascade and, if there was a choice, its coarseness.
pub(super) fn fit(
    inputs: &PlanInputs,
    volume: Option<&CascadeVolume>,
    index: usize,
    kept: Option<MapFit>,
) -> (MapFit, f64) {
    let mut fits = inputs.config.fit.of_cascade(index);
    let first = fits.next().unwrap_or_default();
    // All of a slice is as the literature has it.
    let is_rival = matches!(
        inputs.config.fit,
        CascadeFit::Warped(_) | CascadeFit::PerCascade(_)
    );
    if first == MapFit::Warped(MapWarp::Minimax) && is_rival && is_focused(inputs) {
        return (warped_or_tight(inputs, volume, index, kept), 0.0);
    }
    let (CascadeFit::Auto { sharpness }, Some(volume)) = (&inputs.config.fit, volume) else {
        let kept = kept.filter(|_| inputs.config.fit.chooses());
        return (kept.unwrap_or(first), 0.0);
    };
    // How much finer a fit must be to be worth its edges' crawling.
    let handicap = |fit: MapFit| {
        let most = f64::from(*sharpness).recip();
        let handicap = match fit {
            MapFit::Stable => 1.0,
            MapFit::Steady | MapFit::Tight => 1.01 * most.sqrt(),
            MapFit::Warped(_) => 1.02 * most,
        };
        if kept == Some(fit) {
            handicap / HOLD
        } else {
            handicap
        }
    };
    let size = even_size(inputs.config, index);
    let of = |fit| {
        let coarse = coarseness(inputs, volume, fit, size);
        (fit, coarse, coarse * handicap(fit))
    };
    let stable = of(first);
    if stable.1 <= FINE_ENOUGH {
        return (first, stable.1);
    }
    let best = fits.map(of).fold(
        stable,
        |best, other| {
            if other.2 < best.2 { other } else { best }
        },
    );
    (best.0, best.1)
}

/// Slices that end at less than so many times the depth at which they begin hold much the same.
const LEAST_RATIO: f64 = 1.1;

/// Slices that a range of depths is worth.
fn most_slices(inputs: &PlanInputs, range: [f64; 2]) -> usize {
    let all = inputs.config.cascades as usize;
    if !follows_receivers(inputs) {
        return all;
    }
    let worth = (range[1] / range[0]).ln() / LEAST_RATIO.ln();
    (worth.ceil() as usize).clamp(1, all)
}

/// Doubles a number in two steps, so that one which is twice too large is held for a while and then let go.
const FACE_SLACK: Slack = Slack(core::f64::consts::SQRT_2 - 1.0);

/// How many slices are worth a cascade: the fewest that are predicted to be about as sharp as any
/// number is. `faces` is the number of faces that there is room for in each, where those have maps of their
/// own.
pub(super) fn slice_count(
    inputs: &PlanInputs,
    range: [f64; 2],
    kept: Option<usize>,
    faces: &mut Kept<f64>,
) -> usize {
    let config = inputs.config;
    let all = most_slices(inputs, range);
    if config.fit == CascadeFit::Faces {
        // The number of faces changes with the direction of light and view. Once there have been
        // many, slices stay as few as those leave for a while, or shadows would change to and fro.
        let room = FACE_SLACK.round_up(wedges(inputs).len().max(1) as f64, faces);
        return (f64::from(config.cascades) / room).round() as usize;
    }
    if !config.fit.chooses() || matches!(config.splits, SplitScheme::Manual(_)) {
        return all;
    }
    let coarsest: Vec<f64> = (1..=all)
        .map(|count| {
            let layout = Layout::new(inputs, range, count);
            let volumes = layout.volumes(inputs, &mut <[CascadeHistory; MAX_CASCADES]>::default());
            let coarse = |(index, volume): (usize, &Option<CascadeVolume>)| {
                let (_, coarse) = fit(inputs, volume.as_ref(), index, None);
                coarse
            };
            volumes.iter().enumerate().map(coarse).fold(0.0, f64::max)
        })
        .collect();
    let least = coarsest.iter().copied().fold(f64::INFINITY, f64::min);
    let fewest = |share: f64| {
        let good = coarsest.iter().position(|coarse| *coarse <= share * least);
        good.map_or(all, |index| index + 1)
    };
    match kept {
        Some(kept) if kept <= all && coarsest[kept - 1] <= HOLD * HOLD * least => {
            kept.min(fewest(HOLD.sqrt()))
        }
        _ => fewest(HOLD),
    }
}
