//! What every control is now.

use bevy::light::ShadowFilteringMethod;
use bevy_pssm::prelude::*;

use super::{
    super::{
        settings::{self, Value},
        sides::Side,
    },
    Control, Controls, Line, State,
};

const SIDES: &[&str] = &["left", "right"];
const TECHNIQUES: &[&str] = &["bevy_pssm", "Bevy's own", "Bevy's own, tuned"];
pub(super) const RESOLUTIONS: &[&str] = &["full", "half", "quarter"];
pub(super) const FILTERS: &[&str] = &["2 × 2", "Gaussian", "temporal"];
pub(super) const OVERLAYS: &[&str] = &[
    "none",
    "cascades, tinted",
    "light",
    "cascades",
    "bias",
    "texels per pixel",
    "texel grid",
    "age of maps",
];
const SCENE_NAMES: &[&str] = &[
    "Robot War",
    "Huge Chessboard",
    "Knights",
    "Mining Terrain",
    "a file",
];

impl Controls<'_, '_> {
    /// Every control, in the panel's order.
    pub fn lines(&self) -> Vec<Line> {
        let mut lines = Vec::new();
        let mut line = |control: Control, label: &str, state: State| {
            lines.push(Line {
                control,
                label: label.to_owned(),
                depth: 0,
                state,
                changed: false,
            });
        };
        let choice = |chosen: usize, names| State::Value(Value::Choice { chosen, names });
        let number = |value: f32, range: core::ops::RangeInclusive<f32>| {
            State::Value(Value::Number {
                value,
                range: Some(range),
                whole: false,
            })
        };
        line(Control::Heading("compare"), "compare", State::None);
        let compare = &*self.compare;
        line(
            Control::Edited,
            "side",
            choice(compare.edited.index(), SIDES),
        );
        let technique = compare.techniques[compare.edited.index()];
        line(
            Control::Technique,
            "shadows",
            choice(technique as usize, TECHNIQUES),
        );
        line(
            Control::Comparing,
            "compare",
            State::Flag(compare.wipe.is_some()),
        );
        if let Some(wipe) = compare.wipe {
            line(Control::Wipe, "wipe", number(wipe, 0.0..=1.0));
        }
        line(Control::Truth, "truth by rays", State::Flag(self.truth.on));
        line(
            Control::Overlay,
            "overlay",
            choice(overlay_index(*self.overlay), OVERLAYS),
        );
        line(Control::Counters, "figures", State::Flag(self.counters.on));
        line(Control::Maps, "maps", State::Flag(self.maps.on));
        line(
            Control::Frozen,
            "frozen cascades",
            State::Flag(self.frozen.on),
        );

        line(
            Control::Heading("scene and camera"),
            "scene and camera",
            State::None,
        );
        line(
            Control::Scene,
            "scene",
            choice(self.opened.scene_index(), SCENE_NAMES),
        );
        line(
            Control::Path,
            "camera on its path",
            State::Flag(self.flight.seconds.is_some()),
        );
        let coarseness = self.pictures.coarseness.max(1).ilog2() as usize;
        line(
            Control::Resolution,
            "resolution",
            choice(coarseness, RESOLUTIONS),
        );
        if let Ok((filter, lens)) = self.camera.single() {
            line(
                Control::Filter,
                "filter",
                choice(filter_index(*filter), FILTERS),
            );
            line(
                Control::ViewEnd,
                "view ends at, m",
                State::Value(Value::Number {
                    value: lens.far(),
                    range: None,
                    whole: false,
                }),
            );
        }
        line(Control::Heading("sun"), "sun", State::None);
        if let (Ok((sun, _)), None) = (self.sun.single(), self.day.hour) {
            let azimuth = (sun.description.azimuth + sun.wandered).rem_euclid(360.0);
            line(
                Control::Azimuth,
                "sun's azimuth, °",
                number(azimuth, 0.0..=360.0),
            );
            line(
                Control::Elevation,
                "elevation, °",
                number(sun.description.elevation, -10.0..=90.0),
            );
        }
        line(
            Control::Wandering,
            "sun wanders",
            State::Flag(self.moving.0),
        );
        line(
            Control::Day,
            "sun by the time",
            State::Flag(self.day.hour.is_some()),
        );
        if let Some(hour) = self.day.hour {
            line(Control::Hour, "hour", number(hour, 0.0..=24.0));
            line(
                Control::DayMinutes,
                "minutes a day",
                number(self.day.minutes, 0.5..=60.0),
            );
        }
        line(
            Control::Heading("settings of this side"),
            "settings of this side",
            State::None,
        );
        let (names, chosen) = (self.presets.names.clone(), self.presets.chosen);
        line(Control::Preset, "preset", State::Names(names, chosen));
        line(Control::CopyRon, "copy as RON", State::Button);
        line(Control::SavePreset, "save preset", State::Button);
        if let Some(shadows) = self.shadows(compare.edited) {
            lines.extend(settings::rows(shadows).into_iter().map(|row| Line {
                changed: !settings::is_default(shadows, &row.path),
                control: Control::Setting(row.path),
                label: row.label,
                depth: row.depth,
                state: State::Value(row.value),
            }));
        }
        lines
    }

    /// A side's settings, also while it shows Bevy's own shadows.
    pub fn shadows(&self, side: Side) -> Option<&ParallelSplitShadows> {
        let (_, shadows, kept) = self.suns.iter().find(|(sun, ..)| sun.0 == side)?;
        shadows.or(kept.map(|kept| &kept.0))
    }
}

pub(super) fn filter_index(filter: ShadowFilteringMethod) -> usize {
    match filter {
        ShadowFilteringMethod::Hardware2x2 => 0,
        ShadowFilteringMethod::Gaussian => 1,
        ShadowFilteringMethod::Temporal => 2,
    }
}

/// In the order of [`OVERLAYS`].
const OVERLAY_LIST: [ShadowOverlay; 8] = [
    ShadowOverlay::None,
    ShadowOverlay::CascadeTint,
    ShadowOverlay::Light,
    ShadowOverlay::Cascade,
    ShadowOverlay::Bias,
    ShadowOverlay::TexelsPerPixel,
    ShadowOverlay::TexelGrid,
    ShadowOverlay::Age,
];

pub(super) fn overlay_index(overlay: ShadowOverlay) -> usize {
    let index = OVERLAY_LIST.iter().position(|it| *it == overlay);
    index.unwrap_or(0)
}

pub(super) fn overlay(index: usize) -> ShadowOverlay {
    OVERLAY_LIST.get(index).copied().unwrap_or_default()
}
