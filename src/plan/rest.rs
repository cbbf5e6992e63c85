//! Whether another plan would be the last one again: where a camera rests, and all that it sees.

use super::{CascadePlan, PlanHistory, PlanInputs};
use crate::{
    config::MapUpdates,
    geometry::{fit::LookupReach, light_frame::LightFrame, slice::ViewVolume},
};

/// What a plan was made from, but for its configuration, receivers and changes.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Given {
    view: ViewVolume,
    light: LightFrame,
    reach: LookupReach,
    image_height: f64,
    has_fog: bool,
}

impl Given {
    fn of(inputs: &PlanInputs) -> Self {
        Self {
            view: *inputs.view,
            light: *inputs.light,
            reach: inputs.reach,
            image_height: inputs.image_height,
            has_fog: inputs.receivers.has_fog(),
        }
    }
}

/// What the last plan was made from, and whether it left the history as it was and had no map drawn.
#[derive(Debug, Default, Clone, Copy, PartialEq)]
pub(super) struct Rest {
    given: Option<Given>,
    is_at_rest: bool,
}

impl PlanHistory {
    /// Whether the next plan would be the last one again, if its receivers are the same.
    pub fn is_at_rest(&self, inputs: &PlanInputs) -> bool {
        self.rest.is_at_rest
            && self.rest.given == Some(Given::of(inputs))
            && self.config.as_ref() == Some(inputs.config)
            && inputs.changes.are_none()
    }

    /// What it is before a plan from the same as the last: others leave nothing as it was.
    pub(super) fn before(&mut self, inputs: &PlanInputs) -> Option<Self> {
        let given = Some(Given::of(inputs));
        let is_same = self.rest.given == given;
        self.rest = Rest {
            given,
            is_at_rest: false,
        };
        is_same.then(|| self.clone())
    }

    /// Notes whether a plan has left all as it was before.
    pub(super) fn note_rest(
        &mut self,
        inputs: &PlanInputs,
        before: Option<&Self>,
        plans: &[CascadePlan],
    ) {
        let maps = || plans.iter().filter_map(|plan| plan.map.as_ref());
        self.rest.is_at_rest = inputs.config.comparison.updates == MapUpdates::WhenNeeded
            && maps().all(|map| map.redraw.is_none())
            && before == Some(self);
    }
}
