//! The keyboard.

use bevy::{input_focus::InputFocus, prelude::*};

use super::{
    controls::{Control, Edit, To},
    open::{Opened, Source},
};
use crate::scene::SCENES;

/// Keys that set what comes next.
const KEYS: [(KeyCode, &str, Control); 13] = [
    (KeyCode::KeyP, "P", Control::Technique),
    (KeyCode::KeyV, "V", Control::Comparing),
    (KeyCode::KeyX, "X", Control::Edited),
    (KeyCode::KeyR, "R", Control::Truth),
    (KeyCode::KeyT, "T", Control::Overlay),
    (KeyCode::KeyH, "H", Control::Counters),
    (KeyCode::KeyL, "L", Control::Maps),
    (KeyCode::KeyF, "F", Control::Frozen),
    (KeyCode::KeyC, "C", Control::Path),
    (KeyCode::KeyG, "G", Control::Filter),
    (KeyCode::KeyO, "O", Control::Wandering),
    (KeyCode::KeyN, "N", Control::Day),
    (KeyCode::KeyB, "B", Control::Preset),
];

/// The key of a control.
pub fn key_of(control: &Control) -> Option<&'static str> {
    if let Control::Setting(path) = control {
        return match path.as_str() {
            ".fit" => Some("I"),
            ".grid" => Some("K"),
            _ => None,
        };
    }
    let key = KEYS.iter().find(|(.., of)| of == control);
    key.map(|(_, name, _)| *name)
}

/// Sets controls by keys.
pub fn press_keys(
    keys: Res<ButtonInput<KeyCode>>,
    mut focus: ResMut<InputFocus>,
    widgets: Query<(), With<Node>>,
    mut opened: ResMut<Opened>,
    mut edits: MessageWriter<Edit>,
    mut exit: MessageWriter<AppExit>,
) {
    if keys.just_pressed(KeyCode::Escape) {
        if focus.get().is_some_and(|focus| widgets.contains(focus)) {
            focus.clear();
        } else {
            exit.write(AppExit::Success);
        }
    }
    let mut next = |control: Control| {
        edits.write(Edit {
            control,
            to: To::Next,
        });
    };
    for (key, _, control) in &KEYS {
        if keys.just_pressed(*key) {
            next(control.clone());
        }
    }
    for (key, path) in [(KeyCode::KeyI, ".fit"), (KeyCode::KeyK, ".grid")] {
        if keys.just_pressed(key) {
            next(Control::Setting(path.into()));
        }
    }
    let digits = [
        KeyCode::Digit1,
        KeyCode::Digit2,
        KeyCode::Digit3,
        KeyCode::Digit4,
    ];
    for (key, scene) in digits.into_iter().zip(SCENES) {
        if keys.just_pressed(key) {
            opened.open(Source::Shipped(scene.into()));
        }
    }
}
