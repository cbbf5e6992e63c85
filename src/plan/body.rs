//! The part of a slice that a map must cover.

use glam::DVec3;

use super::{CascadeHistory, PlanInputs, layout::is_focused};
use crate::geometry::{
    body::{ConvexBody, HalfSpace},
    face::Wedge,
    receivers::Bounds,
    slice::Slice,
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
    /// `None` if there is nothing in it.
    pub fn new(
        inputs: &PlanInputs,
        interval: (f64, f64),
        bounds: Bounds,
        history: &mut CascadeHistory,
    ) -> Option<Self> {
        let body = Self::of_slice(inputs, interval)?;
        if !is_focused(inputs) {
            return Some(body);
        }
        let bounds = steady_bounds(bounds, inputs.config.slack, body.slice.radius, history);
        body.clipped(&ConvexBody::planes_of_box(bounds))
    }

    /// All of a slice.
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
            let per_depth = view.per_depth();
            let normal = -per_depth.normalize();
            let beyond = HalfSpace {
                normal,
                distance: normal.dot(view.eye) - config.near / per_depth.length(),
            };
            body.beyond_near = Some(body.whole.clone().within([beyond]));
        }
        Some(body)
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

fn steady_bounds(
    [lo, hi]: Bounds,
    slack: f64,
    radius: f64,
    history: &mut CascadeHistory,
) -> Bounds {
    if !(lo.is_finite() && hi.is_finite()) {
        return [lo, hi];
    }
    let pad = DVec3::splat(LEAST_THICKNESS * radius);
    let needed = [lo - pad, hi + pad];
    let [x, y, z] = [0, 1, 2].map(|axis| {
        let needed = needed.map(|corner| corner[axis]);
        Slack(slack).interval(needed, radius, &mut history.bounds[axis])
    });
    [DVec3::new(x[0], y[0], z[0]), DVec3::new(x[1], y[1], z[1])]
}
