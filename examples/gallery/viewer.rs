//! A window to fly through the scenes in.

use bevy::{
    camera_controller::free_camera::{FreeCamera, FreeCameraPlugin},
    core_pipeline::tonemapping::Tonemapping,
    light::{DirectionalLightShadowMap, ShadowFilteringMethod},
    prelude::*,
    render::renderer::RenderAdapterInfo,
};
use bevy_pssm::prelude::*;
use wgpu::DeviceType;

use crate::day::{Day, pass_time};
use crate::scene::{
    CurrentScene, Ground, MovingSun, SCENES, SceneCamera, SceneDescription, SceneSun, ScenesPlugin,
};

/// How the viewer shows its scene.
#[derive(Resource)]
struct Show {
    scene: &'static str,
    ours: bool,
    /// Seconds along the camera's path; `None` while the camera is flown by hand.
    path: Option<f32>,
    filter: ShadowFilteringMethod,
}

#[derive(Component)]
struct Help;

/// Runs the viewer until its window is closed.
pub fn run(scene: &'static str) {
    App::new()
        .add_plugins(DefaultPlugins.set(WindowPlugin {
            primary_window: Some(Window {
                title: "bevy_pssm".into(),
                resolution: (1280, 720).into(),
                ..default()
            }),
            ..default()
        }))
        .add_plugins((FreeCameraPlugin, PssmPlugin, ScenesPlugin))
        .insert_resource(DirectionalLightShadowMap { size: 2048 })
        .insert_resource(Show {
            scene,
            ours: true,
            path: Some(0.0),
            filter: ShadowFilteringMethod::Gaussian,
        })
        .add_systems(Startup, open)
        .init_resource::<Day>()
        .add_systems(
            Update,
            (press_keys, turn_sun, pass_time, fly_path, write_help).chain(),
        )
        .run();
}

fn open(
    mut commands: Commands,
    show: Res<Show>,
    mut current: ResMut<CurrentScene>,
    assets: Res<AssetServer>,
    adapter: Res<RenderAdapterInfo>,
) {
    current.load(show.scene, &assets);
    commands.spawn((
        Camera3d::default(),
        SceneCamera,
        FreeCamera {
            walk_speed: 25.0,
            run_speed: 120.0,
            ..default()
        },
        Tonemapping::TonyMcMapface,
        // A software device is slow enough without.
        match adapter.device_type {
            DeviceType::Cpu => Msaa::Off,
            _ => Msaa::Sample4,
        },
    ));
    commands.spawn((
        Text::default(),
        TextFont::from_font_size(15.0),
        Node {
            position_type: PositionType::Absolute,
            left: px(10.0),
            top: px(10.0),
            padding: UiRect::all(px(8.0)),
            ..default()
        },
        BackgroundColor(Color::srgba(0.0, 0.0, 0.0, 0.55)),
        Help,
    ));
}

fn press_keys(
    mut commands: Commands,
    keys: Res<ButtonInput<KeyCode>>,
    assets: Res<AssetServer>,
    mut show: ResMut<Show>,
    mut current: ResMut<CurrentScene>,
    mut overlay: ResMut<ShadowOverlay>,
    (mut moving, mut day): (ResMut<MovingSun>, ResMut<Day>),
    mut suns: Query<(Entity, Option<&mut ParallelSplitShadows>), With<SceneSun>>,
    mut kept: Local<Option<ParallelSplitShadows>>,
    mut cameras: Query<&mut ShadowFilteringMethod>,
    mut exit: MessageWriter<AppExit>,
) {
    let digits = [
        KeyCode::Digit1,
        KeyCode::Digit2,
        KeyCode::Digit3,
        KeyCode::Digit4,
    ];
    for (key, scene) in digits.into_iter().zip(SCENES) {
        if keys.just_pressed(key) {
            show.scene = scene;
            show.path = Some(0.0);
            current.load(scene, &assets);
        }
    }
    if keys.just_pressed(KeyCode::KeyP) {
        show.ours = !show.ours;
    }
    if keys.just_pressed(KeyCode::KeyT) {
        *overlay = following(*overlay);
    }
    if keys.just_pressed(KeyCode::KeyO) {
        moving.0 = !moving.0;
    }
    if keys.just_pressed(KeyCode::KeyN) {
        day.toggle();
    }
    if keys.just_pressed(KeyCode::KeyC) {
        show.path = match show.path {
            None => Some(0.0),
            Some(_) => None,
        };
    }
    if keys.just_pressed(KeyCode::KeyG) {
        show.filter = match show.filter {
            ShadowFilteringMethod::Hardware2x2 => ShadowFilteringMethod::Gaussian,
            ShadowFilteringMethod::Gaussian => ShadowFilteringMethod::Temporal,
            ShadowFilteringMethod::Temporal => ShadowFilteringMethod::Hardware2x2,
        };
    }
    for mut filter in &mut cameras {
        filter.set_if_neq(show.filter);
    }
    let fit = keys.just_pressed(KeyCode::KeyI);
    let grid = keys.just_pressed(KeyCode::KeyK);
    for (sun, shadows) in &mut suns {
        let Some(mut shadows) = shadows else {
            if show.ours {
                commands.entity(sun).insert(kept.take().unwrap_or_default());
            }
            continue;
        };
        if !show.ours {
            *kept = Some(shadows.clone());
            commands.entity(sun).remove::<ParallelSplitShadows>();
        } else if grid {
            shadows.grid = match shadows.grid {
                TexelGrid::Light => TexelGrid::Ground,
                TexelGrid::Ground => TexelGrid::Light,
            };
        } else if fit {
            shadows.fit = match &shadows.fit {
                CascadeFit::Stable => CascadeFit::Steady,
                CascadeFit::Steady => CascadeFit::Tight,
                CascadeFit::Tight => CascadeFit::Warped(MapWarp::Minimax),
                _ => CascadeFit::Stable,
            };
        }
    }
    if keys.just_pressed(KeyCode::Escape) {
        exit.write(AppExit::Success);
    }
}

fn turn_sun(
    keys: Res<ButtonInput<KeyCode>>,
    time: Res<Time>,
    day: Res<Day>,
    mut suns: Query<(&mut SceneSun, &mut Transform)>,
) {
    let held = |key| f32::from(u8::from(keys.pressed(key)));
    let around = held(KeyCode::ArrowRight) - held(KeyCode::ArrowLeft);
    let up = held(KeyCode::ArrowUp) - held(KeyCode::ArrowDown);
    if day.hour.is_some() || around == 0.0 && up == 0.0 {
        return;
    }
    for (mut sun, mut transform) in &mut suns {
        sun.wandered += 30.0 * around * time.delta_secs();
        let elevation = sun.description.elevation + 20.0 * up * time.delta_secs();
        sun.description.elevation = elevation.clamp(3.0, 88.0);
        *transform = sun.transform();
    }
}

fn fly_path(
    time: Res<Time>,
    mut show: ResMut<Show>,
    current: Res<CurrentScene>,
    scenes: Res<Assets<SceneDescription>>,
    ground: Option<Res<Ground>>,
    mut cameras: Query<&mut Transform, With<SceneCamera>>,
) {
    let (Some(scene), Some(ground), Some(seconds)) =
        (scenes.get(&current.handle), ground, show.path.as_mut())
    else {
        return;
    };
    *seconds += time.delta_secs();
    let place = scene.camera.sample(*seconds, |x, z| ground.height(x, z));
    for mut camera in &mut cameras {
        *camera = place;
    }
}

fn following(overlay: ShadowOverlay) -> ShadowOverlay {
    match overlay {
        ShadowOverlay::None => ShadowOverlay::CascadeTint,
        ShadowOverlay::CascadeTint => ShadowOverlay::Light,
        ShadowOverlay::Light => ShadowOverlay::Bias,
        ShadowOverlay::Bias => ShadowOverlay::TexelsPerPixel,
        ShadowOverlay::TexelsPerPixel => ShadowOverlay::TexelGrid,
        ShadowOverlay::TexelGrid => ShadowOverlay::Age,
        ShadowOverlay::Age | ShadowOverlay::Cascade => ShadowOverlay::None,
    }
}

fn write_help(
    show: Res<Show>,
    overlay: Res<ShadowOverlay>,
    moving: Res<MovingSun>,
    day: Res<Day>,
    suns: Query<&ParallelSplitShadows, With<SceneSun>>,
    mut help: Query<&mut Text, With<Help>>,
) {
    let on = |value| if value { "on" } else { "off" };
    let shadows = if show.ours {
        "bevy_pssm"
    } else {
        "Bevy's built-in"
    };
    let shown = suns.iter().next().cloned().unwrap_or_default();
    let ParallelSplitShadows { fit, grid, .. } = shown;
    let day = day.slider();
    let text = format!(
        "1-4  scene: {}\n\
         P  shadows: {shadows}\n\
         T  overlay: {:?}\n\
         I  fit: {fit:?}   K  grid: {grid:?}\n\
         G  filter: {:?}\n\
         O  moving sun: {}   arrows  turn the sun\n\
         N  day of two minutes: {day}\n\
         C  camera on its path: {}\n\
         WASD, Q, E, right mouse button, Shift  fly\n\
         Esc  quit",
        show.scene,
        *overlay,
        show.filter,
        on(moving.0),
        on(show.path.is_some()),
    );
    for mut help in &mut help {
        if help.0 != text {
            help.0.clone_from(&text);
        }
    }
}
