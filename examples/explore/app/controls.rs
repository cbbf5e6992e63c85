//! What can be set, what it is now, and how it is set: the panel without its widgets.

mod lines;
mod set;

use bevy::{ecs::system::SystemParam, light::ShadowFilteringMethod, prelude::*};
use bevy_pssm::prelude::*;

use super::{
    counters::Counters,
    day::Day,
    flight::Flight,
    frozen::Frozen,
    maps::MapThumbnails,
    open::Opened,
    presets::Presets,
    settings::Value,
    sides::{Compare, KeptShadows, Pictures, SideSun},
    truth_view::TruthView,
};
use crate::scene::{MovingSun, SceneCamera, SceneSun};

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
                State::Value(Value::Number {
                    range: a, whole: b, ..
                }),
                State::Value(Value::Number {
                    range: c, whole: d, ..
                }),
            ) => a == c && b == d,
            (
                State::Value(Value::Choice { names: a, .. }),
                State::Value(Value::Choice { names: b, .. }),
            ) => a == b,
            (State::Names(a, _), State::Names(b, _)) => a == b,
            (State::Flag(_), State::Flag(_)) => true,
            (a, b) => a == b,
        };
        alike
            && self.depth == other.depth
            && self.control == other.control
            && self.label == other.label
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
        app.add_message::<Edit>();
    }
}

pub(super) fn apply_edits(mut edits: MessageReader<Edit>, mut controls: Controls) {
    for edit in edits.read() {
        controls.set(&edit.control, &edit.to);
    }
}
