//! An app without a window or a renderer.

use bevy::{
    log::LogPlugin,
    prelude::*,
    render::{
        RenderPlugin,
        settings::{RenderCreation, WgpuSettings},
    },
    winit::WinitPlugin,
};
use bevy_pssm::PssmPlugin;

/// All of Bevy but the renderer, as on a server, with the plugin. Not finished yet.
pub fn server_app(assets: AssetPlugin) -> App {
    let mut app = App::new();
    let no_gpu = WgpuSettings {
        backends: None,
        ..default()
    };
    app.add_plugins((
        DefaultPlugins
            .set(assets)
            .set(RenderPlugin {
                render_creation: RenderCreation::Automatic(Box::new(no_gpu)),
                ..default()
            })
            .set(WindowPlugin {
                primary_window: None,
                ..default()
            })
            .disable::<WinitPlugin>()
            .disable::<LogPlugin>(),
        PssmPlugin,
    ));
    app
}
