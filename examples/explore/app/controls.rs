//! What can be set, what it is now, and how it is set: the panel without its widgets.

use bevy::{ecs::system::SystemParam, light::ShadowFilteringMethod, prelude::*};
use bevy_pssm::prelude::*;

use super::{
    counters::Counters,
    day::Day,
    flight::Flight,
    frozen::Frozen,
    maps::MapThumbnails,
    open::{Opened, Source},
    presets::Presets,
    settings::{self, Value},
    sides::{Compare, KeptShadows, Pictures, Side, SideSun, Technique},
    truth_view::TruthView,
};
use crate::scene::{MovingSun, SCENES, SceneCamera, SceneSun};

const SIDES: &[&str] = &["left", "right"];
const TECHNIQUES: &[&str] = &["bevy_pssm", "Bevy's own", "Bevy's own, tuned"];
const RESOLUTIONS: &[&str] = &["full", "half", "quarter"];
const FILTERS: &[&str] = &["2 × 2", "Gaussian", "temporal"];
const OVERLAYS: &[&str] = &[
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

/// What can be set.
#[derive(Component, Debug, Clone, PartialEq, Eq, Hash, Default)]
pub enum Control {
    /// Nothing: what follows belongs together.
    Heading(&'static str),
    /// Whose settings the panel shows.
    #[default]
    Edited,
    /// Whose shadows that side has.
    Technique,
    /// Whether both sides are shown.
    Comparing,
    /// Where the left side ends.
    Wipe,
    /// Whether rays are traced.
    Truth,
    /// Which scene.
    Scene,
    /// Whether the camera flies along the scene's path.
    Path,
    /// The cameras' filter.
    Filter,
    /// How coarse the picture is.
    Resolution,
    /// Where the camera's view ends (meters).
    ViewEnd,
    /// Where the sun stands (degrees).
    Azimuth,
    /// How high (degrees).
    Elevation,
    /// Whether it wanders.
    Wandering,
    /// Whether it goes by the time.
    Day,
    /// What time it is.
    Hour,
    /// How long a day lasts (minutes).
    DayMinutes,
    /// What is shown in place of the sun's light.
    Overlay,
    /// Whether figures are shown.
    Counters,
    /// Whether maps are shown.
    Maps,
    /// Whether the cascades of a camera that stays are shown.
    Frozen,
    /// Settings from a file.
    Preset,
    /// A field of the light's settings, by path.
    Setting(String),
    /// Puts the settings on the clipboard.
    CopyRon,
    /// Writes them to a file.
    SavePreset,
}

/// A control as it is now.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// What it sets.
    pub control: Control,
    /// Its name, for people.
    pub label: String,
    /// Within how many others.
    pub depth: usize,
    /// What it holds.
    pub state: State,
    /// Whether it can be set back.
    pub changed: bool,
}

/// What a control holds.
#[derive(Debug, Clone, PartialEq)]
pub enum State {
    /// Of a heading.
    None,
    /// A number or a choice.
    Value(Value),
    /// One of several that are known at run time only.
    Names(Vec<String>, usize),
    /// Yes or no.
    Flag(bool),
    /// Something to do.
    Button,
}

impl Line {
    /// Whether another line needs the same widget.
    pub fn is_like(&self, other: &Self) -> bool {
        let alike = match (&self.state, &other.state) {
            (
                State::Value(Value::Number { range: a, .. }),
                State::Value(Value::Number { range: b, .. }),
            ) => a == b,
            (State::Flag(_), State::Flag(_)) => true,
            (a, b) => a == b,
        };
        alike && self.control == other.control && self.label == other.label
    }
}

/// What a control is set to.
#[derive(Debug, Clone, PartialEq)]
pub enum To {
    /// A number.
    Number(f32),
    /// One of several.
    Choice(usize),
    /// Yes or no.
    Flag(bool),
    /// The next of several; the other of two; done.
    Next,
    /// What it is by default.
    Default,
}

/// Sets a control.
#[derive(Message, Debug, Clone, PartialEq)]
pub struct Edit {
    /// Which.
    pub control: Control,
    /// To what.
    pub to: To,
}

/// All that controls show and set.
#[derive(SystemParam)]
pub struct Controls<'w, 's> {
    compare: ResMut<'w, Compare>,
    truth: ResMut<'w, TruthView>,
    pictures: ResMut<'w, Pictures>,
    opened: ResMut<'w, Opened>,
    flight: ResMut<'w, Flight>,
    moving: ResMut<'w, MovingSun>,
    day: ResMut<'w, Day>,
    overlay: ResMut<'w, ShadowOverlay>,
    counters: ResMut<'w, Counters>,
    maps: ResMut<'w, MapThumbnails>,
    frozen: ResMut<'w, Frozen>,
    presets: ResMut<'w, Presets>,
    camera: Query<
        'w,
        's,
        (&'static mut ShadowFilteringMethod, &'static mut Projection),
        With<SceneCamera>,
    >,
    sun: Query<'w, 's, (&'static mut SceneSun, &'static mut Transform)>,
    suns: Query<
        'w,
        's,
        (
            &'static SideSun,
            Option<&'static mut ParallelSplitShadows>,
            Option<&'static mut KeptShadows>,
        ),
    >,
}

/// Shows and sets controls.
pub struct ControlsPlugin;

impl Plugin for ControlsPlugin {
    fn build(&self, app: &mut App) {
        app.add_message::<Edit>().add_systems(Update, apply_edits);
    }
}

fn apply_edits(mut edits: MessageReader<Edit>, mut controls: Controls) {
    for edit in edits.read() {
        controls.set(&edit.control, &edit.to);
    }
}

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
        if let Ok((sun, _)) = self.sun.single() {
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

    fn change_shadows(&mut self, change: impl FnOnce(&mut ParallelSplitShadows)) {
        let edited = self.compare.edited;
        let sun = self.suns.iter_mut().find(|(sun, ..)| sun.0 == edited);
        if let Some((_, shadows, kept)) = sun {
            match (shadows, kept) {
                (Some(mut shadows), _) => change(&mut shadows),
                (None, Some(mut kept)) => change(&mut kept.0),
                (None, None) => {}
            }
        }
    }

    /// Sets a control.
    pub fn set(&mut self, control: &Control, to: &To) {
        match control {
            Control::Edited => {
                self.compare.edited = match next(to, self.compare.edited.index(), 2) {
                    0 => Side::Left,
                    _ => Side::Right,
                };
            }
            Control::Technique => {
                let side = self.compare.edited.index();
                let technique = match next(to, self.compare.techniques[side] as usize, 3) {
                    0 => Technique::Plugin,
                    1 => Technique::BuiltIn,
                    _ => Technique::Tuned,
                };
                self.compare.techniques[side] = technique;
            }
            Control::Comparing => {
                let wipe = flag(to, self.compare.wipe.is_some()).then_some(0.5);
                self.compare.wipe = wipe;
                if wipe.is_none() {
                    self.compare.edited = Side::Left;
                }
            }
            Control::Wipe => {
                let now = self.compare.wipe.unwrap_or(0.5);
                self.compare.wipe = Some(value(to, now, 0.5).clamp(0.0, 1.0));
            }
            Control::Heading(_) => {}
            Control::Truth => self.truth.on = flag(to, self.truth.on),
            Control::Overlay => {
                *self.overlay = overlay(next(to, overlay_index(*self.overlay), OVERLAYS.len()));
            }
            Control::Counters => self.counters.on = flag(to, self.counters.on),
            Control::Maps => self.maps.on = flag(to, self.maps.on),
            Control::Frozen => self.frozen.on = flag(to, self.frozen.on),
            Control::Scene => {
                let chosen = next(to, self.opened.scene_index(), SCENES.len());
                if let Some(name) = SCENES.get(chosen) {
                    self.opened.open(Source::Shipped((*name).into()));
                }
            }
            Control::Path => {
                let flies = flag(to, self.flight.seconds.is_some());
                self.flight.seconds = flies.then_some(0.0);
            }
            Control::Resolution => {
                let now = self.pictures.coarseness.max(1).ilog2() as usize;
                self.pictures.coarseness = 1 << next(to, now, RESOLUTIONS.len()).min(2);
            }
            Control::Filter => {
                for (mut filter, _) in &mut self.camera {
                    *filter = match next(to, filter_index(*filter), FILTERS.len()) {
                        0 => ShadowFilteringMethod::Hardware2x2,
                        1 => ShadowFilteringMethod::Gaussian,
                        _ => ShadowFilteringMethod::Temporal,
                    };
                }
            }
            Control::ViewEnd => {
                for (_, mut lens) in &mut self.camera {
                    if let Projection::Perspective(lens) = &mut *lens {
                        lens.far = value(to, lens.far, 1000.0).max(1.01 * lens.near);
                    }
                }
            }
            Control::Azimuth | Control::Elevation => self.turn_sun(control, to),
            Control::Wandering => self.moving.0 = flag(to, self.moving.0),
            Control::Day => {
                if flag(to, self.day.hour.is_some()) != self.day.hour.is_some() {
                    self.day.toggle();
                }
            }
            Control::Hour => {
                let hour = self.day.hour.unwrap_or(12.0);
                self.day.hour = Some(value(to, hour, 12.0).rem_euclid(24.0));
            }
            Control::DayMinutes => self.day.minutes = value(to, self.day.minutes, 2.0).max(0.1),
            Control::Preset => {
                let chosen = next(to, self.presets.chosen, self.presets.names.len());
                self.presets.choose(chosen);
            }
            Control::CopyRon | Control::SavePreset => {
                let shadows = self.shadows(self.compare.edited).cloned();
                if let Some(shadows) = shadows {
                    self.presets.keep(&shadows, *control == Control::SavePreset);
                }
            }
            Control::Setting(path) => {
                let (path, to) = (path.clone(), to.clone());
                self.change_shadows(|shadows| match to {
                    To::Number(number) => settings::set_number(shadows, &path, number),
                    To::Choice(chosen) => settings::choose(shadows, &path, chosen),
                    To::Next => settings::choose_next(shadows, &path),
                    To::Default => settings::reset(shadows, &path),
                    To::Flag(_) => {}
                });
            }
        }
    }

    fn turn_sun(&mut self, control: &Control, to: &To) {
        for (mut sun, mut transform) in &mut self.sun {
            if *control == Control::Azimuth {
                let azimuth = sun.description.azimuth + sun.wandered;
                sun.wandered = 0.0;
                sun.description.azimuth = value(to, azimuth, 320.0).rem_euclid(360.0);
            } else {
                let elevation = value(to, sun.description.elevation, 40.0);
                sun.description.elevation = elevation.clamp(-90.0, 90.0);
            }
            *transform = sun.transform();
        }
    }
}

fn next(to: &To, now: usize, count: usize) -> usize {
    match to {
        To::Choice(chosen) => *chosen,
        To::Next => (now + 1) % count.max(1),
        _ => 0,
    }
}

fn flag(to: &To, now: bool) -> bool {
    match to {
        To::Flag(flag) => *flag,
        To::Next => !now,
        _ => false,
    }
}

fn value(to: &To, now: f32, default: f32) -> f32 {
    match to {
        To::Number(number) if number.is_finite() => *number,
        To::Default => default,
        _ => now,
    }
}

fn filter_index(filter: ShadowFilteringMethod) -> usize {
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

fn overlay_index(overlay: ShadowOverlay) -> usize {
    let index = OVERLAY_LIST.iter().position(|it| *it == overlay);
    index.unwrap_or(0)
}

fn overlay(index: usize) -> ShadowOverlay {
    OVERLAY_LIST.get(index).copied().unwrap_or_default()
}
