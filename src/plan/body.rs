//! The part of a slice that a map must cover.

use glam::{DVec3, DVec4};

use super::{CascadeHistory, PlanInputs};
use crate::geometry::{
    body::{ConvexBody, HalfSpace},
    face::Wedge,
    receivers::Extent,
    slice::{Depth, Slice},
    steady::Slack,
};

pub(super) struct Body {
    pub slice: Slice,
    /// What of the slice can receive shadows.
    pub whole: ConvexBody,
    /// That from the configuration's near on, if it is less: at the eye no map is large enough.
    beyond_near: Option<ConvexBody>,
    /// Along what a warp runs, if that is not the configuration's.
    pub axis: Option<DVec3>,
}

impl Body {
    /// All of a slice. `None` if there is nothing between the depths.
    pub fn of_slice(inputs: &PlanInputs, (near, far): (f64, f64)) -> Option<Self> {
        let PlanInputs { view, config, .. } = inputs;
        let slice = view.slice(near, far)?;
        let whole = ConvexBody::of_slice(&slice);
        let mut body = Self {
            slice,
            whole,
            beyond_near: None,
            axis: None,
        };
        if near < config.near {
            let beyond = Depth::new(view).beyond(config.near);
            body.beyond_near = Some(body.whole.clone().within([beyond]));
        }
        Some(body)
    }

    /// The part in which something receives shadows, if there is any. `found` is their extent.
    pub fn focused(
        self,
        inputs: &PlanInputs,
        found: Extent,
        history: &mut CascadeHistory,
    ) -> Option<Self> {
        if found.is_empty() {
            return None;
        }
        let found = steady_extent(found, inputs.config.slack, self.slice.radius, history);
        self.clipped(&found.planes(&Depth::new(inputs.view)))
    }

    /// What of it predictions and warps are for.
    pub fn seen(&self) -> &ConvexBody {
        let beyond = self.beyond_near.as_ref();
        beyond
            .filter(|beyond| !beyond.is_empty())
            .unwrap_or(&self.whole)
    }

    /// The part in a wedge, if there is any.
    pub fn within(self, wedge: Wedge) -> Option<Self> {
        let body = self.clipped(&wedge.planes)?;
        Some(Self {
            axis: Some(wedge.axis),
            ..body
        })
    }

    fn clipped(mut self, planes: &[HalfSpace]) -> Option<Self> {
        self.whole = self.whole.within(planes.iter().copied());
        self.beyond_near = self
            .beyond_near
            .map(|beyond| beyond.within(planes.iter().copied()));
        (!self.whole.is_empty()).then_some(self)
    }
}

/// Bodies are at least this thick, as a share of the slice's radius: flat ones have no faces.
const LEAST_THICKNESS: f64 = 1e-4;

fn steady_extent(found: Extent, slack: f64, radius: f64, history: &mut CascadeHistory) -> Extent {
    let pad = DVec4::splat(LEAST_THICKNESS * radius);
    let [lo, hi] = [found.lo - pad, found.hi + pad];
    let slack = Slack(slack);
    let [x, y, z] = [0, 1, 2].map(|axis| {
        let needed = [lo[axis], hi[axis]];
        slack.interval(needed, radius, &mut history.bounds[axis])
    });
    let [near, far] = &mut history.depths;
    Extent {
        lo: DVec4::new(x[0], y[0], z[0], slack.shorter(lo.w, near)),
        hi: DVec4::new(x[1], y[1], z[1], slack.length(hi.w, far)),
    }
}
