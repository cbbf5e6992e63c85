//! Sky, haze, sun and the light from everywhere.

use bevy::{
    camera::visibility::NoFrustumCulling,
    light::{NotShadowCaster, NotShadowReceiver},
    pbr::{DistanceFog, FogFalloff},
    prelude::*,
};

use super::{
    format::SceneDescription, mesh::Body, motion::SceneSun, noise::fractal, spawn::SceneEntity,
};

/// What a camera's default exposure makes of one lux, as the haze's shader sees it.
const EXPOSURE: f32 = 0.001;

/// On the sky.
#[derive(Component)]
pub struct Sky;

/// Lens and haze of the scene's camera. Its transform is
/// [`CameraPath::pose`](super::format::CameraPath::pose)'s or
/// [`CameraPath::sample`](super::format::CameraPath::sample)'s.
pub fn camera_of(scene: &SceneDescription) -> impl Bundle + use<> {
    let haze = &scene.haze;
    (
        Camera3d::default(),
        Projection::Perspective(PerspectiveProjection {
            fov: scene.camera.fov_degrees.to_radians(),
            near: scene.camera.near,
            far: scene.camera.far,
            ..default()
        }),
        DistanceFog {
            color: Color::srgb_from_array(haze.color),
            directional_light_color: Color::WHITE.with_alpha(haze.glow),
            directional_light_exponent: haze.glow_exponent,
            falloff: FogFalloff::ExponentialSquared {
                // exp(−(1.73)²) is 5 %.
                density: 1.73 / haze.visibility,
            },
        },
    )
}

/// Spawns the sun.
pub(super) fn spawn_sun(commands: &mut Commands, scene: &SceneDescription) {
    let sun = SceneSun {
        description: scene.sun.clone(),
        wandered: 0.0,
    };
    commands.spawn((
        DirectionalLight {
            illuminance: scene.sun.illuminance,
            color: Color::srgb_from_array(scene.sun.color),
            shadow_maps_enabled: true,
            ..default()
        },
        sun.transform(),
        sun,
        SceneEntity,
    ));
    commands.insert_resource(GlobalAmbientLight {
        color: Color::srgb_from_array(scene.ambient.color),
        brightness: scene.ambient.brightness,
        ..default()
    });
    commands.insert_resource(ClearColor(Color::srgb_from_array(scene.haze.color)));
}

/// Spawns a dome that follows the camera and turns with the sun: haze at the horizon, blue
/// overhead, clouds between, and the sun's glow.
pub(super) fn spawn_sky(
    commands: &mut Commands,
    meshes: &mut Assets<Mesh>,
    materials: &mut Assets<StandardMaterial>,
    scene: &SceneDescription,
) {
    let (columns, rows) = (256_u32, 96_u32);
    let mut dome = Body::default();
    for j in 0..=rows {
        // More rows near the horizon, where the picture is.
        let t = 2.0 * j as f32 / rows as f32 - 1.0;
        let elevation = core::f32::consts::FRAC_PI_2 * t * (0.35 + 0.65 * t.abs());
        let (up, reach) = elevation.sin_cos();
        for i in 0..=columns {
            let (x, z) = (core::f32::consts::TAU * i as f32 / columns as f32).sin_cos();
            let direction = Vec3::new(x * reach, up, z * reach);
            dome.push_vertex(direction, -direction, sky_color(scene, direction));
        }
    }
    let row = columns + 1;
    for j in 0..rows {
        for i in 0..columns {
            let a = j * row + i;
            dome.push_quad(a, a + row, a + row + 1, a + 1);
        }
    }
    commands.spawn((
        Mesh3d(meshes.add(dome.build())),
        MeshMaterial3d(materials.add(StandardMaterial {
            unlit: true,
            fog_enabled: false,
            cull_mode: None,
            ..default()
        })),
        Transform::from_scale(Vec3::splat(scene.camera.far * 0.99)),
        Sky,
        SceneEntity,
        NotShadowCaster,
        NotShadowReceiver,
        NoFrustumCulling,
    ));
}

fn sky_color(scene: &SceneDescription, direction: Vec3) -> [f32; 4] {
    let rgb = |color: [f32; 3]| Color::srgb_from_array(color).to_linear().to_vec3();
    let (haze, zenith) = (rgb(scene.haze.color), rgb(scene.sky.zenith));
    let up = direction.y.max(0.0);
    let mut color = haze.lerp(zenith, 1.0 - (1.0 - up).powf(4.5));
    if up > 0.015 && scene.sky.clouds > 0.0 {
        // A flat layer, seen from below.
        let layer = Vec2::new(direction.x, direction.z) / (up + 0.14);
        let veil = fractal(layer.x * 0.55 + 7.0, layer.y * 0.95, scene.seed + 77, 3);
        let cover = ((veil + 1.4 * scene.sky.clouds - 0.75) * 1.1).clamp(0.0, 1.0);
        let fade = ((up - 0.015) * 7.0).clamp(0.0, 1.0);
        let lit = haze.lerp(Vec3::ONE, 0.6) * 1.7;
        color = color.lerp(lit, 0.8 * cover * cover * (3.0 - 2.0 * cover) * fade);
    }
    let sun = SceneSun {
        description: scene.sun.clone(),
        wandered: 0.0,
    };
    let toward = direction.dot(*sun.transform().back()).max(0.0);
    let sunlight = rgb(scene.sun.color) * scene.sun.illuminance * EXPOSURE;
    color += sunlight * scene.haze.glow * toward.powf(scene.haze.glow_exponent);
    color += sunlight * 0.12 * toward.powf(220.0);
    color.extend(1.0).to_array()
}
