//! Which maps stay as they are: what a layer holds, what is needed of it now, and what has changed.

use glam::{DQuat, DVec2, DVec3, UVec2};

use super::{CascadeMap, PlanInputs, map::PlacedMap, stagger::Turn, volume::CascadeVolume};
use crate::config::{CasterCulling, MapUpdates};
use crate::geometry::{
    body::ConvexBody, fit::MapBox, hull::CasterHull, light_frame::LightFrame, slice::ViewVolume,
};

/// Why a map is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Redraw {
    /// There was none, or none that what changed since is known of.
    New,
    /// The light has turned, or texel grids are anchored elsewhere.
    Light,
    /// Its size, fit or texels are others.
    Size,
    /// What receives shadows has left what the map covers; or casters have been added to it many times.
    Moved,
    /// A caster that it holds, or is to hold, has changed.
    Casters,
    /// More casters matter now than it was drawn with, or have come: those that it does not hold are drawn over those that
    /// it does.
    Added,
    /// The settings say so.
    EveryFrame,
}

/// What a cascade's layer holds.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct HeldMap {
    placed: PlacedMap,
    size: UVec2,
    light: LightFrame,
    /// What was seen, and the middle of what was to be covered, in world space.
    view: ViewVolume,
    center_ws: DVec3,
    map: CascadeMap,
    /// Hulls of the casters that it held before more were added.
    earlier_hulls: Vec<CasterHull>,
    /// Hulls of which it holds the casters, but for some that have come later.
    partial_hulls: Vec<CasterHull>,
    /// How often casters have been added.
    additions: usize,
    /// It has outlived the frame that it was drawn anew in.
    has_lasted: bool,
    /// Why it should have been drawn anew, and how many frames ago.
    owed: Option<(Redraw, u32)>,
}

impl HeldMap {
    pub fn texel(&self) -> DVec2 {
        self.placed.texel
    }

    /// For how many frames it has been due, if it is, and its size (texels).
    pub fn waiting(&self) -> Option<(u32, UVec2)> {
        let (_, frames) = self.owed?;
        Some((frames, self.size))
    }

    /// Whether it has ever been drawn with the casters that matter to a body, and so holds them. If so, it is for those
    /// from now on.
    fn comes_back_to(&mut self, body: &ConvexBody, margin: f64) -> bool {
        let hull = &mut self.map.hull;
        if hull.contains(body, margin) {
            return true;
        }
        let mut earlier = self.earlier_hulls.iter_mut();
        let found = earlier.find(|earlier| earlier.contains(body, margin));
        found
            .map(|earlier| core::mem::swap(earlier, hull))
            .is_some()
    }

    /// Why it cannot stand in for the one that is wanted, if it cannot.
    fn why_redraw(
        &mut self,
        inputs: &PlanInputs,
        volume: &CascadeVolume,
        wanted: &PlacedMap,
        size: UVec2,
    ) -> Option<Redraw> {
        const ROUNDING: f64 = 1e-9;
        let texel = wanted.texel.max_element();
        let is_same_texel = wanted
            .texel
            .abs_diff_eq(self.placed.texel, ROUNDING * texel);
        let covers = match (&self.placed.map_box, &wanted.map_box) {
            (Some(held), Some(_)) => spare(inputs, volume, held).min_element() >= -ROUNDING * texel,
            _ => wanted.clip_from_world == self.placed.clip_from_world,
        };
        let why = if self.light != *inputs.light {
            Some(Redraw::Light)
        } else if self.size != size || self.placed.fit != wanted.fit || !is_same_texel {
            Some(Redraw::Size)
        } else if self.has_stale_casters(inputs) {
            Some(Redraw::Casters)
        } else if !covers {
            Some(Redraw::Moved)
        } else if self.lacks_casters(inputs)
            || !self.comes_back_to(&volume.body, wanted.margin(inputs))
        {
            // Without culling a map holds more than its hulls tell.
            let is_off = inputs.config.comparison.culling == CasterCulling::Off;
            Some(if is_off || self.additions >= MOST_ADDITIONS {
                Redraw::Moved
            } else {
                Redraw::Added
            })
        } else {
            None
        };
        match (why, self.owed) {
            // It has come back to what it holds.
            (None, Some((Redraw::Added, _))) => {
                self.owed = None;
                None
            }
            // What is added to holds nothing else that is due.
            (None | Some(Redraw::Added), Some((owed, _))) => Some(owed),
            _ => why,
        }
    }

    /// Whether casters have come that are where those are that it holds.
    fn lacks_casters(&self, inputs: &PlanInputs) -> bool {
        let mut hulls = self.earlier_hulls.iter().chain([&self.map.hull]);
        hulls.any(|hull| inputs.changes.come_to(hull))
    }

    /// Whether casters have changed that it holds, or that matter to what is seen.
    fn has_stale_casters(&self, inputs: &PlanInputs) -> bool {
        let hulls = self.earlier_hulls.iter().chain(&self.partial_hulls);
        let mut hulls = hulls.chain([&self.map.hull]);
        hulls.any(|hull| inputs.changes.meet(hull))
    }
}

/// How often casters are added before a map is drawn anew, and holds none any more that no longer matter.
const MOST_ADDITIONS: usize = 32;

fn spare(inputs: &PlanInputs, volume: &CascadeVolume, map_box: &MapBox) -> DVec3 {
    let corners = volume.body.corners.iter().copied();
    map_box.spare(corners, inputs.light, inputs.reach)
}

/// How far what is needed may move while a map is held (meters).
#[derive(Debug, Default, Clone)]
pub(super) struct Spare {
    /// In any direction.
    pub around: f64,
    /// Where its corners come if the view goes on as it did, in world space.
    pub ahead_ws: Vec<DVec3>,
}

/// No more often than this goes on what has moved a view: its middle may have stood still.
const MOST_TIMES: f64 = 16.0;

/// Steps in which a view's way is followed.
const STEPS: [f64; 4] = [0.25, 0.5, 0.75, 1.0];

/// Halvings by which it is found how long a map can serve.
const HALVINGS: u32 = 12;

/// Where the corners of what is needed come, if what moved from one view to the other goes on so many times.
fn corners_ahead(
    volume: &CascadeVolume,
    before: &ViewVolume,
    now: &ViewVolume,
    times: f64,
) -> Vec<DVec3> {
    let (Some(from), Some(to)) = (before.forward(), now.forward()) else {
        return Vec::new();
    };
    let (axis, angle) = DQuat::from_rotation_arc(from, to).to_axis_angle();
    let at = |share: f64| {
        let turn = DQuat::from_axis_angle(axis, share * angle);
        let eye = now.eye + share * (now.eye - before.eye);
        let corners = volume.body.corners.iter();
        corners.map(move |corner| eye + turn * (*corner - now.eye))
    };
    STEPS
        .into_iter()
        .flat_map(|step| at(step * times))
        .collect()
}

/// How far a map's casters reach beyond what needs them when it is drawn, as shares of the radius of that: in all
/// directions, and on its way. More can be added any time: these are for how seldom.
const AROUND: f64 = 0.015;
const AHEAD: f64 = 0.18;

fn radius(volume: &CascadeVolume) -> f64 {
    let center = volume.body.center();
    let corners = volume.body.corners.iter();
    corners.fold(0.0, |radius, corner| center.distance(*corner).max(radius))
}

/// The box that serves longest if a view goes on as it did, of those that `laid` gives for the points that are needed until some
/// time; and how many times what moved the view can then be repeated.
fn longest(
    inputs: &PlanInputs,
    volume: &CascadeVolume,
    before: &ViewVolume,
    first: MapBox,
    laid: impl Fn(&[DVec3]) -> MapBox,
) -> (MapBox, f64) {
    let serving = |times: f64| {
        let mut points = corners_ahead(volume, before, inputs.view, times);
        points.extend(&volume.body.corners);
        let map_box = laid(&points);
        let spare = map_box.spare(points.iter().copied(), inputs.light, inputs.reach);
        (spare.min_element() >= 0.0).then_some(map_box)
    };
    let mut best = (first, 0.0);
    let mut step = MOST_TIMES;
    for _ in 0..HALVINGS {
        if let Some(map_box) = serving(best.1 + step) {
            best = (map_box, best.1 + step);
        }
        step *= 0.5;
    }
    best
}

/// A map that is drawn, ahead of what moves as far as it has texels to spare, and how far what is
/// needed may then move.
fn ahead(
    inputs: &PlanInputs,
    volume: &CascadeVolume,
    wanted: PlacedMap,
    redraw: Redraw,
    held: Option<&HeldMap>,
) -> (PlacedMap, Spare) {
    let Some(map_box) = wanted.map_box else {
        return (wanted, Spare::default());
    };
    let radius = radius(volume);
    let spare_ls = spare(inputs, volume, &map_box).truncate();
    let around = spare_ls.max_element().min(AROUND * radius).max(0.0);
    match (redraw, held) {
        // What its casters have drawn anew each frame need hold none for the frames to come.
        (Redraw::Casters, Some(held)) if !held.has_lasted => (wanted, Spare::default()),
        (Redraw::Moved | Redraw::Added, Some(held)) => {
            let (first, is_laid) = match held.placed.map_box {
                Some(held) if redraw == Redraw::Added => (held, true),
                _ => (map_box, false),
            };
            let laid = |points: &[DVec3]| match is_laid {
                true => first,
                false => first.about(points.iter().copied(), inputs.light),
            };
            let (map_box, serves) = longest(inputs, volume, &held.view, first, laid);
            let placed = PlacedMap::of_box(map_box, inputs.light, wanted.fit);
            let moved = volume.body.center().distance(held.center_ws);
            let times = (AHEAD * radius / moved).min(serves);
            let ahead_ws = corners_ahead(volume, &held.view, inputs.view, times);
            (placed, Spare { around, ahead_ws })
        }
        _ => {
            let ahead_ws = Vec::new();
            (wanted, Spare { around, ahead_ws })
        }
    }
}

/// The map that is wanted, or the one that is held if that serves as well. `None` if it has no extent.
pub(super) fn hold(
    inputs: &PlanInputs,
    volume: &CascadeVolume,
    wanted: PlacedMap,
    (index, size): (usize, UVec2),
    turn: &mut Turn,
    held: &mut Option<HeldMap>,
) -> Option<CascadeMap> {
    let had_lasted = held.as_ref().is_some_and(|held| held.has_lasted);
    let mut redraw = held.as_mut().map_or(Some(Redraw::New), |held| {
        held.why_redraw(inputs, volume, &wanted, size)
    });
    if let (Some(due), Some(held)) = (redraw, held.as_mut()) {
        let waited = held.owed.map_or(0, |(_, frames)| frames);
        let lacks_casters = held.lacks_casters(inputs);
        let is_to_hold =
            |hull: &CasterHull| inputs.changes.meet(hull) || inputs.changes.come_to(hull);
        let is_urgent = inputs.changes.are_urgent()
            && (lacks_casters
                || held.has_stale_casters(inputs)
                || is_to_hold(&wanted.hull(inputs, volume)));
        let is_anothers = turn.is_for_another(inputs, (index, size), (due, waited));
        if held.size == size && !is_urgent && is_anothers {
            // What has come is not told of again.
            let due = if lacks_casters { Redraw::Casters } else { due };
            held.owed = Some((due, waited + 1));
            redraw = None;
        }
    }
    turn.pass((index, size), redraw.is_some());
    if let Some(redraw) = redraw {
        let before = held.take();
        let (placed, spare) = ahead(inputs, volume, wanted, redraw, before.as_ref());
        let (mut earlier_hulls, mut partial_hulls) = (Vec::new(), Vec::new());
        let mut additions = 0;
        if let (Redraw::Added, Some(before)) = (redraw, before) {
            additions = before.additions + 1;
            let hulls = before.earlier_hulls.into_iter();
            let hulls = hulls.chain([before.map.hull]);
            let are_partial = |hull: &CasterHull| inputs.changes.come_to(hull);
            (partial_hulls, earlier_hulls) = hulls.partition(are_partial);
            partial_hulls.extend(before.partial_hulls);
        }
        *held = Some(HeldMap {
            map: placed.finish(inputs, volume, spare, redraw)?,
            placed,
            size,
            light: *inputs.light,
            view: *inputs.view,
            center_ws: volume.body.center(),
            earlier_hulls,
            partial_hulls,
            additions,
            has_lasted: false,
            owed: None,
        });
    }
    let held = held.as_mut()?;
    held.has_lasted = redraw.is_none() || redraw == Some(Redraw::Added) && had_lasted;
    let mut map = CascadeMap {
        aliasing: held.placed.aliasing(inputs, volume),
        redraw,
        ..held.map.clone()
    };
    if redraw.is_none() {
        let as_drawn = PlanInputs {
            light: &held.light,
            ..*inputs
        };
        map.hull_now = held.placed.hull(&as_drawn, volume);
    }
    if inputs.config.comparison.updates == MapUpdates::EveryFrame {
        let is_anew = redraw.is_some_and(|redraw| redraw != Redraw::Added);
        map.redraw = redraw.filter(|_| is_anew).or(Some(Redraw::EveryFrame));
        // It need not last.
        map.hull = map.hull_now.clone();
    }
    Some(map)
}
