//! How many maps are drawn and how many are held, as Bevy diagnostics.

use bevy::{
    app::App,
    diagnostic::{Diagnostic, DiagnosticPath, Diagnostics, RegisterDiagnostic},
    ecs::system::Query,
};

use super::ShadowPlans;
use crate::plan::Redraw;

/// Maps that were to be drawn in a frame, over all managed lights and cameras.
pub const MAPS_DRAWN: DiagnosticPath = DiagnosticPath::const_new("pssm/maps_drawn");

/// Those of them that hold what they held, and only had casters drawn over it ([`Redraw::Added`]).
pub const MAPS_ADDED_TO: DiagnosticPath = DiagnosticPath::const_new("pssm/maps_added_to");

/// Maps that stayed as they were.
pub const MAPS_HELD: DiagnosticPath = DiagnosticPath::const_new("pssm/maps_held");

pub(super) fn register(app: &mut App) {
    for path in [MAPS_DRAWN, MAPS_ADDED_TO, MAPS_HELD] {
        app.register_diagnostic(Diagnostic::new(path).with_smoothing_factor(0.0));
    }
}

pub(super) fn count_maps(mut diagnostics: Diagnostics, lights: Query<&ShadowPlans>) {
    let plans = lights
        .iter()
        .flat_map(|plans| plans.views.values().flatten());
    let maps = plans.filter_map(|plan| plan.map.as_ref());
    let [mut drawn, mut added_to, mut held] = [0.0; 3];
    for map in maps {
        match map.redraw {
            None => held += 1.0,
            Some(redraw) => {
                drawn += 1.0;
                added_to += f64::from(u8::from(redraw == Redraw::Added));
            }
        }
    }
    diagnostics.add_measurement(&MAPS_DRAWN, || drawn);
    diagnostics.add_measurement(&MAPS_ADDED_TO, || added_to);
    diagnostics.add_measurement(&MAPS_HELD, || held);
}
