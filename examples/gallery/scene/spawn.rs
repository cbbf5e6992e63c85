//! From a description to entities.

use bevy::{
    camera::visibility::NoFrustumCulling,
    light::{NotShadowCaster, NotShadowReceiver},
    pbr::{DistanceFog, FogFalloff},
    platform::collections::HashMap,
    prelude::*,
};

use super::{
    format::{Group, Layout, ModelKind, Motion, SceneDescription},
    ground::Ground,
    mesh::{Body, ball},
    models::{self, Model, Style, Turn},
    motion::{SceneSun, Walker},
    noise::Stream,
};

/// On every entity of a scene.
#[derive(Component)]
pub struct SceneEntity;

/// On the sky.
#[derive(Component)]
pub struct Sky;

/// What a scene consists of.
#[derive(Resource, Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct SceneStats {
    /// Triangles of ground and objects; not of the sky.
    pub triangles: usize,
    /// Objects, ground apart.
    pub objects: usize,
}

/// The same shape in several places is built once: this many shapes of each model.
const VARIANTS: u64 = 4;

/// Spawns ground, objects, sky and sun, and leaves [`Ground`] and [`SceneStats`] as resources.
pub fn spawn_scene(
    commands: &mut Commands,
    meshes: &mut Assets<Mesh>,
    materials: &mut Assets<StandardMaterial>,
    scene: &SceneDescription,
) -> SceneStats {
    let mut stats = SceneStats::default();
    let ground = Ground::new(scene.ground.clone(), scene.seed);
    let earth = materials.add(StandardMaterial { perceptual_roughness: 0.95, reflectance: 0.2, ..default() });
    for tile in ground.tiles() {
        stats.triangles += tile.triangles();
        commands.spawn((Mesh3d(meshes.add(tile.build())), MeshMaterial3d(earth.clone()), SceneEntity));
    }
    let painted = materials.add(StandardMaterial { perceptual_roughness: 0.6, ..default() });
    for (index, group) in scene.groups.iter().enumerate() {
        let seed = scene.seed.wrapping_mul(31).wrapping_add(index as u64);
        spawn_group(commands, meshes, &painted, group, &ground, seed, &mut stats);
    }
    spawn_sky(commands, meshes, materials, scene);
    let sun = SceneSun { description: scene.sun.clone(), wandered: 0.0 };
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
        color: Color::srgb_from_array(scene.sky[0]).mix(&Color::WHITE, 0.4),
        brightness: scene.ambient,
        ..default()
    });
    commands.insert_resource(ClearColor(Color::srgb_from_array(scene.sky[1])));
    commands.insert_resource(ground);
    commands.insert_resource(stats);
    stats
}

/// Lens and haze of the scene's camera.
pub fn camera_of(scene: &SceneDescription) -> impl Bundle + use<> {
    let glow = Color::srgb_from_array(scene.sun.color).with_alpha(0.25);
    (
        Camera3d::default(),
        Projection::Perspective(PerspectiveProjection {
            fov: scene.camera.fov_degrees.to_radians(),
            near: scene.camera.near,
            far: scene.camera.far,
            ..default()
        }),
        DistanceFog {
            color: Color::srgb_from_array(scene.sky[1]),
            directional_light_color: glow,
            directional_light_exponent: 40.0,
            falloff: FogFalloff::from_visibility_contrast(scene.visibility, 0.15),
        },
    )
}

fn spawn_group(
    commands: &mut Commands,
    meshes: &mut Assets<Mesh>,
    material: &Handle<StandardMaterial>,
    group: &Group,
    ground: &Ground,
    seed: u64,
    stats: &mut SceneStats,
) {
    struct Built {
        body: Handle<Mesh>,
        parts: Vec<(Handle<Mesh>, Transform, Turn)>,
        triangles: usize,
    }
    let mut built: HashMap<u64, Built> = HashMap::default();
    let mut random = Stream::new(seed);
    let stiff = |kind| matches!(kind, ModelKind::Robot | ModelKind::ClawBot);
    for [x, z, facing] in places(group, ground, &mut random) {
        let height = random.between(group.height[0], group.height[1]);
        let variant = (random.next() * VARIANTS as f32) as u64;
        let shape = built.entry(variant).or_insert_with(|| {
            let style = Style {
                segments: (group.detail * 12.0) as u32,
                colors: group.colors,
                seed: seed.wrapping_mul(VARIANTS).wrapping_add(variant),
            };
            let Model { body, parts } = models::build(group.model, style);
            let triangles = body.triangles() + parts.iter().map(|p| p.body.triangles()).sum::<usize>();
            let mut mesh = |body: Body| meshes.add(body.build());
            Built {
                body: mesh(body),
                parts: parts.into_iter().map(|p| (mesh(p.body), p.joint, p.turn)).collect(),
                triangles,
            }
        });
        stats.objects += 1;
        stats.triangles += shape.triangles;
        let transform = Transform::from_xyz(x, ground.height(x, z), z)
            .with_rotation(Quat::from_rotation_y(-facing.to_radians()))
            .with_scale(Vec3::splat(height));
        let mut object = commands.spawn((
            Mesh3d(shape.body.clone()),
            MeshMaterial3d(material.clone()),
            transform,
            group.motion,
            SceneEntity,
        ));
        if let Motion::Walk { radius, .. } = group.motion {
            let start = random.between(0.0, core::f32::consts::TAU);
            object.insert(Walker {
                centre: Vec2::new(x, z) - radius * Vec2::from_angle(start),
                start,
            });
        }
        let lively = !matches!(group.motion, Motion::Still) || stiff(group.model) || group.model == ModelKind::Windmill;
        object.with_children(|parent| {
            for (mesh, joint, turn) in &shape.parts {
                let mut part = parent.spawn((*joint, Visibility::default()));
                part.with_children(|parent| {
                    let mut moving = parent.spawn((
                        Mesh3d(mesh.clone()),
                        MeshMaterial3d(material.clone()),
                        Transform::default(),
                    ));
                    if lively {
                        moving.insert(*turn);
                    }
                });
            }
        });
    }
}

/// Where a group's objects stand: x, z and facing in degrees.
fn places(group: &Group, ground: &Ground, random: &mut Stream) -> Vec<[f32; 3]> {
    match &group.layout {
        Layout::Places(list) => list.clone(),
        Layout::Ranks { centre, count, spacing, facing } => {
            let turn = Quat::from_rotation_y(-facing.to_radians());
            let offset = |i: u32, of: u32, spacing: f32| (i as f32 - 0.5 * (of as f32 - 1.0)) * spacing;
            (0..count[0] * count[1])
                .map(|i| {
                    let side = offset(i % count[0], count[0], spacing[0]);
                    let back = offset(i / count[0], count[1], spacing[1]);
                    let local = Vec3::new(side + random.between(-0.12, 0.12) * spacing[0], 0.0, back + random.between(-0.12, 0.12) * spacing[1]);
                    let place = turn * local;
                    [centre[0] + place.x, centre[1] + place.z, facing + random.between(-14.0, 14.0)]
                })
                .collect()
        }
        Layout::Scatter { count, centre, radius, apart } => {
            let mut list: Vec<[f32; 3]> = Vec::new();
            let mut attempts = 0;
            while list.len() < *count as usize && attempts < 20_000 {
                attempts += 1;
                let angle = random.between(0.0, core::f32::consts::TAU);
                let r = (random.next() * (radius[1].powi(2) - radius[0].powi(2)) + radius[0].powi(2)).sqrt();
                let (x, z) = (centre[0] + r * angle.cos(), centre[1] + r * angle.sin());
                let steep = (ground.height(x + 3.0, z) - ground.height(x - 3.0, z)).abs()
                    + (ground.height(x, z + 3.0) - ground.height(x, z - 3.0)).abs();
                let free = list.iter().all(|o| (o[0] - x).hypot(o[1] - z) >= *apart);
                if free && steep < 3.5 {
                    list.push([x, z, random.between(0.0, 360.0)]);
                }
            }
            list
        }
    }
}

/// A dome around the camera, from the horizon's colour to the zenith's.
fn spawn_sky(
    commands: &mut Commands,
    meshes: &mut Assets<Mesh>,
    materials: &mut Assets<StandardMaterial>,
    scene: &SceneDescription,
) {
    let [zenith, horizon] = scene.sky;
    let dome = ball(32, [1.0; 3]).tinted(|p| {
        let t = p.y.max(0.0).powf(0.55);
        core::array::from_fn(|i| horizon[i] + (zenith[i] - horizon[i]) * t)
    });
    commands.spawn((
        Mesh3d(meshes.add(dome.build())),
        MeshMaterial3d(materials.add(StandardMaterial {
            unlit: true,
            fog_enabled: false,
            cull_mode: None,
            ..default()
        })),
        Transform::from_scale(Vec3::splat(scene.camera.far * 0.98)),
        Sky,
        SceneEntity,
        NotShadowCaster,
        NotShadowReceiver,
        NoFrustumCulling,
    ));
}
