//! From a description to entities.

use bevy::{asset::AssetPath, platform::collections::HashMap, prelude::*};

use super::{
    format::{GroundKind, Group, Import, Motion, SceneDescription},
    ground::Ground,
    layout::{Place, places},
    models::{self, Finish, Model, Part, Style, Turn},
    motion::{Rate, Walker},
    noise::Stream,
    sky::{spawn_sky, spawn_sun},
    texture,
};

/// On every entity of a scene that has no parent.
#[derive(Component)]
pub struct SceneEntity;

/// What a scene consists of.
#[derive(Resource, Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct SceneStats {
    /// Triangles of ground and objects; not of the sky.
    pub triangles: usize,
    /// Objects, ground apart.
    pub objects: usize,
}

/// Width of the ground's grain before it repeats (meters).
const GRAIN_TILE: f32 = 26.0;

/// Spawns ground, objects, sky and sun, and leaves [`Ground`], [`SceneStats`] and the ambient
/// light as resources.
pub fn spawn_scene(
    commands: &mut Commands,
    meshes: &mut Assets<Mesh>,
    materials: &mut Assets<StandardMaterial>,
    scene: &SceneDescription,
) -> SceneStats {
    let mut stats = SceneStats::default();
    let ground = Ground::new(scene.ground.clone(), scene.seed);
    spawn_ground(commands, meshes, materials, scene, &ground, &mut stats);
    let mut workshop = Workshop {
        meshes,
        finishes: finishes(materials),
        stats: &mut stats,
    };
    for (index, group) in scene.groups.iter().enumerate() {
        let seed = scene.seed.wrapping_mul(31).wrapping_add(index as u64);
        workshop.spawn_group(commands, group, &ground, seed);
    }
    for (index, import) in scene.imports.iter().enumerate() {
        let seed = scene.seed.wrapping_mul(37).wrapping_add(index as u64);
        spawn_import(commands, import, &ground, seed);
    }
    spawn_sky(commands, meshes, materials, scene);
    spawn_sun(commands, scene);
    commands.insert_resource(ground);
    commands.insert_resource(stats);
    stats
}

fn spawn_ground(
    commands: &mut Commands,
    meshes: &mut Assets<Mesh>,
    materials: &mut Assets<StandardMaterial>,
    scene: &SceneDescription,
    ground: &Ground,
    stats: &mut SceneStats,
) {
    let board = scene.ground.kind == GroundKind::Board;
    let earth = materials.add(StandardMaterial {
        perceptual_roughness: if board { 0.45 } else { 0.95 },
        reflectance: if board { 0.4 } else { 0.15 },
        ..default()
    });
    for tile in ground.tiles() {
        stats.triangles += tile.triangles();
        commands.spawn((
            Mesh3d(meshes.add(tile.build_ground(GRAIN_TILE))),
            MeshMaterial3d(earth.clone()),
            SceneEntity,
        ));
    }
    // Images are out of reach here, but not for a command.
    let (seed, contrast) = (scene.seed, if board { 0.25 } else { 0.6 });
    commands.queue(move |world: &mut World| {
        let Some(mut images) = world.get_resource_mut::<Assets<Image>>() else {
            return;
        };
        let grain = images.add(texture::grain(seed, contrast));
        if let Some(mut materials) = world.get_resource_mut::<Assets<StandardMaterial>>()
            && let Some(mut earth) = materials.get_mut(&earth)
        {
            earth.base_color_texture = Some(grain);
        }
    });
}

/// On what stands for a glTF file's scene.
#[derive(Component)]
pub struct Imported;

fn spawn_import(commands: &mut Commands, import: &Import, ground: &Ground, seed: u64) {
    let mut random = Stream::new(seed);
    let places = places(&import.layout, ground, &mut random).into_iter();
    let transforms: Vec<Transform> = places
        .map(|Place { at, facing }| {
            let scale = random.between(import.scale[0], import.scale[1]);
            Transform::from_xyz(at.x, ground.height(at.x, at.y), at.y)
                .with_rotation(Quat::from_rotation_y(-facing.to_radians()))
                .with_scale(Vec3::splat(scale))
        })
        .collect();
    let file = std::path::absolute(&import.file).unwrap_or_else(|_| import.file.clone().into());
    commands.queue(move |world: &mut World| {
        let assets = world.resource::<AssetServer>();
        let path = GltfAssetLabel::Scene(0).from_asset(AssetPath::from_path_buf(file));
        // From outside of the assets' folder.
        let scene = assets.load_builder().override_unapproved().load(path);
        for transform in transforms {
            let root = WorldAssetRoot(scene.clone());
            world.spawn((root, transform, Imported, SceneEntity));
        }
    });
}

fn finishes(materials: &mut Assets<StandardMaterial>) -> HashMap<Finish, Handle<StandardMaterial>> {
    let mut look = |perceptual_roughness: f32, metallic: f32, reflectance: f32| {
        materials.add(StandardMaterial {
            perceptual_roughness,
            metallic,
            reflectance,
            ..default()
        })
    };
    HashMap::from_iter([
        (Finish::Matte, look(0.95, 0.0, 0.2)),
        (Finish::Satin, look(0.55, 0.0, 0.4)),
        (Finish::Polished, look(0.28, 0.0, 0.5)),
        (Finish::Metal, look(0.38, 0.55, 0.5)),
    ])
}

/// A model's meshes, ready to be used by many.
struct Shape {
    body: Handle<Mesh>,
    finish: Finish,
    parts: Vec<(Handle<Mesh>, Finish, Transform, Turn)>,
    triangles: usize,
}

struct Workshop<'a> {
    meshes: &'a mut Assets<Mesh>,
    finishes: HashMap<Finish, Handle<StandardMaterial>>,
    stats: &'a mut SceneStats,
}

impl Workshop<'_> {
    fn shape(&mut self, group: &Group, seed: u64, variant: u32) -> Shape {
        let style = Style {
            segments: (group.detail * 12.0).round() as u32,
            colors: group.colors,
            seed: seed.wrapping_mul(97).wrapping_add(u64::from(variant)),
            variant,
        };
        let Model {
            body,
            finish,
            parts,
        } = models::build(group.model, style);
        let triangles = body.triangles() + parts.iter().map(|p| p.body.triangles()).sum::<usize>();
        let mut mesh = |body: super::mesh::Body| self.meshes.add(body.sheltered().build());
        Shape {
            body: mesh(body),
            finish,
            parts: parts
                .into_iter()
                .map(
                    |Part {
                         body,
                         finish,
                         joint,
                         turn,
                     }| (mesh(body), finish, joint, turn),
                )
                .collect(),
            triangles,
        }
    }

    fn material(&self, finish: Finish) -> MeshMaterial3d<StandardMaterial> {
        MeshMaterial3d(self.finishes.get(&finish).cloned().unwrap_or_default())
    }

    fn spawn_group(&mut self, commands: &mut Commands, group: &Group, ground: &Ground, seed: u64) {
        let mut random = Stream::new(seed);
        let shapes: Vec<Shape> = (0..group.variants.max(1))
            .map(|variant| self.shape(group, seed, variant))
            .collect();
        for (index, place) in places(&group.layout, ground, &mut random)
            .into_iter()
            .enumerate()
        {
            let pick = (random.next() * shapes.len() as f32) as usize;
            // In turn, but not in the same order everywhere.
            let Some(shape) = shapes.get((index + pick / 2) % shapes.len()) else {
                continue;
            };
            let height = random.between(group.height[0], group.height[1]);
            let start = random.next();
            self.spawn(commands, group, shape, ground, place, height, start);
        }
    }

    fn spawn(
        &mut self,
        commands: &mut Commands,
        group: &Group,
        shape: &Shape,
        ground: &Ground,
        place: Place,
        height: f32,
        start: f32,
    ) {
        self.stats.objects += 1;
        self.stats.triangles += shape.triangles;
        let Place { at, facing } = place;
        let transform = Transform::from_xyz(at.x, ground.height(at.x, at.y), at.y)
            .with_rotation(Quat::from_rotation_y(-facing.to_radians()))
            .with_scale(Vec3::splat(height));
        let mut object = commands.spawn((
            Mesh3d(shape.body.clone()),
            self.material(shape.finish),
            transform,
            group.motion,
            SceneEntity,
        ));
        let rate = match group.motion {
            Motion::Still => 0.0,
            Motion::Parts { rate } => rate * (0.8 + 0.4 * start),
            Motion::Walk { speed, .. } | Motion::March { speed, .. } => {
                let start = if matches!(group.motion, Motion::Walk { .. }) {
                    0.0
                } else {
                    start * 0.2
                };
                object.insert(Walker {
                    home: at,
                    facing: facing.to_radians(),
                    start,
                });
                // Steps are in proportion to the legs.
                2.6 * speed / height
            }
        };
        object.with_children(|parent| {
            for (mesh, finish, joint, turn) in &shape.parts {
                let (mesh, material) = (Mesh3d(mesh.clone()), self.material(*finish));
                if matches!(turn, Turn::Rest) {
                    parent.spawn((mesh, material, *joint));
                } else {
                    // Turns replace the joint's rotation, so that joints have none.
                    parent.spawn((mesh, material, *joint, *turn, Rate(rate)));
                }
            }
        });
    }
}
