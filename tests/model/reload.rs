//! Presets that change on disk while the app runs.

use core::time::Duration;
use std::{fs, path::PathBuf};

use bevy::{light::CascadeShadowConfig, prelude::*};
use bevy_pssm::{ShadowPlans, prelude::*};

use crate::{lights::app_with_assets, warnings};

/// Frames within which a change on disk must be noticed; each waits a little for the disk.
const MAX_STEPS: usize = 3000;

/// A folder of presets, removed in the end.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Self {
        let path = std::env::temp_dir().join(format!("bevy_pssm_reload_{}", std::process::id()));
        fs::create_dir_all(&path).expect("a folder can be made");
        Self(path)
    }

    fn write(&self, text: &str) {
        fs::write(self.0.join("sun.shadows.ron"), text).expect("a preset can be written");
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // Only a temporary folder is left behind if this fails.
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn step(app: &mut App) {
    app.update();
    std::thread::sleep(Duration::from_millis(10));
}

/// Lets the disk's late echoes of one change pass, lest they report the next.
fn rest(app: &mut App) {
    for _ in 0..100 {
        step(app);
    }
}

fn step_until(app: &mut App, what: &str, done: impl Fn(&App) -> bool) {
    for _ in 0..MAX_STEPS {
        step(app);
        if done(app) {
            return;
        }
    }
    panic!("{what} never happened; heard {:#?}", warnings::peek());
}

#[test]
fn presets_follow_their_file_and_survive_mistakes() {
    warnings::capture();
    let folder = Folder::new();
    folder.write("(cascades: 0)");
    let mut app = app_with_assets(AssetPlugin {
        file_path: folder.0.display().to_string(),
        watch_for_changes_override: Some(true),
        ..default()
    });
    let view = app.world_mut().spawn(Camera3d::default()).id();
    let preset = app
        .world()
        .resource::<AssetServer>()
        .load("sun.shadows.ron");
    let light = app
        .world_mut()
        .spawn((DirectionalLight::default(), ShadowPreset(preset)))
        .id();
    let complaints = || -> Vec<String> {
        warnings::peek()
            .into_iter()
            .filter(|line| line.contains("sun.shadows.ron"))
            .collect()
    };
    let cascades = |app: &App| {
        let plans = app.world().get::<ShadowPlans>(light)?;
        Some(plans.views.get(&view)?.len())
    };

    // Never good: Bevy's shadows stay.
    step_until(&mut app, "the first complaint", |_| complaints().len() == 1);
    assert!(complaints()[0].contains("`cascades` is 0, but must be from 1 to 4"));
    assert_eq!(cascades(&app), None);
    let bounds = &app
        .world()
        .get::<CascadeShadowConfig>(light)
        .unwrap()
        .bounds;
    assert_eq!(*bounds, CascadeShadowConfig::default().bounds);

    folder.write("(cascades: 2)");
    step_until(&mut app, "a good version", |app| cascades(app) == Some(2));
    rest(&mut app);

    for (mistakes, (text, line)) in [
        ("(cascades: 9)", ":1: `cascades` is 9"),
        ("(cascades: 3,\n blend: 0.7)", ":2: `blend` is 0.7"),
        ("(cascades: 3, far: ", ":1:"),
        ("(cascades: 3,\n farr: 9.0)", ":2:"),
    ]
    .into_iter()
    .enumerate()
    {
        folder.write(text);
        step_until(&mut app, "a complaint", |_| {
            complaints().len() == mistakes + 2
        });
        rest(&mut app);
        let heard = complaints();
        assert_eq!(heard.len(), mistakes + 2, "told more than once: {heard:#?}");
        assert!(heard[mistakes + 1].contains(line), "{heard:#?}");
        assert_eq!(cascades(&app), Some(2), "{text:?} was taken");
    }

    folder.write("(cascades: 3)");
    step_until(&mut app, "another good version", |app| {
        cascades(app) == Some(3)
    });

    // A change by hand stays until the file changes.
    let blend = |app: &App| {
        app.world()
            .get::<ParallelSplitShadows>(light)
            .map(|shadows| shadows.blend)
    };
    let mut shadows = app.world_mut().get_mut::<ParallelSplitShadows>(light);
    shadows.as_mut().expect("taken above").blend = 0.3;
    rest(&mut app);
    assert_eq!(blend(&app), Some(0.3));
    folder.write("(cascades: 1)");
    step_until(&mut app, "a last version", |app| cascades(app) == Some(1));
    assert_eq!(blend(&app), Some(ParallelSplitShadows::default().blend));

    app.world_mut().entity_mut(light).remove::<ShadowPreset>();
    step(&mut app);
    assert!(app.world().get::<ParallelSplitShadows>(light).is_none());
}
