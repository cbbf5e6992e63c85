//! Example scenes: described in RON, built procedurally, the same in every run.

#![allow(dead_code, unused_imports, reason = "shared by several binaries")]

mod board;
mod current;
mod format;
mod ground;
mod heights;
mod layout;
mod mesh;
mod models;
mod motion;
mod noise;
mod shapes;
mod sky;
mod spawn;
mod texture;

pub use current::{CurrentScene, SCENES, SceneCamera};
pub use format::{BuiltInDescription, SceneDescription, SceneLoader, SunDescription};
pub use ground::Ground;
pub use motion::{MovingSun, SceneSun};
pub use noise::Stream;
pub use sky::camera_of;
pub use spawn::{Imported, SceneEntity, SceneStats, spawn_scene};

use bevy::prelude::*;

/// Registers the scene asset and moves what moves.
pub struct ScenesPlugin;

impl Plugin for ScenesPlugin {
    fn build(&self, app: &mut App) {
        app.init_asset::<SceneDescription>()
            .init_asset_loader::<SceneLoader>()
            .init_resource::<MovingSun>()
            .init_resource::<CurrentScene>()
            .add_systems(
                Update,
                (current::set_up, motion::animate, motion::move_sun).chain(),
            )
            .add_systems(
                PostUpdate,
                motion::carry_sky.before(TransformSystems::Propagate),
            );
    }
}
