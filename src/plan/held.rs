//! Which maps stay as they are: what a layer holds, what is needed of it now, and what has changed.

use glam::{DQuat, DVec2, DVec3, UVec2};

use super::{CascadeMap, PlanInputs, map::PlacedMap, volume::CascadeVolume};
use crate::config::{CascadeFit, MapUpdates};
use crate::geometry::{
    fit::MapBox, light_frame::LightFrame, oriented_box::OrientedBox, slice::ViewVolume,
};

/// Why a map is drawn anew.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Redraw {
    /// There was none, or none that what changed since is known of.
    New,
    /// The light has turned, or texel grids are anchored elsewhere.
    Light,
    /// Its size, fit or texels are others.
    Size,
    /// What receives shadows has left what the map covers.
    Moved,
    /// A caster that it holds, or is to hold, has changed.
    Casters,
    /// The settings say so.
    EveryFrame,
}

/// Casters that have changed since the last plan.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum CasterChanges {
    /// Some, nobody knows where.
    #[default]
    Anywhere,
    /// Where they were, and where they are.
    At(Vec<OrientedBox>),
    /// The same, or `None` for anywhere: some are drawn over maps no more, and are in none yet. Maps that are to
    /// hold them cannot wait.
    AtOnce(Option<Vec<OrientedBox>>),
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
    /// It has outlived the frame that it was drawn in.
    has_lasted: bool,
    /// Why it should have been drawn anew, and how many frames ago.
    owed: Option<(Redraw, u32)>,
}

/// Whose turn it is to be drawn in a frame: who has waited longest, of those the nearest.
#[derive(Debug, Default)]
pub(super) struct Turn {
    reserved: Option<usize>,
    is_taken: bool,
}

impl Turn {
    pub fn new<'a>(held: impl Iterator<Item = Option<&'a HeldMap>>) -> Self {
        let waited = held.enumerate().filter_map(|(index, held)| {
            let (_, frames) = held?.owed?;
            Some((index, frames))
        });
        let longest = waited.reduce(|a, b| if b.1 > a.1 { b } else { a });
        Self {
            reserved: longest.map(|(index, _)| index),
            is_taken: false,
        }
    }

    /// Whether a map that is due waits, for so many frames already.
    fn is_for_another(
        &self,
        inputs: &PlanInputs,
        index: usize,
        (redraw, waited): (Redraw, u32),
    ) -> bool {
        let config = inputs.config;
        // Suns that move have turns of their own, and those that jump, or worlds that are moved, cannot wait.
        let can_wait = redraw != Redraw::Light
            // Another side's map may have taken its place.
            && config.fit != CascadeFit::Faces;
        let is_anothers = self.is_taken || self.reserved.is_some_and(|it| it != index);
        can_wait && is_anothers && waited < config.delay
    }
}

impl HeldMap {
    /// Why it cannot stand in for the one that is wanted, if it cannot.
    fn why_redraw(
        &self,
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
        if self.light != *inputs.light {
            Some(Redraw::Light)
        } else if self.size != size || self.placed.fit != wanted.fit || !is_same_texel {
            Some(Redraw::Size)
        } else if self.has_stale_casters(inputs) {
            Some(Redraw::Casters)
        } else if !covers || !self.map.hull.contains(&volume.body, wanted.margin(inputs)) {
            Some(Redraw::Moved)
        } else {
            self.owed.map(|(redraw, _)| redraw)
        }
    }

    /// Whether casters have changed that it holds, or that matter to what is seen.
    fn has_stale_casters(&self, inputs: &PlanInputs) -> bool {
        match inputs.changes {
            CasterChanges::Anywhere | CasterChanges::AtOnce(None) => true,
            CasterChanges::At(changed) | CasterChanges::AtOnce(Some(changed)) => changed
                .iter()
                .any(|bounds| self.map.hull.intersects_box(bounds)),
        }
    }
}

fn spare(inputs: &PlanInputs, volume: &CascadeVolume, map_box: &MapBox) -> DVec3 {
    map_box.spare(&volume.body.corners, inputs.light, inputs.reach)
}

/// How far what is needed may move while a map is held (meters).
#[derive(Debug, Default, Clone)]
pub(super) struct Spare {
    /// In any direction.
    pub around: f64,
    /// Where its corners come if the view goes on as it did, in world space.
    pub ahead_ws: Vec<DVec3>,
}

/// How much farther than a map has texels to spare the middle of what is needed is taken to go: some of it moves less.
const AHEAD: f64 = 1.6;

/// No more often than this goes on what has moved a view: its middle may have stood still.
const MOST_TIMES: f64 = 16.0;

/// Steps in which a view's way is followed.
const STEPS: [f64; 2] = [0.5, 1.0];

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

/// What may move at all, as a share of its radius: what is much smaller than its map is not to draw the casters
/// of all of that.
const MOST_SPARE: f64 = 0.15;

fn radius(volume: &CascadeVolume) -> f64 {
    let center = volume.body.center();
    let corners = volume.body.corners.iter();
    corners.fold(0.0, |radius, corner| center.distance(*corner).max(radius))
}

/// A map that is drawn anew, ahead of what moves as far as it has texels to spare, and how far what is
/// needed may then move.
fn ahead(
    inputs: &PlanInputs,
    volume: &CascadeVolume,
    wanted: PlacedMap,
    redraw: Redraw,
    held: Option<HeldMap>,
) -> (PlacedMap, Spare) {
    let Some(map_box) = wanted.map_box else {
        return (wanted, Spare::default());
    };
    let most = MOST_SPARE * radius(volume);
    let spare_ls = spare(inputs, volume, &map_box).truncate();
    let spare_ls = spare_ls.clamp(DVec2::ZERO, DVec2::splat(most));
    let around = spare_ls.max_element();
    match (redraw, held) {
        // What its casters have drawn anew each frame need hold none for the frames to come.
        (Redraw::Casters, Some(held)) if !held.has_lasted => (wanted, Spare::default()),
        (Redraw::Moved, Some(held)) => {
            let moved_ws = volume.body.center() - held.center_ws;
            let across_ls = inputs.light.measured(moved_ws).truncate();
            let share_ls = across_ls / across_ls.abs().max_element().max(f64::MIN_POSITIVE);
            let map_box = map_box.moved(share_ls * spare_ls);
            let placed = PlacedMap::of_box(map_box, inputs.light, wanted.fit);
            // All that the map has to spare, on both sides, is ahead now.
            let times = 2.0 * AHEAD * around / moved_ws.length();
            let times = times.min(MOST_TIMES);
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
    let mut redraw = held.as_ref().map_or(Some(Redraw::New), |held| {
        held.why_redraw(inputs, volume, &wanted, size)
    });
    if let (Some(due), Some(held)) = (redraw, held.as_mut()) {
        let waited = held.owed.map_or(0, |(_, frames)| frames);
        let is_urgent =
            matches!(inputs.changes, CasterChanges::AtOnce(_)) && held.has_stale_casters(inputs);
        if held.size == size && !is_urgent && turn.is_for_another(inputs, index, (due, waited)) {
            held.owed = Some((due, waited + 1));
            redraw = None;
        }
    }
    if let Some(redraw) = redraw {
        turn.is_taken = true;
        let (placed, spare) = ahead(inputs, volume, wanted, redraw, held.take());
        *held = Some(HeldMap {
            map: placed.finish(inputs, volume, spare, redraw)?,
            placed,
            size,
            light: *inputs.light,
            view: *inputs.view,
            center_ws: volume.body.center(),
            has_lasted: false,
            owed: None,
        });
    }
    let held = held.as_mut()?;
    held.has_lasted = redraw.is_none();
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
        map.redraw = redraw.or(Some(Redraw::EveryFrame));
        // It need not last.
        map.hull = map.hull_now.clone();
    }
    Some(map)
}
