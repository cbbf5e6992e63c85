//! Where cascades begin and end.

use super::{CascadeHistory, PlanInputs, split::split_planes, volume::CascadeVolume};
use crate::{
    config::{CascadeFit, MapFit, ShadowFocus, SplitScheme},
    geometry::{
        face::Wedge,
        hysteresis::{Hold, Kept, Slack},
    },
};

/// Slices along the view and, where faces have maps of their own, wedges across it: each slice has
/// one cascade for each wedge.
pub(super) struct Layout {
    far: f64,
    blend: f64,
    /// One more than slices that cascades may be for; planes of those not in use lie at the end.
    planes: Vec<f64>,
    /// Depth at which shadows begin to fade.
    fade_start: f64,
    slices: usize,
    wedges: Vec<Wedge>,
}

impl Layout {
    /// `range` is where splits are spread; the last slice reaches to the configuration's far all
    /// the same. At most so many `slices` as there are cascades for.
    pub fn new(inputs: &PlanInputs, range: [f64; 2], slices: usize) -> Self {
        let config = inputs.config;
        let wedges = wedges(inputs);
        let slices = slices.min(config.cascades as usize / wedges.len().max(1));
        let mut planes = split_planes(&config.splits, range[0], range[1], slices);
        planes.resize(config.cascades as usize + 1, inputs.far());
        // The last slice, the first to reach the range's end, reaches farther.
        for plane in &mut planes[1..] {
            if *plane >= range[1] {
                *plane = inputs.far();
            }
        }
        Self {
            far: inputs.far(),
            blend: f64::from(config.blend),
            planes,
            fade_start: fade_start(inputs),
            slices,
            wedges,
        }
    }

    /// Slices that are in use.
    pub fn slices(&self) -> usize {
        self.slices
    }

    fn slice(&self, index: usize) -> usize {
        index / self.wedges.len().max(1)
    }

    /// The wedge that a cascade is for.
    pub fn wedge(&self, index: usize) -> Option<Wedge> {
        let count = self.wedges.len();
        (index < self.slices * count).then(|| self.wedges[index % count])
    }

    /// Depth at which a cascade begins to give way.
    pub fn blend_start(&self, index: usize) -> f64 {
        self.blend_start_of(self.slice(index))
    }

    fn blend_start_of(&self, slice: usize) -> f64 {
        let [near, far] = [self.planes[slice], self.planes[slice + 1]];
        if far >= self.far {
            self.fade_start.max(near)
        } else {
            far - self.blend * (far - near)
        }
    }

    /// Depths that a cascade must cover.
    pub fn interval(&self, index: usize) -> (f64, f64) {
        let slice = self.slice(index);
        let near = if slice == 0 {
            f64::NEG_INFINITY
        } else {
            self.blend_start_of(slice - 1)
        };
        (near, self.planes[slice + 1])
    }

    /// What the cascades in use must cover.
    pub fn volumes(
        &self,
        inputs: &PlanInputs,
        kept: &mut [CascadeHistory],
    ) -> Vec<Option<CascadeVolume>> {
        let used = self.slices * self.wedges.len().max(1);
        let mut volumes: Vec<_> = (0..used)
            .map(|index| {
                let slice = self.slice(index);
                // Where planes fall together the cascade before already reaches this far: the first has none.
                (slice == 0 || self.planes[slice] < self.planes[slice + 1])
                    .then(|| CascadeVolume::of_slice(inputs, self.interval(index)))?
            })
            .collect();
        if is_focused(inputs) {
            // All cascades of a slice have the same depths.
            let slices: Vec<_> = (0..self.slices)
                .map(|slice| {
                    let index = slice * self.wedges.len().max(1);
                    volumes[index].as_ref()?;
                    let (near, far) = self.interval(index);
                    let view = inputs.view;
                    view.slice(near * (1.0 - ROUNDING), far * (1.0 + ROUNDING))
                })
                .collect();
            let slices = slices.iter().map(Option::as_ref);
            let found = inputs.receivers.in_slices(slices);
            for (index, (volume, kept)) in volumes.iter_mut().zip(kept).enumerate() {
                let found = found[self.slice(index)];
                let is_steady = inputs.config.fit.of_cascade(index).next() == Some(MapFit::Steady);
                *volume = volume
                    .take()
                    .and_then(|volume| volume.focused(inputs, found, is_steady, kept));
            }
        }
        let in_wedge = |(index, volume): (usize, Option<CascadeVolume>)| match self.wedge(index) {
            Some(wedge) => volume?.within(wedge),
            None => volume,
        };
        volumes.into_iter().enumerate().map(in_wedge).collect()
    }
}

/// What lies this close to a slice, as a share of its depth, may be taken for in it: the GPU reckons
/// in `f32`.
const ROUNDING: f64 = 1e-5;

/// Depth at which shadows begin to fade, whatever splits are spread over: a share of the last
/// slice that the configuration would have.
fn fade_start(inputs: &PlanInputs) -> f64 {
    let (config, near, far) = (inputs.config, inputs.near(), inputs.far());
    let planes = split_planes(&config.splits, near, far, config.cascades as usize);
    // Where the last planes fall together, the first to reach them is the last to be seen.
    let last = planes.iter().rfind(|plane| **plane < far);
    far - f64::from(config.fade) * (far - last.unwrap_or(&near))
}

/// The wedges that share each slice, if faces of the view have maps of their own.
pub(super) fn wedges(inputs: &PlanInputs) -> Vec<Wedge> {
    // Fog looks its cascade up by depth alone.
    if inputs.config.fit == CascadeFit::Faces && !inputs.receivers.has_fog() {
        Wedge::of_view(inputs.view, inputs.light.z)
    } else {
        Vec::new()
    }
}

/// Whether maps are fitted to what receives shadows.
pub(super) fn is_focused(inputs: &PlanInputs) -> bool {
    inputs.config.comparison.focus == ShadowFocus::Receivers && !inputs.receivers.are_everywhere()
}

/// Slack of the range of depths where maps may be stable.
const MIN_STABLE_SLACK: f64 = 0.25;

/// Slack of the range of depths of steady maps.
const STEADY_SLACK: f64 = 1.0;

/// Splits of steady maps may come nearer late, while the first slice is at most so many times as deep as it would be,
const MOST_LATE: f64 = 1.4;

/// and that by so many steps of the depth at which they begin.
pub(super) const MOST_LATE_STEPS: u32 = 2;

/// A range of depths is no thinner than this, as a share: planes should not fall together.
const MIN_THICKNESS: f64 = 1e-3;

/// The depths between which splits are spread: those at which anything receives shadows, or did when anything
/// was seen last. For a while what has come nearer lies before them, where that hardly matters to splits of steady maps.
pub(super) fn split_range(
    inputs: &PlanInputs,
    last: Option<[f64; 2]>,
    kept: &mut KeptRange,
) -> [f64; 2] {
    let PlanInputs { view, .. } = inputs;
    let whole = [inputs.near(), inputs.far()];
    if !follows_receivers(inputs) {
        return whole;
    }
    let Some(slice) = view.slice(whole[0], whole[1]) else {
        return whole;
    };
    let found = inputs.receivers.in_slices([Some(&slice)])[0];
    let near = (found.lo.w * (1.0 - MIN_THICKNESS)).max(whole[0]);
    let far = (found.hi.w * (1.0 + MIN_THICKNESS)).min(whole[1]);
    if near >= far {
        return last.unwrap_or(whole);
    }
    // Where maps may be stable, planes should be, too.
    let fit = &inputs.config.fit;
    let least_slack = if fit.any(|fit| fit == MapFit::Steady) {
        STEADY_SLACK
    } else if fit.chooses() {
        MIN_STABLE_SLACK
    } else {
        0.0
    };
    let slack = Slack(inputs.slack().0.max(least_slack));
    // Shares of depths where those differ much, and of their difference where not.
    let end = slack.round_up(far, &mut kept.far);
    let thickness = (far - near).log2().ceil().exp2();
    let by_thickness = slack.interval([near, far], thickness, &mut kept.both);
    let end = end.min(by_thickness[1]).min(whole[1]);
    // Where splits become others all the same, they begin where they should.
    let is_same_end = last.is_some_and(|last| last[1] == end);
    kept.near.lag_at_most(if is_same_end {
        late_steps(inputs, slack, [near, far])
    } else {
        0
    });
    let start = slack.round_down(near, &mut kept.near);
    [start.max(by_thickness[0]).max(whole[0]), end]
}

/// By how many steps splits over a range may begin too deep: the first slice begins at the eye all the same.
fn late_steps(inputs: &PlanInputs, slack: Slack, [near, far]: [f64; 2]) -> u32 {
    let config = inputs.config;
    let first_plane = |near| split_planes(&config.splits, near, far, config.cascades as usize)[1];
    let near = slack.round_down(near, &mut Kept::default());
    let is_fine = |steps: &u32| {
        let late = near * (1.0 + slack.0).powf(f64::from(*steps));
        // Thin ranges are worth fewer slices.
        2.0 * late < far && first_plane(late) <= MOST_LATE * first_plane(near)
    };
    (1..=MOST_LATE_STEPS)
        .take_while(is_fine)
        .last()
        .unwrap_or(0)
}

/// Whether splits are spread over what is seen.
pub(super) fn follows_receivers(inputs: &PlanInputs) -> bool {
    let config = inputs.config;
    let is_stable = config.fit.any(|fit| fit == MapFit::Stable) && !config.fit.chooses();
    is_focused(inputs) && !is_stable && !matches!(config.splits, SplitScheme::Manual(_))
}

/// A range of depths that is kept from frame to frame.
#[derive(Debug, Default, Clone, Copy, PartialEq)]
pub(super) struct KeptRange {
    near: Kept<f64>,
    far: Kept<f64>,
    both: Kept<[f64; 2]>,
}

impl KeptRange {
    /// Nothing yet.
    pub fn with(hold: Hold) -> Self {
        let mut kept = Self::default();
        kept.hold_as(hold);
        kept
    }

    /// Holds on in another way; only where splits begin may lag.
    pub fn hold_as(&mut self, hold: Hold) {
        self.near.hold_as(hold);
        let hold = Hold { lag: 0, ..hold };
        self.far.hold_as(hold);
        self.both.hold_as(hold);
    }
}
