//! A small scene with thin and thick casters near and far, under one sun.

use core::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};

use bevy::{
    asset::RenderAssetUsages,
    camera::RenderTarget,
    core_pipeline::tonemapping::{DebandDither, Tonemapping},
    light::{
        CascadeShadowConfig, CascadeShadowConfigBuilder, DirectionalLightShadowMap, NotShadowCaster,
    },
    prelude::*,
    render::{
        RenderApp, RenderPlugin,
        render_resource::{Extent3d, TextureDimension, TextureFormat},
        settings::{RenderCreation, WgpuSettings},
    },
};
use bevy_pssm::prelude::*;
use image::RgbaImage;

use crate::headless::Headless;

/// Pictures are this large (pixels).
pub const SIZE: UVec2 = UVec2::new(320, 240);

/// One app at a time: apps share the machine's cores and the log.
static TURN: Mutex<()> = Mutex::new(());

/// Waits until no other app renders.
pub fn take_turn() -> MutexGuard<'static, ()> {
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The scene, and the app that renders it.
pub struct Stage {
    /// The app.
    pub headless: Headless,
    size: UVec2,
    _turn: MutexGuard<'static, ()>,
}

/// A sequence of pseudorandom numbers.
pub struct Dice(pub u64);

impl Dice {
    /// A number in [0, 1).
    pub fn roll(&mut self) -> f32 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1_u64 << 24) as f32
    }

    pub fn within(&mut self, range: Range<f32>) -> f32 {
        range.start + (range.end - range.start) * self.roll()
    }

    /// One of so many, counted from 0.
    pub fn pick(&mut self, count: usize) -> usize {
        (self.roll() * count as f32) as usize
    }

    pub fn any<T: Clone>(&mut self, values: &[T]) -> T {
        values[self.pick(values.len())].clone()
    }
}

/// What tests give the sun unless they are about something else.
pub fn shadows() -> ParallelSplitShadows {
    ParallelSplitShadows {
        far: 200.0,
        splits: SplitScheme::Practical { lambda: 0.95 },
        map_size: MapSize::Same(1024),
        ..default()
    }
}

/// Bevy's cascades over the same range.
pub fn stock_cascades() -> CascadeShadowConfig {
    CascadeShadowConfigBuilder {
        minimum_distance: 1.0,
        maximum_distance: 200.0,
        first_cascade_far_bound: 10.0,
        ..default()
    }
    .build()
}

impl Stage {
    /// Ground, casters and an eye; no light yet.
    pub fn new() -> Self {
        Self::with_app(WgpuSettings::default(), |_| {})
    }

    /// As [`Stage::new`], on a restricted GPU or with more plugins.
    pub fn with_app(gpu: WgpuSettings, setup: impl FnOnce(&mut App)) -> Self {
        let renderer = RenderPlugin {
            render_creation: RenderCreation::Automatic(Box::new(gpu)),
            synchronous_pipeline_compilation: true,
            ..default()
        };
        Self::with_renderer(renderer, setup)
    }

    /// As [`Stage::with_app`], with another renderer.
    pub fn with_renderer(renderer: RenderPlugin, setup: impl FnOnce(&mut App)) -> Self {
        Self::of_size(SIZE, renderer, setup)
    }

    /// As [`Stage::with_renderer`], with pictures of another size.
    pub fn of_size(size: UVec2, renderer: RenderPlugin, setup: impl FnOnce(&mut App)) -> Self {
        let turn = take_turn();
        let format = TextureFormat::Rgba8UnormSrgb;
        let headless = Headless::with_renderer(size, format, renderer, |app| {
            app.add_plugins(PssmPlugin)
                .insert_resource(DirectionalLightShadowMap { size: 1024 })
                .insert_resource(GlobalAmbientLight {
                    brightness: 200.0,
                    ..default()
                })
                .insert_resource(ClearColor(Color::srgb(0.5, 0.7, 0.9)))
                .add_systems(Startup, spawn_scene);
            setup(app);
        });
        let mut stage = Self {
            headless,
            size,
            _turn: turn,
        };
        stage.headless.step();
        stage
    }

    pub fn world(&mut self) -> &mut World {
        self.headless.app.world_mut()
    }

    pub fn render_world(&self) -> &World {
        self.headless.app.sub_app(RenderApp).world()
    }

    pub fn step(&mut self) {
        self.headless.step();
    }

    pub fn target(&self) -> RenderTarget {
        self.headless.render_target()
    }

    /// A camera in the usual place.
    pub fn camera(&mut self) -> Entity {
        let camera = camera(self.target());
        self.world().spawn(camera).id()
    }

    /// A sun with Bevy's shadows.
    pub fn sun(&mut self) -> Entity {
        self.world().spawn(sun()).id()
    }

    /// Takes everything but the ground away.
    pub fn clear_casters(&mut self) {
        self.despawn_all::<Caster>();
    }

    pub fn clear_ground(&mut self) {
        self.despawn_all::<Ground>();
    }

    /// Marks the ground as no caster.
    pub fn ground_that_casts_nothing(&mut self) {
        let mut ground = self.world().query_filtered::<Entity, With<Ground>>();
        let ground = ground.iter(self.headless.app.world()).next();
        let ground = ground.expect("a ground");
        self.world().entity_mut(ground).insert(NotShadowCaster);
    }

    fn despawn_all<C: Component>(&mut self) {
        let mut entities = self.world().query_filtered::<Entity, With<C>>();
        let entities: Vec<Entity> = entities.iter(self.world()).collect();
        for entity in entities {
            self.world().entity_mut(entity).despawn();
        }
    }

    /// Steps until `ready` says so.
    pub fn wait_for(&mut self, ready: impl Fn(&mut World) -> bool) {
        for _ in 0..2000 {
            self.step();
            if ready(self.world()) {
                return;
            }
        }
        panic!("it never became ready");
    }

    /// A texture whose alpha is a coarse checker.
    pub fn checkered_mask(&mut self) -> Handle<Image> {
        let texels: Vec<u8> = (0..64_u32)
            .flat_map(|i| {
                let solid = ((i % 8) / 2 + i / 16) % 2 == 0;
                [200, 180, 120, if solid { 255 } else { 0 }]
            })
            .collect();
        let mask = Image::new(
            Extent3d {
                width: 8,
                height: 8,
                depth_or_array_layers: 1,
            },
            TextureDimension::D2,
            texels,
            TextureFormat::Rgba8UnormSrgb,
            RenderAssetUsages::RENDER_WORLD,
        );
        self.world().resource_mut::<Assets<Image>>().add(mask)
    }

    /// The picture, once everything is loaded and compiled. Adds the usual camera if there is
    /// none.
    pub fn picture(&mut self) -> RgbaImage {
        let mut cameras = self.world().query_filtered::<Entity, With<Camera3d>>();
        if cameras.iter(self.headless.app.world()).next().is_none() {
            self.camera();
        }
        self.headless.settle();
        self.headless.picture()
    }

    /// The last frame's picture, whatever was still loading.
    pub fn last_picture(&self) -> RgbaImage {
        let picture = RgbaImage::from_raw(self.size.x, self.size.y, self.headless.read_back());
        picture.expect("a picture")
    }
}

/// A thing that stands on the ground.
#[derive(Component)]
struct Caster;

#[derive(Component)]
struct Ground;

/// The usual sun: low, from the left behind.
pub fn sun() -> impl Bundle {
    (
        DirectionalLight {
            illuminance: 2000.0,
            shadow_maps_enabled: true,
            ..default()
        },
        Transform::from_xyz(-4.0, 5.0, 3.0).looking_at(Vec3::ZERO, Vec3::Y),
        stock_cascades(),
    )
}

/// The usual camera: at a man's height, looking along the row of casters.
pub fn camera(target: RenderTarget) -> impl Bundle {
    (
        Camera3d::default(),
        target,
        eye(),
        Tonemapping::None,
        DebandDither::Disabled,
        Msaa::Off,
    )
}

pub fn eye() -> Transform {
    Transform::from_xyz(6.0, 4.0, 12.0).looking_at(Vec3::new(-2.0, 0.5, -10.0), Vec3::Y)
}

fn spawn_scene(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let paint = |color: Color| StandardMaterial {
        base_color: color,
        perceptual_roughness: 1.0,
        reflectance: 0.0,
        ..default()
    };
    let ground = materials.add(paint(Color::srgb(0.75, 0.75, 0.7)));
    let bright = materials.add(paint(Color::srgb(0.9, 0.5, 0.3)));
    let dark = materials.add(paint(Color::srgb(0.4, 0.6, 0.8)));
    commands.spawn((
        Mesh3d(meshes.add(Plane3d::default().mesh().size(600.0, 600.0))),
        MeshMaterial3d(ground),
        Ground,
    ));
    let ball = meshes.add(Sphere::new(1.0).mesh().uv(32, 18));
    let post = meshes.add(Cylinder::new(0.08, 4.0));
    let block = meshes.add(Cuboid::new(2.0, 3.0, 1.0));
    for row in 0..12 {
        let z = 4.0 - 9.0 * row as f32;
        commands.spawn((
            Mesh3d(ball.clone()),
            MeshMaterial3d(bright.clone()),
            Transform::from_xyz(-3.0, 1.5, z),
            Caster,
        ));
        commands.spawn((
            Mesh3d(post.clone()),
            MeshMaterial3d(dark.clone()),
            Transform::from_xyz(0.5, 2.0, z - 2.0),
            Caster,
        ));
        commands.spawn((
            Mesh3d(block.clone()),
            MeshMaterial3d(dark.clone()),
            Transform::from_xyz(5.0, 1.5, z - 5.0).with_rotation(Quat::from_rotation_y(0.4)),
            Caster,
        ));
    }
}
