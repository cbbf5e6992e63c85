//! How the camera gets about: by hand, or along the scene's path.

use bevy::{
    camera_controller::free_camera::FreeCameraState,
    picking::{PickingSystems, hover::Hovered},
    prelude::*,
    ui_widgets::SliderDragState,
};

use super::panel::Panel;
use crate::scene::{CurrentScene, Ground, SceneCamera, SceneDescription};

/// The camera's way along the scene's path.
#[derive(Resource, Debug, Default)]
pub struct Flight {
    /// Seconds so far; `None` while the camera is flown by hand.
    pub seconds: Option<f32>,
    /// A pose of the scene to stand at.
    pub pose: Option<usize>,
}

/// Moves the camera.
pub struct FlightPlugin;

impl Plugin for FlightPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<Flight>()
            .add_systems(PreUpdate, leave_panel_alone.after(PickingSystems::Last))
            .add_systems(Update, fly);
    }
}

/// The panel has the wheel and the pointer where it is.
fn leave_panel_alone(
    panels: Query<&Hovered, With<Panel>>,
    drags: Query<&SliderDragState>,
    mut cameras: Query<&mut FreeCameraState>,
) {
    let hovered = panels.iter().any(Hovered::get);
    let enabled = !hovered && !drags.iter().any(|drag| drag.dragging);
    for mut camera in &mut cameras {
        if camera.enabled != enabled {
            camera.enabled = enabled;
        }
    }
}

fn fly(
    time: Res<Time>,
    mut flight: ResMut<Flight>,
    current: Res<CurrentScene>,
    scenes: Res<Assets<SceneDescription>>,
    ground: Option<Res<Ground>>,
    mut cameras: Query<(&mut Transform, &mut FreeCameraState), With<SceneCamera>>,
) {
    let (Some(scene), Some(ground), true) = (scenes.get(&current.handle), ground, current.spawned)
    else {
        return;
    };
    let height = |x: f32, z: f32| ground.height(x, z);
    let flight = flight.bypass_change_detection();
    let place = if let Some(pose) = flight.pose.take() {
        flight.seconds = None;
        scene
            .camera
            .pose(pose % scene.camera.poses.len().max(1), height)
    } else if let Some(seconds) = &mut flight.seconds {
        *seconds += time.delta_secs();
        scene.camera.sample(*seconds, height)
    } else {
        return;
    };
    for (mut camera, mut state) in &mut cameras {
        camera.set_if_neq(place);
        // Who takes over goes on from here.
        let (yaw, pitch, _) = place.rotation.to_euler(EulerRot::YXZ);
        (state.yaw, state.pitch) = (yaw, pitch);
    }
}
