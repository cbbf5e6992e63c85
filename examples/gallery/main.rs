//! The plugin on the four scenes of the PSSM paper, beside Bevy's built-in shadows.
//!
//! With a window: a viewer to fly through. With `--headless`: pictures and a table in
//! `target/demo/`.

#[path = "../common/headless.rs"]
mod headless;
#[path = "../common/measure.rs"]
mod measure;
#[path = "../scenes/mod.rs"]
mod scene;
#[path = "../common/scene_stage.rs"]
mod scene_stage;
#[path = "../common/warnings.rs"]
mod warnings;

mod day;
mod demo;
mod viewer;

use std::process::ExitCode;

use clap::Parser;

/// The plugin beside Bevy's built-in shadows.
#[derive(Parser)]
struct Arguments {
    /// Render pictures and a table into target/demo/ instead of opening the viewer.
    #[arg(long)]
    headless: bool,
    /// Show this scene only, or first in the viewer: `robot_war`, `huge_chessboard`, `knights`
    /// or `mining_terrain`.
    #[arg(long)]
    scene: Option<String>,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let scenes: Vec<&'static str> = match &arguments.scene {
        None => scene::SCENES.to_vec(),
        Some(name) => scene::SCENES
            .into_iter()
            .filter(|scene| scene == name)
            .collect(),
    };
    let Some(first) = scenes.first() else {
        #[expect(clippy::print_stderr, reason = "a message for who called")]
        {
            eprintln!(
                "There is no such scene. There are: {}",
                scene::SCENES.join(", ")
            );
        }
        return ExitCode::FAILURE;
    };
    if !arguments.headless {
        viewer::run(first);
        return ExitCode::SUCCESS;
    }
    match demo::run(&scenes) {
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
