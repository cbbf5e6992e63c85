//! The volume that a map must cover: a slice, or the part of one in which anything receives shadows.

use glam::{DVec3, DVec4};

use super::{CascadeHistory, PlanInputs};
use crate::geometry::{
    body::{ConvexBody, ROUNDING},
    face::Wedge,
    half_space::HalfSpace,
    receivers::Extent,
    slice::{Depth, Slice},
};

/// What a cascade's map must cover.
pub(super) struct CascadeVolume {
    pub slice: Slice,
    /// What of the slice can receive shadows.
    pub body: ConvexBody,
    /// That from the configuration's near on, if it is less: at the eye no map is large enough.
    beyond_near: Option<ConvexBody>,
    /// Height of the middle of what receives shadows, in world space: a body that is held may be much thicker.
    level: f64,
    /// Along what a warp runs, if that is not the configuration's.
    pub axis: Option<DVec3>,
}

impl CascadeVolume {
    /// All of a slice. `None` if there is nothing between the depths.
    pub fn of_slice(inputs: &PlanInputs, (near, far): (f64, f64)) -> Option<Self> {
        let slice = inputs.view.slice(near, far)?;
        let body = ConvexBody::of_slice(&slice);
        let mut volume = Self {
            level: slice.center.y,
            slice,
            body,
            beyond_near: None,
            axis: None,
        };
        if near < inputs.near() {
            let beyond = Depth::new(inputs.view).beyond(inputs.near());
            volume.beyond_near = Some(volume.body.clone().within([beyond]));
        }
        Some(volume)
    }

    /// The part in which something receives shadows, if there is any. `found` is their extent.
    pub fn focused(
        mut self,
        inputs: &PlanInputs,
        found: Extent,
        is_steady: bool,
        history: &mut CascadeHistory,
    ) -> Option<Self> {
        if found.is_empty() {
            return None;
        }
        self.level = 0.5 * (found.lo.y + found.hi.y);
        // A steady map's extent is held, not what it is fitted to.
        let found = if is_steady {
            padded(inputs, found, self.slice.radius)
        } else {
            kept_extent(inputs, found, self.slice.radius, history)
        };
        self.clipped(&found.planes(&Depth::new(inputs.view)))
    }

    /// The middle of what receives shadows.
    pub fn middle(&self) -> DVec3 {
        self.body.center().with_y(self.level)
    }

    /// What of it predictions and warps are for.
    pub fn seen(&self) -> &ConvexBody {
        let beyond = self.beyond_near.as_ref();
        beyond
            .filter(|beyond| !beyond.is_empty())
            .unwrap_or(&self.body)
    }

    /// The part in a wedge, if there is any.
    pub fn within(self, wedge: Wedge) -> Option<Self> {
        Some(Self {
            axis: Some(wedge.axis),
            ..self.clipped(&wedge.planes)?
        })
    }

    fn clipped(mut self, planes: &[HalfSpace]) -> Option<Self> {
        self.body = self.body.within(planes.iter().copied());
        self.beyond_near = self
            .beyond_near
            .map(|beyond| beyond.within(planes.iter().copied()));
        (!self.body.is_empty()).then_some(self)
    }
}

/// Bodies are at least this thick, as a share of the slice's radius: flat ones have no faces.
const MIN_THICKNESS: f64 = 1e-4;

/// Thicker, too, than what clipping takes for flat: what has been found must not be lost again.
fn padded(inputs: &PlanInputs, found: Extent, radius: f64) -> Extent {
    let rounding = 2.0 * ROUNDING * inputs.view.eye.abs().max_element();
    let pad = DVec4::splat(rounding.max(MIN_THICKNESS * radius));
    Extent {
        lo: found.lo - pad,
        hi: found.hi + pad,
    }
}

fn kept_extent(
    inputs: &PlanInputs,
    found: Extent,
    radius: f64,
    history: &mut CascadeHistory,
) -> Extent {
    let (slack, origin) = (inputs.slack(), inputs.light.origin);
    let Extent { lo, hi } = padded(inputs, found, radius);
    // In steps of what there is, which may be much less than the slice.
    let size = (hi - lo).truncate().max_element();
    let scale = (0.5 * size).log2().ceil().exp2().min(radius);
    let [x, y, z] = [0, 1, 2].map(|axis| {
        let needed = [lo[axis], hi[axis]].map(|end| end - origin[axis]);
        let kept = slack.interval(needed, scale, &mut history.bounds[axis]);
        kept.map(|end| end + origin[axis])
    });
    let [near, far] = &mut history.depths;
    Extent {
        lo: DVec4::new(x[0], y[0], z[0], slack.round_down(lo.w, near)),
        hi: DVec4::new(x[1], y[1], z[1], slack.round_up(hi.w, far)),
    }
}
