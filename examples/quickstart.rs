//! A sun with parallel-split shadows: the plugin, and one component. The camera flies by WASD and the mouse, for which Bevy
//! wants its feature `free_camera`.

use bevy::{
    camera_controller::free_camera::{FreeCamera, FreeCameraPlugin},
    prelude::*,
};
use bevy_pssm::prelude::*;

fn main() {
    App::new()
        .add_plugins((DefaultPlugins, FreeCameraPlugin, PssmPlugin))
        .add_systems(Startup, setup)
        .run();
}

fn setup(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    commands.spawn((
        DirectionalLight {
            illuminance: 9000.0,
            ..default()
        },
        Transform::from_xyz(-3.0, 3.0, 2.0).looking_at(Vec3::ZERO, Vec3::Y),
        ParallelSplitShadows {
            far: 800.0,
            ..default()
        },
    ));
    commands.spawn((
        Camera3d::default(),
        FreeCamera::default(),
        Transform::from_xyz(8.0, 3.0, 14.0).looking_at(Vec3::new(0.0, 2.0, -20.0), Vec3::Y),
    ));
    let ground = meshes.add(Plane3d::default().mesh().size(2000.0, 2000.0));
    let column = meshes.add(Cylinder::new(0.5, 6.0));
    let stone = materials.add(Color::srgb(0.7, 0.68, 0.6));
    commands.spawn((Mesh3d(ground), MeshMaterial3d(stone.clone())));
    for row in 0..100 {
        for side in [-4.0, 4.0] {
            commands.spawn((
                Mesh3d(column.clone()),
                MeshMaterial3d(stone.clone()),
                Transform::from_xyz(side, 3.0, -8.0 * row as f32),
            ));
        }
    }
}
