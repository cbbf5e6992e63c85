//! How many maps are drawn and how many are held, as Bevy diagnostics.

use core::sync::atomic::{AtomicU32, Ordering};

use bevy::{
    app::App,
    diagnostic::{Diagnostic, DiagnosticPath, Diagnostics, RegisterDiagnostic},
    ecs::{
        resource::Resource,
        system::{Query, Res},
    },
    platform::sync::Arc,
};

use super::ShadowPlans;
use crate::plan::{CascadePlan, Redraw};

/// Maps that were to be drawn in a frame, over all managed lights and cameras.
pub const MAPS_DRAWN: DiagnosticPath = DiagnosticPath::const_new("pssm/maps_drawn");

/// Those of them that hold what they held, and only had casters drawn over it ([`Redraw::Added`]).
pub const MAPS_ADDED_TO: DiagnosticPath = DiagnosticPath::const_new("pssm/maps_added_to");

/// Maps that were to stay as they were.
pub const MAPS_HELD: DiagnosticPath = DiagnosticPath::const_new("pssm/maps_held");

/// Maps that the renderer drew although they were to stay, or only to be added to, in the frame before: a caster's mesh or
/// material has been edited, or has just loaded, or not all that belongs into them has been drawn twice yet.
pub const MAPS_DRAWN_UNPLANNED: DiagnosticPath =
    DiagnosticPath::const_new("pssm/maps_drawn_unplanned");

/// How many of some maps are drawn in a frame, as planned ([`CascadeMap::redraw`](crate::plan::CascadeMap::redraw) says
/// why each is).
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct MapCounts {
    /// Those that are drawn, or added to.
    pub drawn: usize,
    /// Of these, those that only have casters added to what they hold ([`Redraw::Added`]).
    pub added_to: usize,
    /// Those that stay as they are.
    pub held: usize,
}

impl MapCounts {
    fn add(mut self, plan: &CascadePlan) -> Self {
        let Some(map) = &plan.map else {
            return self;
        };
        self.held += usize::from(map.redraw.is_none());
        self.drawn += usize::from(map.redraw.is_some());
        self.added_to += usize::from(map.redraw == Some(Redraw::Added));
        self
    }
}

impl ShadowPlans {
    /// How many of the light's maps are drawn in this frame, over all cameras.
    pub fn counts(&self) -> MapCounts {
        let plans = self.views.values().flatten();
        plans.fold(MapCounts::default(), MapCounts::add)
    }
}

/// How many maps the renderer has drawn of late that were to stay as they were.
#[derive(Resource, Debug, Default, Clone)]
pub struct UnplannedMaps(Arc<AtomicU32>);

impl UnplannedMaps {
    pub fn note(&self, count: u32) {
        self.0.fetch_add(count, Ordering::Relaxed);
    }

    fn take(&self) -> u32 {
        self.0.swap(0, Ordering::Relaxed)
    }
}

pub(super) fn register(app: &mut App) {
    app.init_resource::<UnplannedMaps>();
    for path in [MAPS_DRAWN, MAPS_ADDED_TO, MAPS_HELD, MAPS_DRAWN_UNPLANNED] {
        app.register_diagnostic(Diagnostic::new(path).with_smoothing_factor(0.0));
    }
}

pub(super) fn count_maps(
    mut diagnostics: Diagnostics,
    lights: Query<&ShadowPlans>,
    unplanned: Res<UnplannedMaps>,
) {
    let plans = lights.iter().flat_map(|it| it.views.values().flatten());
    let counts = plans.fold(MapCounts::default(), MapCounts::add);
    for (path, count) in [
        (&MAPS_DRAWN, counts.drawn),
        (&MAPS_ADDED_TO, counts.added_to),
        (&MAPS_HELD, counts.held),
        (&MAPS_DRAWN_UNPLANNED, unplanned.take() as usize),
    ] {
        diagnostics.add_measurement(path, || count as f64);
    }
}
