//! What receives shadows before a camera, as boxes: where cascades are worth anything.

use std::sync::{Mutex, PoisonError};

use glam::{BVec4, DVec3, DVec4};

use super::{
    body::{ConvexBody, ROUNDING},
    half_space::HalfSpace,
    oriented_box::OrientedBox,
    slice::{Depth, Slice, ViewVolume},
};

/// Bounds of something along the world's axes and in depth: x, y, z and the depth before the eye
/// (meters). Ends in no order if it is nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent {
    /// Lower ends.
    pub lo: DVec4,
    /// Upper ends.
    pub hi: DVec4,
}

impl Extent {
    /// Holds nothing.
    pub const NOTHING: Self = Self {
        lo: DVec4::INFINITY,
        hi: DVec4::NEG_INFINITY,
    };

    /// Has no bounds.
    pub const EVERYTHING: Self = Self {
        lo: DVec4::NEG_INFINITY,
        hi: DVec4::INFINITY,
    };

    /// Whether it holds nothing.
    pub fn is_empty(&self) -> bool {
        self.lo.cmpgt(self.hi).any()
    }

    /// Whether all ends are finite.
    pub fn is_finite(&self) -> bool {
        self.lo.is_finite() && self.hi.is_finite()
    }

    /// The half-spaces that bound it.
    pub fn planes(&self, depth: &Depth) -> [HalfSpace; 8] {
        let plane = |normal: DVec3, distance: f64| HalfSpace { normal, distance };
        [
            plane(DVec3::X, self.hi.x),
            plane(DVec3::Y, self.hi.y),
            plane(DVec3::Z, self.hi.z),
            plane(DVec3::NEG_X, -self.lo.x),
            plane(DVec3::NEG_Y, -self.lo.y),
            plane(DVec3::NEG_Z, -self.lo.z),
            depth.beyond(self.lo.w),
            depth.before(self.hi.w),
        ]
    }

    fn of_points(points: &[DVec3], depth: &Depth) -> Self {
        points.iter().fold(Self::NOTHING, |bounds, point| {
            let at = point.extend(depth.of(*point));
            bounds.or(&Self { lo: at, hi: at })
        })
    }

    fn or(&self, other: &Self) -> Self {
        Self {
            lo: self.lo.min(other.lo),
            hi: self.hi.max(other.hi),
        }
    }

    fn and(&self, other: &Self) -> Self {
        Self {
            lo: self.lo.max(other.lo),
            hi: self.hi.min(other.hi),
        }
    }

    fn holds(&self, other: &Self) -> bool {
        (self.lo.cmple(other.lo) & self.hi.cmpge(other.hi)) == BVec4::TRUE
    }
}

/// The boxes of everything that a camera sees and that receives shadows.
#[derive(Debug)]
pub struct Receivers {
    depth: Depth,
    nearest: f64,
    farthest: f64,
    boxes: Vec<Extent>,
    everywhere: bool,
    fog: bool,
    /// What has been found in slices already: those of a camera at rest are asked for again.
    found: Mutex<Vec<(Slice, Extent)>>,
}

/// More slices than this are not remembered: two lights' worth.
const MOST_SLICES: usize = 16;

impl Receivers {
    /// None yet.
    pub fn new(view: &ViewVolume) -> Self {
        Self {
            depth: Depth::new(view),
            nearest: view.nearest(),
            farthest: view.far,
            boxes: Vec::new(),
            everywhere: false,
            fog: false,
            found: Mutex::default(),
        }
    }

    /// Leaves out what is wholly deeper than that (meters).
    pub fn before(mut self, depth: f64) -> Self {
        self.farthest = self.farthest.min(depth);
        self
    }

    /// Something that receives shadows wherever the camera looks.
    pub fn everywhere(view: &ViewVolume) -> Self {
        Self {
            everywhere: true,
            ..Self::new(view)
        }
    }

    /// Fog, which receives shadows in the air.
    pub fn fog(view: &ViewVolume) -> Self {
        Self {
            fog: true,
            ..Self::everywhere(view)
        }
    }

    /// Adds something without bounds.
    pub fn add_everywhere(&mut self) {
        self.everywhere = true;
    }

    /// Adds what lies in a box. Not if the box is not finite or wholly before or behind what is seen.
    pub fn add(&mut self, bounds: &OrientedBox) {
        let OrientedBox { center, half_axes } = bounds;
        let half = half_axes.x_axis.abs() + half_axes.y_axis.abs() + half_axes.z_axis.abs();
        let reach = bounds.reach(self.depth.per_meter);
        let middle = center.extend(self.depth.of(*center));
        let half = half.extend(reach);
        let bounds = Extent {
            lo: middle - half,
            hi: middle + half,
        };
        let is_seen = bounds.hi.w >= self.nearest && bounds.lo.w <= self.farthest;
        if bounds.is_finite() && is_seen {
            self.boxes.push(bounds);
            self.found
                .get_mut()
                .unwrap_or_else(PoisonError::into_inner)
                .clear();
        }
    }

    /// Whether they have no bounds.
    pub fn are_everywhere(&self) -> bool {
        self.everywhere
    }

    /// Whether fog is among them.
    pub fn has_fog(&self) -> bool {
        self.fog
    }

    /// For each slice of the view the bounds of what they have in it, exactly: each box is clipped
    /// by the slice. Empty where there is nothing, without bounds where they have none.
    pub fn in_slices<'a>(
        &self,
        slices: impl IntoIterator<Item = Option<&'a Slice>>,
    ) -> Vec<Extent> {
        let slices: Vec<_> = slices.into_iter().collect();
        if self.everywhere {
            return vec![Extent::EVERYTHING; slices.len()];
        }
        let mut known = self.found.lock().unwrap_or_else(PoisonError::into_inner);
        let known_in = |known: &[(Slice, Extent)], slice: &Slice| {
            let mut found = known.iter().filter(|(of, _)| of == slice);
            found.next().map(|(_, extent)| *extent)
        };
        let mut contents: Vec<(&Slice, SliceContent)> = Vec::new();
        for slice in slices.iter().flatten() {
            let is_new = known_in(&known, slice).is_none();
            if is_new && contents.iter().all(|(other, _)| other != slice) {
                contents.push((slice, SliceContent::new(slice, &self.depth)));
            }
        }
        for it in &self.boxes {
            for (_, content) in &mut contents {
                content.add(it);
            }
        }
        let contents = contents.into_iter();
        let new: Vec<_> = contents
            .map(|(slice, content)| (slice.clone(), content.finish(&self.depth)))
            .collect();
        let found = slices.into_iter().map(|slice| {
            let slice = slice?;
            known_in(&known, slice).or_else(|| known_in(&new, slice))
        });
        let found = found
            .map(|found| found.unwrap_or(Extent::NOTHING))
            .collect();
        if known.len() + new.len() > MOST_SLICES {
            known.clear();
        }
        known.extend(new);
        found
    }
}

/// A slice, and what has been found in it.
struct SliceContent {
    bounds: Extent,
    body: ConvexBody,
    planes: Vec<HalfSpace>,
    /// Around what lies wholly inside.
    found: Extent,
    /// What may reach in from outside.
    crossing: Vec<Extent>,
}

impl SliceContent {
    fn new(slice: &Slice, depth: &Depth) -> Self {
        let body = ConvexBody::of_slice(slice);
        Self {
            bounds: Extent::of_points(&body.corners, depth),
            planes: body.planes().collect(),
            body,
            found: Extent::NOTHING,
            crossing: Vec::new(),
        }
    }

    fn add(&mut self, it: &Extent) {
        // Most lie before or behind.
        if it.lo.w > self.bounds.hi.w || it.hi.w < self.bounds.lo.w || self.adds_nothing(it) {
            return;
        }
        let center = 0.5 * (it.lo + it.hi).truncate();
        let half = 0.5 * (it.hi - it.lo).truncate();
        // What is at the edge of a view that is hardly larger than that must not be lost.
        let rounding = ROUNDING * center.abs().max_element();
        let mut is_inside = true;
        for plane in &self.planes {
            let beyond = plane.normal.dot(center) - plane.distance;
            let reach = plane.normal.abs().dot(half);
            if beyond > reach + rounding {
                return;
            }
            is_inside &= beyond <= -reach;
        }
        if is_inside {
            self.found = self.found.or(it);
        } else {
            self.crossing.push(*it);
        }
    }

    fn adds_nothing(&self, it: &Extent) -> bool {
        let at_most = it.and(&self.bounds);
        at_most.is_empty() || self.found.holds(&at_most)
    }

    /// Only what would make that larger is worth the clipping.
    fn finish(mut self, depth: &Depth) -> Extent {
        for it in core::mem::take(&mut self.crossing) {
            if !self.adds_nothing(&it) {
                let part = self.body.clone().within(it.planes(depth));
                let part = Extent::of_points(&part.corners, depth);
                self.found = self.found.or(&part);
            }
        }
        self.found
    }
}
