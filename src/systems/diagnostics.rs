//! How many maps are drawn and how many are held, as Bevy diagnostics.

use bevy::{
    app::App,
    diagnostic::{Diagnostic, DiagnosticPath, Diagnostics, RegisterDiagnostic},
    ecs::system::Query,
};

use super::ShadowPlans;

/// Maps that were to be drawn in a frame, over all managed lights and cameras.
pub const MAPS_DRAWN: DiagnosticPath = DiagnosticPath::const_new("pssm/maps_drawn");

/// Maps that stayed as they were.
pub const MAPS_HELD: DiagnosticPath = DiagnosticPath::const_new("pssm/maps_held");

pub(super) fn register(app: &mut App) {
    for path in [MAPS_DRAWN, MAPS_HELD] {
        app.register_diagnostic(Diagnostic::new(path).with_smoothing_factor(0.0));
    }
}

pub(super) fn count_maps(mut diagnostics: Diagnostics, lights: Query<&ShadowPlans>) {
    let plans = lights
        .iter()
        .flat_map(|plans| plans.views.values().flatten());
    let (drawn, held): (Vec<_>, Vec<_>) = plans
        .filter_map(|plan| plan.map.as_ref())
        .partition(|map| map.redraw.is_some());
    diagnostics.add_measurement(&MAPS_DRAWN, || drawn.len() as f64);
    diagnostics.add_measurement(&MAPS_HELD, || held.len() as f64);
}
