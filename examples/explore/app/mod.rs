//! One window in which settings show what they buy: a scene to fly through, every setting, two of
//! them beside each other, and the truth by rays.

#![allow(dead_code, unused_imports, reason = "shared with the tests")]

mod controls;
mod counters;
mod day;
mod errand;
mod flight;
mod frozen;
mod keys;
mod maps;
mod open;
mod panel;
mod presets;
mod probe;
mod screen;
pub mod settings;
mod sides;
mod truth_view;

pub use controls::Control;
pub use flight::Flight;
pub use open::{Opened, Source};
pub use screen::{WipeBar, caption_of};
pub use sides::{Compare, KeptShadows, Pictures, Side, SideSun, Technique};
pub use truth_view::TruthView;

use bevy::{
    camera::RenderTarget,
    camera_controller::free_camera::{FreeCamera, FreeCameraPlugin},
    core_pipeline::tonemapping::Tonemapping,
    feathers::{FeathersPlugins, dark_theme::create_dark_theme, theme::UiTheme},
    light::{DirectionalLightShadowMap, ShadowFilteringMethod},
    prelude::*,
    render::renderer::RenderAdapterInfo,
};
use bevy_pssm::prelude::*;
use wgpu::DeviceType;

use crate::scene::{SceneCamera, ScenesPlugin};
use counters::{Counters, CountersPlugin};
use maps::{MapThumbnails, MapThumbnailsPlugin};

/// The whole program but for the window.
pub struct ExplorerPlugin {
    /// Where panel and picture are drawn, if they are.
    pub screen: Option<RenderTarget>,
    /// Size of the pictures, at first (pixels).
    pub size: UVec2,
    /// What is opened first.
    pub source: Option<Source>,
}

impl Plugin for ExplorerPlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins((
            (FreeCameraPlugin, FeathersPlugins, PssmPlugin, ScenesPlugin),
            (
                controls::ControlsPlugin,
                flight::FlightPlugin,
                frozen::FrozenPlugin,
                open::OpenPlugin,
                panel::PanelPlugin,
                presets::PresetsPlugin,
                screen::ScreenPlugin,
                sides::SidesPlugin,
                truth_view::TruthPlugin,
            ),
            (CountersPlugin, MapThumbnailsPlugin),
        ))
        .insert_resource(UiTheme(create_dark_theme()))
        .insert_resource(DirectionalLightShadowMap { size: 2048 })
        .init_resource::<day::Day>()
        .insert_resource(First {
            screen: self.screen.clone(),
            size: self.size,
            source: self.source.clone(),
        })
        .add_systems(Startup, open_first)
        .add_systems(
            Update,
            (keys::press_keys, controls::apply_edits, day::pass_time).chain(),
        );
    }
}

/// What to begin with.
#[derive(Resource, Clone)]
struct First {
    screen: Option<RenderTarget>,
    size: UVec2,
    source: Option<Source>,
}

fn open_first(
    mut commands: Commands,
    first: Res<First>,
    mut opened: ResMut<Opened>,
    mut images: ResMut<Assets<Image>>,
    truth: Res<TruthView>,
    counters: Res<Counters>,
    maps: Res<MapThumbnails>,
    adapter: Option<Res<RenderAdapterInfo>>,
) {
    if let Some(source) = &first.source {
        opened.open(source.clone());
    }
    let mut pictures = Pictures::new(&mut images, first.size);
    if let Some(adapter) = adapter
        && adapter.device_type == DeviceType::Cpu
        && first.screen.is_some()
    {
        // A software device is slow enough.
        pictures.coarseness = 2;
    }
    sides::spawn_cameras(
        &mut commands,
        &pictures,
        (
            SceneCamera,
            FreeCamera {
                walk_speed: open::PACES.0,
                run_speed: open::PACES.1,
                ..default()
            },
            Tonemapping::TonyMcMapface,
            Msaa::Off,
            ShadowFilteringMethod::Gaussian,
        ),
    );
    if let Some(target) = &first.screen {
        screen::spawn_screen(
            &mut commands,
            target.clone(),
            &pictures,
            &truth,
            &counters,
            &maps,
        );
    }
    commands.insert_resource(pictures);
}
