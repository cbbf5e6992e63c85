//! Small scenes that biases fail in.

use bevy::{
    asset::RenderAssetUsages,
    core_pipeline::prepass::{DeferredPrepass, DepthPrepass},
    mesh::PrimitiveTopology,
    pbr::DefaultOpaqueRendererMethod,
    prelude::*,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};
use bevy_pssm::prelude::*;

use crate::headless::Headless;

use super::{
    studio::{Studio, bevys_app, linear_camera, measurable_app},
    trace::Rays,
};

/// A scene under the usual sun.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Case {
    /// Cards at 0 to 89° to the light, near and far.
    Slopes,
    /// Balls on the ground.
    Balls,
    /// Rolling ground.
    Waves,
    /// Walls of 2 cm.
    Walls,
    /// Fences with an alpha mask.
    Fences,
    /// A box on the ground, from its shadow's side.
    Contact,
    /// A roof's rows of tiles, in steps of 5 cm, under a sun so high (degrees).
    Roofs(u8),
    /// Rolling ground under a sun of 3°.
    Ridges,
    /// Mountains under a sun of 15°, in kilometers.
    Kilometers,
    /// Smooth-shaded balls of few triangles under a low sun, from its side.
    Terminator,
    /// A slab over the ground along the view, for its shadow's edge at all depths.
    Slab,
}

impl Case {
    /// Those that biases fail in.
    pub const ALL: [Self; 11] = [
        Self::Slopes,
        Self::Balls,
        Self::Waves,
        Self::Walls,
        Self::Fences,
        Self::Contact,
        Self::Roofs(12),
        Self::Roofs(22),
        Self::Roofs(35),
        Self::Ridges,
        Self::Kilometers,
    ];

    /// Those that show where light runs out on smooth-shaded meshes.
    pub const SMOOTH: [Self; 2] = [Self::Terminator, Self::Ridges];

    /// Where shadows begin and end (the case's units).
    pub fn range(self) -> [f32; 2] {
        match self {
            Self::Kilometers => [0.05, 3.0],
            _ => [1.0, 150.0],
        }
    }

    /// How closely its truth is to be looked at.
    pub fn rays(self) -> Rays {
        match self {
            // Far rows are finer than pixels.
            Self::Roofs(_) => Rays {
                across: 4,
                everywhere: true,
            },
            _ => Rays::at_edges(1),
        }
    }

    fn eye(self) -> Transform {
        let (eye, target) = match self {
            Self::Slopes => (Vec3::new(0.0, 0.0, 0.0), Vec3::NEG_Z),
            Self::Waves | Self::Ridges => (Vec3::new(0.0, 6.0, 0.0), Vec3::new(0.0, 0.0, -25.0)),
            Self::Contact => (Vec3::new(-1.2, 1.4, 4.5), Vec3::new(-1.6, 0.2, 0.0)),
            Self::Slab => (Vec3::new(0.0, 12.0, 6.0), Vec3::new(0.0, 0.0, -40.0)),
            Self::Kilometers => (Vec3::new(0.0, 0.5, 0.0), Vec3::new(0.0, 0.0, -1.5)),
            Self::Terminator => (Vec3::new(0.0, 1.0, 4.0), Vec3::new(0.0, 0.7, -6.0)),
            // From where no shadow hides behind a row.
            Self::Roofs(_) => (Vec3::new(-8.0, 0.8, 4.0), Vec3::new(-6.0, 0.0, 2.0)),
            Self::Balls | Self::Walls | Self::Fences => {
                (Vec3::new(0.0, 3.0, 4.0), Vec3::new(0.0, 0.5, -6.0))
            }
        };
        Transform::from_translation(eye).looking_at(target, Vec3::Y)
    }

    /// Unit vector to its sun: but for low suns, from the right, a little behind the camera.
    fn to_sun(self) -> Vec3 {
        let low = |degrees: f32| {
            let elevation = degrees.to_radians();
            Vec3::new(elevation.cos(), elevation.sin(), 0.1)
        };
        let to_sun = match self {
            Self::Roofs(degrees) => low(f32::from(degrees)),
            Self::Terminator | Self::Kilometers => low(15.0),
            Self::Ridges => low(3.0),
            _ => Vec3::new(0.55, 0.65, 0.2),
        };
        to_sun.normalize()
    }

    /// Of its pictures (pixels).
    fn size(self) -> UVec2 {
        match self {
            Self::Slab => UVec2::new(512, 384),
            _ => UVec2::new(256, 192),
        }
    }
}

/// A case before a camera.
pub fn case_studio(case: Case) -> Studio {
    let size = case.size();
    let headless = measurable_app(size, |_| ());
    furnish(headless, case, size, ParallelSplitShadows::default())
}

/// A case without the plugin.
pub fn bevys_studio(case: Case) -> Studio {
    let size = case.size();
    furnish(bevys_app(size, |_| ()), case, size, ())
}

/// Has all be shaded after the fact, from what was seen.
pub fn defer(studio: &mut Studio) {
    let camera = studio.camera;
    let world = studio.world();
    world.insert_resource(DefaultOpaqueRendererMethod::deferred());
    world
        .entity_mut(camera)
        .insert((DepthPrepass, DeferredPrepass));
}

fn furnish(mut headless: Headless, case: Case, size: UVec2, shadows: impl Bundle) -> Studio {
    let target = headless.render_target();
    let world = headless.app.world_mut();
    world.insert_resource(GlobalAmbientLight::NONE);
    build(world, case);
    let sun = world
        .spawn((
            DirectionalLight {
                illuminance: 3000.0,
                shadow_maps_enabled: true,
                ..default()
            },
            shadows,
            Transform::default().looking_to(-case.to_sun(), Vec3::Y),
        ))
        .id();
    let camera = world
        .spawn((Camera3d::default(), target, case.eye(), linear_camera()))
        .id();
    Studio::new(headless, camera, sun, size)
}

fn build(world: &mut World, case: Case) {
    let mut scene = Scene::new(world);
    let to_sun = case.to_sun();
    let is_ground = matches!(
        case,
        Case::Waves | Case::Ridges | Case::Roofs(_) | Case::Kilometers
    );
    if case != Case::Slopes && !is_ground {
        let ground = Plane3d::default().mesh().size(300.0, 300.0).build();
        scene.add(ground, Transform::default());
    }
    match case {
        Case::Slopes => {
            let toward_eye = Vec3::Z.reject_from_normalized(to_sun).normalize();
            for (row, (side, distance)) in [(0.5, 6.0), (5.0, 70.0)].into_iter().enumerate() {
                for (column, degrees) in [0.0, 20.0, 45.0, 60.0, 75.0, 85.0, 89.0_f32]
                    .into_iter()
                    .enumerate()
                {
                    let angle = degrees.to_radians();
                    let normal = to_sun * angle.cos() + toward_eye * angle.sin();
                    let at = Vec3::new(
                        1.6 * side * (column as f32 - 3.0),
                        side * (2.0 - 4.0 * row as f32),
                        -distance,
                    );
                    let card = Plane3d::new(normal, Vec2::splat(0.5 * side)).mesh().build();
                    scene.add(card, Transform::from_translation(at));
                }
            }
        }
        Case::Balls => {
            let ball = Sphere::new(1.0).mesh().uv(64, 32);
            for i in 0..6 {
                let i = i as f32;
                let at = Vec3::new(1.5 - 2.6 * (i % 2.0), 1.0, -3.0 - 7.0 * i);
                scene.add(ball.clone(), Transform::from_translation(at));
            }
        }
        Case::Terminator => {
            for (i, [sectors, stacks]) in [[32, 18], [24, 12], [48, 24]].into_iter().enumerate() {
                let ball = Sphere::new(1.0).mesh().uv(sectors, stacks);
                let i = i as f32;
                let at = Vec3::new(2.6 * (i - 1.0), 0.9, -1.5 - 4.0 * i);
                scene.add(ball, Transform::from_translation(at));
            }
        }
        Case::Waves | Case::Ridges => scene.add(waves(), Transform::default()),
        Case::Kilometers => scene.add(mountains(), Transform::default()),
        Case::Roofs(_) => scene.add(tiles(), Transform::default()),
        Case::Walls => {
            let wall = Cuboid::new(2.0, 1.5, 0.02).mesh().build();
            for i in 0..7 {
                let i = i as f32;
                let at = Vec3::new(2.0 * (i % 3.0 - 1.0), 0.75, -2.0 - 5.0 * i);
                let turn = Quat::from_rotation_y(0.5 + 0.6 * i);
                scene.add(
                    wall.clone(),
                    Transform::from_translation(at).with_rotation(turn),
                );
            }
        }
        Case::Fences => {
            let fence = Rectangle::new(3.0, 1.2).mesh().build();
            let material = scene.fence();
            for i in 0..5 {
                let i = i as f32;
                let at = Vec3::new(1.5 - 3.0 * (i % 2.0), 0.6, -2.0 - 6.0 * i);
                let turn = Quat::from_rotation_y(0.4 + 0.5 * i);
                let place = Transform::from_translation(at).with_rotation(turn);
                scene.add_with(fence.clone(), place, material.clone());
            }
        }
        Case::Contact => {
            let block = Cuboid::new(1.5, 1.0, 1.5).mesh().build();
            scene.add(block, Transform::from_xyz(0.0, 0.5, 0.0));
        }
        Case::Slab => {
            let slab = Cuboid::new(6.0, 0.2, 400.0).mesh().build();
            scene.add(slab, Transform::from_xyz(6.0, 3.0, 0.0));
        }
    }
}

struct Scene<'w> {
    world: &'w mut World,
    paint: Handle<StandardMaterial>,
}

impl<'w> Scene<'w> {
    fn new(world: &'w mut World) -> Self {
        let paint = StandardMaterial {
            perceptual_roughness: 1.0,
            reflectance: 0.0,
            ..default()
        };
        let paint = world.resource_mut::<Assets<_>>().add(paint);
        Self { world, paint }
    }

    fn add(&mut self, mesh: Mesh, place: Transform) {
        self.add_with(mesh, place, self.paint.clone());
    }

    fn add_with(&mut self, mesh: Mesh, place: Transform, material: Handle<StandardMaterial>) {
        let mesh = self.world.resource_mut::<Assets<Mesh>>().add(mesh);
        self.world
            .spawn((Mesh3d(mesh), MeshMaterial3d(material), place));
    }

    /// Slats and gaps.
    fn fence(&mut self) -> Handle<StandardMaterial> {
        let texels = (0..64_u8).flat_map(|i| {
            let solid = i % 8 < 5 || i / 8 % 4 == 1;
            [255, 255, 255, 255 * u8::from(solid)]
        });
        let mask = Image::new(
            Extent3d {
                width: 8,
                height: 8,
                depth_or_array_layers: 1,
            },
            TextureDimension::D2,
            texels.collect(),
            TextureFormat::Rgba8UnormSrgb,
            RenderAssetUsages::default(),
        );
        let mask = self.world.resource_mut::<Assets<Image>>().add(mask);
        self.world
            .resource_mut::<Assets<StandardMaterial>>()
            .add(StandardMaterial {
                base_color_texture: Some(mask),
                alpha_mode: AlphaMode::Mask(0.5),
                cull_mode: None,
                double_sided: true,
                perceptual_roughness: 1.0,
                reflectance: 0.0,
                ..default()
            })
    }
}

/// Ground that rolls by a meter every 25.
fn waves() -> Mesh {
    terrain(160.0, |x, z| {
        (0.25 * x).sin() * 0.5 + (0.2 * z + 0.1 * x).sin() * 0.5
    })
}

/// Sharp ridges of up to 300 m over six kilometers.
fn mountains() -> Mesh {
    terrain(6.0, |x, z| {
        let ridge = |phase: f32| 1.0 - phase.sin().abs();
        0.2 * ridge(2.1 * x + 0.6 * z) + 0.1 * ridge(3.7 * z - 1.3 * x + 0.5)
    })
}

/// Smooth-shaded ground about the origin, of so many units a side.
fn terrain(side: f32, height: impl Fn(f32, f32) -> f32) -> Mesh {
    const CELLS: u32 = 160;
    let at = |i: u32| (i as f32 / CELLS as f32 - 0.5) * side;
    let step = 0.01 * side / CELLS as f32;
    let slope = |more: f32, less: f32| (more - less) / (2.0 * step);
    let mut positions = Vec::new();
    let mut normals = Vec::new();
    for (row, column) in (0..=CELLS).flat_map(|row| (0..=CELLS).map(move |column| (row, column))) {
        let (x, z) = (at(column), at(row));
        let dx = slope(height(x + step, z), height(x - step, z));
        let dz = slope(height(x, z + step), height(x, z - step));
        positions.push([x, height(x, z), z]);
        normals.push(Vec3::new(-dx, 1.0, -dz).normalize().to_array());
    }
    let stride = CELLS + 1;
    let indices = (0..CELLS)
        .flat_map(|row| (0..CELLS).map(move |column| row * stride + column))
        .flat_map(|a| [a, a + stride, a + 1, a + 1, a + stride, a + stride + 1])
        .collect();
    Mesh::new(
        PrimitiveTopology::TriangleList,
        RenderAssetUsages::default(),
    )
    .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions)
    .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, normals)
    .with_inserted_indices(bevy::mesh::Indices::U32(indices))
}

/// Rows of tiles along z, each higher on its left than the one before it on its right.
fn tiles() -> Mesh {
    const ROWS: usize = 80;
    const LENGTH: f32 = 0.3;
    const STEP: f32 = 0.05;
    let rows = (0..ROWS).flat_map(|row| {
        let left = (row as f32 - ROWS as f32 / 2.0) * LENGTH;
        // The riser, then the tile.
        let profile = [
            [left, 0.0],
            [left, STEP],
            [left, STEP],
            [left + LENGTH, 0.0],
        ];
        profile.map(|[x, y]| [[x, y, 6.0], [x, y, -60.0]])
    });
    let positions: Vec<[f32; 3]> = rows.flatten().collect();
    let indices = (0..2 * ROWS as u32)
        .flat_map(|quad| [0, 2, 1, 1, 2, 3].map(|corner| 4 * quad + corner))
        .collect();
    Mesh::new(
        PrimitiveTopology::TriangleList,
        RenderAssetUsages::default(),
    )
    .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions)
    .with_inserted_indices(bevy::mesh::Indices::U32(indices))
    .with_duplicated_vertices()
    .with_computed_flat_normals()
}
