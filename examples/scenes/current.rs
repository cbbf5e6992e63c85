//! The scene on show: its camera, and its sun with both kinds of shadows.

use bevy::{
    light::{CascadeShadowConfig, CascadeShadowConfigBuilder},
    prelude::*,
};
use bevy_pssm::prelude::*;

use super::{SceneDescription, SceneEntity, SceneSun, camera_of, spawn_scene};

/// Names of the shipped scenes.
pub const SCENES: [&str; 4] = ["robot_war", "huge_chessboard", "knights", "mining_terrain"];

/// The scene wanted, and whether it stands.
#[derive(Resource, Default)]
pub struct CurrentScene {
    /// The scene's asset.
    pub handle: Handle<SceneDescription>,
    /// Whether its entities are there.
    pub spawned: bool,
}

/// The scene's camera.
#[derive(Component)]
pub struct SceneCamera;

impl CurrentScene {
    /// Wants another scene, by name.
    pub fn load(&mut self, name: &str, assets: &AssetServer) {
        self.handle = assets.load(format!("scenes/{name}.scene.ron"));
        self.spawned = false;
    }
}

/// Sets the wanted scene up as soon as it has loaded.
pub(super) fn set_up(
    mut commands: Commands,
    mut current: ResMut<CurrentScene>,
    scenes: Res<Assets<SceneDescription>>,
    assets: Res<AssetServer>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
    old: Query<Entity, With<SceneEntity>>,
    camera: Query<Entity, With<SceneCamera>>,
) {
    let (Some(scene), false) = (scenes.get(&current.handle), current.spawned) else {
        return;
    };
    current.spawned = true;
    for entity in &old {
        commands.entity(entity).despawn();
    }
    spawn_scene(&mut commands, &mut meshes, &mut materials, scene);
    if let Ok(camera) = camera.single() {
        commands.entity(camera).insert(camera_of(scene));
    }
    let preset: Handle<ParallelSplitShadows> = assets.load(&scene.shadows);
    let stock = stock_cascades(scene.camera.far);
    commands.queue(move |world: &mut World| {
        let mut suns = world.query_filtered::<Entity, With<SceneSun>>();
        let suns: Vec<Entity> = suns.iter(world).collect();
        for sun in suns {
            world
                .entity_mut(sun)
                .insert((ShadowPreset(preset.clone()), stock.clone()));
        }
    });
}

/// Bevy's cascades over the same range as the presets', its defaults otherwise.
fn stock_cascades(far: f32) -> CascadeShadowConfig {
    CascadeShadowConfigBuilder {
        num_cascades: 4,
        minimum_distance: 1.0,
        maximum_distance: far,
        ..default()
    }
    .build()
}
