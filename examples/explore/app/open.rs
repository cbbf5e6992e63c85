//! What is on show: a scene's description, or a glTF file with a sun found or added.

use std::path::{Path, PathBuf};

use bevy::{
    asset::{AssetPath, LoadState, RecursiveDependencyLoadState},
    camera::primitives::Aabb,
    camera_controller::free_camera::{FreeCamera, FreeCameraState},
    ecs::query::QueryData,
    gltf::GltfAssetLabel,
    pbr::DistanceFog,
    prelude::*,
};
use bevy_pssm::prelude::*;

use super::flight::Flight;
use crate::scene::{
    BuiltInDescription, CurrentScene, Imported, SCENES, SceneCamera, SceneDescription, SceneEntity,
    SceneSun, SunDescription,
};

/// Of a file's directional lights: with the right side's, and one that the truth needs, the ten that
/// Bevy shades with.
const MOST_SUNS: usize = 8;
/// Flying through a scene of hundreds of meters (meters per second).
pub const PACES: (f32, f32) = (25.0, 120.0);
/// The sun of a file that has none.
const ADDED_SUN: SunDescription = SunDescription {
    azimuth: 320.0,
    elevation: 40.0,
    illuminance: 10_000.0,
    color: [1.0, 0.96, 0.9],
    degrees_per_second: 4.0,
};

/// What can be opened.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Source {
    /// One of the shipped scenes, by name.
    Shipped(String),
    /// A scene's description.
    Description(PathBuf),
    /// A glTF file.
    Gltf(PathBuf),
}

impl Source {
    /// By a shipped scene's name, or by a file's ending.
    ///
    /// # Errors
    /// If it is neither.
    pub fn parse(text: &str) -> Result<Self, String> {
        let ending = Path::new(text)
            .extension()
            .map(|ending| ending.to_string_lossy().to_lowercase());
        match ending.as_deref() {
            Some("glb" | "gltf") => Ok(Self::Gltf(text.into())),
            Some("ron") => Ok(Self::Description(text.into())),
            _ if SCENES.contains(&text) => Ok(Self::Shipped(text.into())),
            _ => Err(format!(
                "There is no scene {text}. There are: {}; or give a .scene.ron, .gltf or .glb file.",
                SCENES.join(", ")
            )),
        }
    }
}

/// What stands there.
#[derive(Resource, Debug, Clone, Default)]
pub struct Opened {
    /// For people.
    pub title: String,
    /// Bevy's own shadows as suit it best.
    pub built_in: BuiltInDescription,
    /// What went wrong, or is to be known.
    pub message: Option<String>,
    scene: usize,
    wanted: Option<Source>,
    /// A file that is loading, or whose entities have not been looked at.
    gltf: Option<(Handle<WorldAsset>, PathBuf)>,
    /// The scene that stands there while another one loads, and which it is.
    standing: Option<(Handle<SceneDescription>, usize)>,
    root: Option<Entity>,
}

impl Opened {
    /// Opens something else; what stands there stays until that has loaded.
    pub fn open(&mut self, source: Source) {
        self.wanted = Some(source);
    }

    /// Which of the shipped scenes stands there; as many as there are for a file.
    pub fn scene_index(&self) -> usize {
        self.scene
    }
}

/// Loads what is wanted.
pub struct OpenPlugin;

impl Plugin for OpenPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<Opened>()
            .add_systems(Update, (start, describe, spawn_gltf, look_at_gltf).chain());
    }
}

fn start(
    mut opened: ResMut<Opened>,
    mut current: ResMut<CurrentScene>,
    mut flight: ResMut<Flight>,
    assets: Res<AssetServer>,
) {
    let Some(source) = opened.bypass_change_detection().wanted.take() else {
        return;
    };
    opened.message = None;
    opened.gltf = None;
    if current.spawned {
        opened.standing = Some((current.handle.clone(), opened.scene));
    }
    if !matches!(source, Source::Gltf(_)) {
        *flight = Flight {
            seconds: None,
            pose: Some(0),
        };
    }
    let path = |file: &Path| {
        AssetPath::from_path_buf(std::path::absolute(file).unwrap_or_else(|_| file.into()))
    };
    let index = |name: &str| SCENES.iter().position(|scene| *scene == name);
    match source {
        Source::Shipped(name) => {
            opened.scene = index(&name).unwrap_or(SCENES.len());
            current.load(&name, &assets);
        }
        Source::Description(file) => {
            let scene = assets.load_builder().override_unapproved();
            opened.scene = SCENES.len();
            current.handle = scene.load(path(&file));
            current.spawned = false;
        }
        Source::Gltf(file) => {
            let label = GltfAssetLabel::Scene(0).from_asset(path(&file));
            let scene = assets.load_builder().override_unapproved().load(label);
            opened.gltf = Some((scene, file));
        }
    }
}

/// Title of a scene that has appeared, or why it has not.
fn describe(
    mut opened: ResMut<Opened>,
    mut current: ResMut<CurrentScene>,
    mut flight: ResMut<Flight>,
    scenes: Res<Assets<SceneDescription>>,
    assets: Res<AssetServer>,
    presets: Query<&ShadowPreset>,
    mut viewers: Query<&mut FreeCamera, With<SceneCamera>>,
) {
    for preset in &presets {
        if let (None, Some(LoadState::Failed(error))) =
            (&opened.message, assets.get_load_state(&preset.0))
        {
            opened.message = Some(format!("The preset cannot be used. {error}"));
        }
    }
    let state = assets.get_load_state(&current.handle);
    if let (false, Some(LoadState::Failed(error))) = (current.spawned, state) {
        opened.message = Some(format!("The scene cannot be shown. {error}"));
        // What stood there stays, and is what is shown.
        let nothing = (default(), SCENES.len());
        let (handle, scene) = opened.standing.take().unwrap_or(nothing);
        opened.scene = scene;
        flight.pose = None;
        *current = CurrentScene {
            handle,
            spawned: true,
        };
        return;
    }
    if let Some(scene) = scenes.get(&current.handle)
        && current.is_changed()
        && current.spawned
    {
        opened.title.clone_from(&scene.title);
        opened.built_in = scene.built_in;
        for mut legs in &mut viewers {
            (legs.walk_speed, legs.run_speed) = PACES;
        }
    }
}

/// A file that has loaded takes the place of what stood there.
fn spawn_gltf(
    mut commands: Commands,
    mut opened: ResMut<Opened>,
    mut current: ResMut<CurrentScene>,
    mut flight: ResMut<Flight>,
    assets: Res<AssetServer>,
    old: Query<Entity, With<SceneEntity>>,
) {
    let Some((scene, file)) = opened.gltf.clone() else {
        return;
    };
    match assets.get_load_state(&scene) {
        Some(LoadState::Failed(error)) => {
            opened.gltf = None;
            opened.message = Some(format!("{} cannot be shown. {error}", file.display()));
        }
        Some(LoadState::Loaded) => {
            opened.message = match assets.get_recursive_dependency_load_state(&scene) {
                Some(RecursiveDependencyLoadState::Loaded) => None,
                Some(RecursiveDependencyLoadState::Failed(error)) => Some(format!(
                    "Something that {} needs is missing. {error}",
                    file.display()
                )),
                _ => return,
            };
            opened.gltf = None;
            opened.scene = SCENES.len();
            *flight = Flight::default();
            for entity in &old {
                commands.entity(entity).despawn();
            }
            *current = CurrentScene {
                spawned: true,
                ..default()
            };
            opened.title = file
                .file_name()
                .map_or_else(String::new, |name| name.to_string_lossy().into_owned());
            opened.built_in = default();
            let root = commands.spawn((WorldAssetRoot(scene), Imported, SceneEntity));
            opened.root = Some(root.id());
        }
        _ => {}
    }
}

/// Who stands before a file.
#[derive(QueryData)]
#[query_data(mutable)]
struct Viewer {
    entity: Entity,
    place: &'static mut Transform,
    lens: &'static mut Projection,
    legs: &'static mut FreeCamera,
    hands: &'static mut FreeCameraState,
}

/// Finds or adds a file's sun and stands before it, once its entities are there.
fn look_at_gltf(
    mut commands: Commands,
    mut opened: ResMut<Opened>,
    children: Query<&Children>,
    boxes: Query<(&GlobalTransform, &Aabb), With<Mesh3d>>,
    meshes: Query<(), With<Mesh3d>>,
    lights: Query<(&DirectionalLight, &GlobalTransform)>,
    mut cameras: Query<&mut Camera, Without<SceneCamera>>,
    mut viewers: Query<Viewer, With<SceneCamera>>,
) {
    let Some(root) = opened.root else {
        return;
    };
    let of_file: Vec<Entity> = children.iter_descendants(root).collect();
    let waiting = of_file
        .iter()
        .any(|it| meshes.contains(*it) && !boxes.contains(*it));
    if of_file.is_empty() || waiting {
        return;
    }
    opened.root = None;
    let mut message: Vec<String> = opened.message.take().into_iter().collect();
    // The file's cameras would draw over everything.
    for camera in &of_file {
        if let Ok(mut camera) = cameras.get_mut(*camera) {
            camera.is_active = false;
        }
    }
    let bounds = of_file.iter().filter_map(|it| boxes.get(*it).ok());
    let bounds = bounds.fold(None, |bounds: Option<(Vec3, Vec3)>, (place, bounds_of)| {
        let center = place.transform_point(bounds_of.center.into());
        let half = Vec3::splat((place.affine().matrix3 * bounds_of.half_extents).length());
        let (least, most) = bounds.unwrap_or((center, center));
        Some((least.min(center - half), most.max(center + half)))
    });
    if bounds.is_none() {
        message.push("There are no meshes in this file.".to_owned());
    }
    let (least, most) = bounds.unwrap_or((Vec3::NEG_ONE, Vec3::ONE));
    let (center, radius) = (
        0.5 * (least + most),
        (0.5 * (most - least).length()).max(1e-3),
    );
    for mut viewer in &mut viewers {
        (viewer.legs.walk_speed, viewer.legs.run_speed) = (0.25 * radius, 1.25 * radius);
        let eye = center + radius * Vec3::new(0.8, 0.5, 1.1);
        *viewer.place = Transform::from_translation(eye).looking_at(center, Vec3::Y);
        let (yaw, pitch, _) = viewer.place.rotation.to_euler(EulerRot::YXZ);
        (viewer.hands.yaw, viewer.hands.pitch) = (yaw, pitch);
        // The haze was the last scene's.
        commands.entity(viewer.entity).remove::<DistanceFog>();
        *viewer.lens = Projection::Perspective(PerspectiveProjection {
            near: 0.002 * radius,
            far: 20.0 * radius,
            ..default()
        });
    }
    commands.insert_resource(GlobalAmbientLight::default());
    commands.insert_resource(ClearColor::default());
    let suns = of_file
        .iter()
        .filter_map(|it| Some((*it, lights.get(*it).ok()?)));
    let mut suns: Vec<_> = suns.collect();
    suns.sort_by(|(_, (a, _)), (_, (b, _))| b.illuminance.total_cmp(&a.illuminance));
    if suns.len() > MOST_SUNS {
        message.push(format!(
            "There are {} directional lights in this file, of which the brightest {MOST_SUNS} are \
             kept: Bevy shades with ten.",
            suns.len()
        ));
        for (surplus, _) in &suns[MOST_SUNS..] {
            commands.entity(*surplus).try_despawn();
        }
    }
    let shadows = ParallelSplitShadows {
        near: (0.01 * radius).min(1e5),
        far: (4.0 * radius).min(1e6),
        ..default()
    };
    if let Some((of_file, (light, place))) = suns.first() {
        let mut light = **light;
        light.shadow_maps_enabled = true;
        let sun = SceneSun {
            description: description_of(&light, place),
            wandered: 0.0,
        };
        // Apart from what its parents do to it: it is turned by hand from now on.
        commands.entity(*of_file).try_despawn();
        commands.spawn((sun.transform(), sun, light, SceneEntity, shadows));
    } else {
        message.push("There is no directional light in this file: a sun was added.".to_owned());
        let sun = SceneSun {
            description: ADDED_SUN,
            wandered: 0.0,
        };
        let light = DirectionalLight {
            illuminance: ADDED_SUN.illuminance,
            color: Color::srgb_from_array(ADDED_SUN.color),
            shadow_maps_enabled: true,
            ..default()
        };
        commands.spawn((sun.transform(), sun, light, SceneEntity, shadows));
    }
    opened.message = (!message.is_empty()).then(|| message.join("\n"));
}

fn description_of(light: &DirectionalLight, place: &GlobalTransform) -> SunDescription {
    let to_sun = place.affine().matrix3 * Vec3::Z;
    let to_sun = to_sun.try_normalize().unwrap_or(Vec3::Y);
    SunDescription {
        azimuth: to_sun.x.atan2(-to_sun.z).to_degrees(),
        elevation: to_sun.y.clamp(-1.0, 1.0).asin().to_degrees(),
        illuminance: light.illuminance,
        color: light.color.to_srgba().to_f32_array_no_alpha(),
        degrees_per_second: ADDED_SUN.degrees_per_second,
    }
}
