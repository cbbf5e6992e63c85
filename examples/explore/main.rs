//! Shadows to look at: a window in which every setting shows what it buys, with the truth by rays
//! and Bevy's built-in shadows beside it; or, with `--headless`, a tour in pictures.

#[path = "app/mod.rs"]
mod explore;
#[path = "../common/headless.rs"]
mod headless;
#[path = "../scenes/mod.rs"]
mod scene;
mod tour;
#[path = "../truth/mod.rs"]
mod truth;
#[path = "../common/warnings.rs"]
mod warnings;

use std::{path::PathBuf, process::ExitCode};

use bevy::{asset::UnapprovedPathMode, prelude::*};
use clap::Parser;

use explore::{ExplorerPlugin, Source};

const WINDOW: UVec2 = UVec2::new(1280, 720);

/// The plugin's shadows beside Bevy's own and the truth.
#[derive(Parser)]
struct Arguments {
    /// What to open: `robot_war`, `huge_chessboard`, `knights` or `mining_terrain`, a
    /// `.scene.ron`, or a `.gltf` or `.glb` file.
    scene: Option<String>,
    /// Write the pictures and the table of a tour into target/demo/ instead of opening a window.
    #[arg(long)]
    headless: bool,
    /// The tour.
    #[arg(long, default_value = "assets/tours/demo.tour.ron")]
    tour: PathBuf,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let result = if arguments.headless {
        tour::run(&arguments.tour, arguments.scene.as_deref())
    } else {
        let scene = arguments.scene.as_deref().unwrap_or(scene::SCENES[0]);
        Source::parse(scene)
            .map_err(BevyError::from)
            .map(open_window)
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            #[expect(clippy::print_stderr, reason = "a message for who called")]
            {
                eprintln!("{error}");
            }
            ExitCode::FAILURE
        }
    }
}

fn open_window(source: Source) {
    let window = Window {
        title: "bevy_pssm".into(),
        resolution: WINDOW.into(),
        ..default()
    };
    App::new()
        .add_plugins(
            DefaultPlugins
                .set(WindowPlugin {
                    primary_window: Some(window),
                    ..default()
                })
                .set(AssetPlugin {
                    // For files outside of the assets' folder, where a load says so.
                    unapproved_path_mode: UnapprovedPathMode::Deny,
                    ..default()
                }),
        )
        .add_plugins(ExplorerPlugin {
            screen: Some(default()),
            size: WINDOW,
            source: Some(source),
        })
        .run();
}
