//! The gallery's scenes: described in RON, built procedurally, the same in every run.

#![allow(dead_code, reason = "shared by several binaries")]

mod format;
mod ground;
mod mesh;
mod models;
mod motion;
mod noise;
mod spawn;

pub use format::SceneDescription;
pub use ground::Ground;
pub use motion::{MovingSun, SceneSun};
pub use spawn::{SceneEntity, SceneStats, camera_of, spawn_scene};

use bevy::prelude::*;

/// Registers the scene asset and moves what moves.
pub struct ScenesPlugin;

impl Plugin for ScenesPlugin {
    fn build(&self, app: &mut App) {
        app.init_asset::<SceneDescription>()
            .init_asset_loader::<format::SceneLoader>()
            .init_resource::<MovingSun>()
            .add_systems(Update, (motion::animate, motion::move_sun, motion::carry_sky));
    }
}
