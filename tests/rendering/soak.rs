//! Lights, cameras, casters and settings that come, change and go at random: in the end all is as it was.

use core::f32::consts::{FRAC_PI_2, TAU};

use bevy::{
    camera::{Viewport, visibility::RenderLayers},
    light::{DirectionalLightShadowMap, NotShadowCaster},
    pbr::Shadow,
    prelude::*,
    render::{
        RenderPlugin, mesh::RenderMesh, render_asset::RenderAssets,
        render_phase::ViewBinnedRenderPhases, renderer::RenderDevice,
    },
};
use bevy_pssm::{ShadowPlans, prelude::*, render::ShadowTarget};
use image::RgbaImage;

use crate::{
    compare::assert_identical,
    stage::{Dice, Stage, camera, eye, shadows},
    warnings,
};

/// Pictures are this large (pixels): a software renderer draws each frame.
const SIZE: UVec2 = UVec2::new(160, 120);

/// The largest maps that are asked for (texels).
const MAX_MAP_SIZE: u32 = 512;

/// Frames after which nothing is left of what came and went: more than layers are kept for.
const REST: usize = 210;

/// What Bevy's buffers may keep of what they have grown by (bytes): less than the maps of all lights.
const MOST_GROWTH: u64 = 24 << 20;

#[derive(Debug, Clone, Copy)]
enum Kind {
    Suns,
    Spots,
    Cameras,
    Casters,
}

/// Entities of a kind, of which the first ones stay.
struct Crowd {
    kept: usize,
    most: usize,
    members: Vec<Entity>,
}

impl Crowd {
    fn new(kept: Vec<Entity>, most: usize) -> Self {
        Self {
            kept: kept.len(),
            most,
            members: kept,
        }
    }

    /// Lets go of one that came.
    fn take(&mut self, dice: &mut Dice) -> Option<Entity> {
        let came = self.members.len() - self.kept;
        let index = self.kept + dice.pick(came);
        (came > 0).then(|| self.members.swap_remove(index))
    }
}

/// How many there are of what comes and goes.
#[derive(Debug, PartialEq)]
struct Counts {
    entities: usize,
    render_entities: usize,
    meshes: usize,
    render_meshes: usize,
    materials: usize,
    presets: usize,
    shadow_phases: usize,
    layers: usize,
}

struct Soak {
    stage: Stage,
    dice: Dice,
    sun: Entity,
    camera: Entity,
    /// By kind.
    crowds: [Crowd; 4],
    /// Where the sun stood at the start.
    sun_at: Transform,
    /// Meshes as they were at the start.
    scene: Vec<(Entity, Transform, Mesh3d)>,
    last_order: isize,
}

impl Soak {
    fn new() -> Self {
        let renderer = RenderPlugin {
            synchronous_pipeline_compilation: true,
            ..default()
        };
        let mut stage = Stage::of_size(SIZE, renderer, |app| {
            // Compiled once, or most of the time would go by with compiling.
            let features = ShaderFeatures {
                overlays: false,
                ..ShaderFeatures::ALL
            };
            let size = MAX_MAP_SIZE as usize;
            app.insert_resource(features)
                .insert_resource(DirectionalLightShadowMap { size });
        });
        let (sun, camera) = (stage.sun(), stage.camera());
        let mut light = stage.world().entity_mut(sun);
        light.insert(original());
        let sun_at = *light.get::<Transform>().expect("a place");
        let mut meshes = stage.world().query::<(Entity, &Transform, &Mesh3d)>();
        let meshes = meshes.iter(stage.headless.app.world());
        let scene: Vec<_> = meshes
            .map(|(entity, at, mesh)| (entity, *at, mesh.clone()))
            .collect();
        let casters: Vec<Entity> = scene.iter().map(|(entity, ..)| *entity).collect();
        let most_casters = casters.len() + 8;
        Self {
            stage,
            dice: Dice(11),
            sun,
            camera,
            crowds: [
                Crowd::new(vec![sun], 3),
                Crowd::new(Vec::new(), 2),
                Crowd::new(vec![camera], 3),
                Crowd::new(casters, most_casters),
            ],
            sun_at,
            scene,
            last_order: 0,
        }
    }

    fn any(&mut self, kind: Kind) -> Entity {
        self.dice.any(&self.crowds[kind as usize].members)
    }

    fn act(&mut self) {
        match self.dice.pick(12) {
            0 => self.come_or_go(Kind::Suns),
            1 => self.come_or_go(Kind::Spots),
            2 => self.come_or_go(Kind::Cameras),
            3 => self.come_or_go(Kind::Casters),
            4..=6 => self.change_sun(),
            7..=8 => self.change_camera(),
            _ => self.change_caster(),
        }
    }

    fn come_or_go(&mut self, kind: Kind) {
        let crowd = &mut self.crowds[kind as usize];
        if self.dice.roll() < 0.5 {
            if let Some(gone) = crowd.take(&mut self.dice) {
                self.stage.world().despawn(gone);
            }
        } else if crowd.members.len() < crowd.most {
            let came = match kind {
                Kind::Suns => self.spawn_sun(),
                Kind::Spots => self.spawn_spot(),
                Kind::Cameras => self.spawn_camera(),
                Kind::Casters => self.spawn_caster(),
            };
            self.crowds[kind as usize].members.push(came);
        }
    }

    /// With Bevy's shadows or the plugin's.
    fn spawn_sun(&mut self) -> Entity {
        let sun = self.stage.sun();
        let mut light = self.stage.world().entity_mut(sun);
        light.insert(any_turn(&mut self.dice));
        if self.dice.roll() < 0.5 {
            light.insert(any_config(&mut self.dice));
        }
        sun
    }

    fn spawn_spot(&mut self) -> Entity {
        let dice = &mut self.dice;
        let at = Vec3::new(dice.within(-9.0..9.0), 9.0, dice.within(-30.0..4.0));
        let spot = SpotLight {
            intensity: 4_000_000.0,
            range: 60.0,
            outer_angle: dice.within(0.2..1.2),
            shadow_maps_enabled: dice.roll() < 0.8,
            ..default()
        };
        let down = Vec3::new(0.3, -1.0, -0.7);
        let at = Transform::from_translation(at).looking_to(down, Vec3::Y);
        self.stage.world().spawn((spot, at)).id()
    }

    /// With a viewport of its own, over the others'.
    fn spawn_camera(&mut self) -> Entity {
        self.last_order += 1;
        let view = Camera {
            order: self.last_order,
            viewport: Some(any_viewport(&mut self.dice)),
            clear_color: ClearColorConfig::None,
            ..default()
        };
        let camera = camera(self.stage.target());
        let mut camera = self.stage.world().spawn(camera);
        camera.insert((view, any_place(&mut self.dice)));
        camera.id()
    }

    fn spawn_caster(&mut self) -> Entity {
        let (like, _, mesh) = self.dice.any(&self.scene);
        let at = any_spot(&mut self.dice);
        let world = self.stage.world();
        let material = world.get::<MeshMaterial3d<StandardMaterial>>(like);
        let material = material.expect("a material").clone();
        world.spawn((mesh, material, at)).id()
    }

    fn change_sun(&mut self) {
        let light = self.any(Kind::Suns);
        let dice = &mut self.dice;
        let mut light = self.stage.world().entity_mut(light);
        match dice.pick(13) {
            0..=1 => {
                light.insert(any_turn(dice));
            }
            2 => {
                light.insert(any_broken(dice));
            }
            3..=5 => {
                light.insert(any_config(dice));
            }
            6 => {
                light.insert(bad_config(dice));
            }
            7 => {
                light.remove::<ParallelSplitShadows>();
            }
            // Both within one frame.
            8 => {
                if let Some(config) = light.take::<ParallelSplitShadows>() {
                    light.insert(config);
                }
            }
            9 => {
                let mut light = light.get_mut::<DirectionalLight>().expect("a light");
                light.shadow_maps_enabled = !light.shadow_maps_enabled;
            }
            10 => hide_or_show(&mut light),
            11 => toggle(&mut light, RenderLayers::layer(dice.pick(2))),
            _ if light.contains::<ShadowPreset>() => {
                light.remove::<ShadowPreset>();
            }
            _ => {
                let mut presets = light.resource_mut::<Assets<ParallelSplitShadows>>();
                let preset = presets.add(any_config(dice));
                light.insert(ShadowPreset(preset));
            }
        }
    }

    fn change_camera(&mut self) {
        let entity = self.any(Kind::Cameras);
        let dice = &mut self.dice;
        let mut camera = self.stage.world().entity_mut(entity);
        match dice.pick(9) {
            0..=1 => {
                camera.insert(any_place(dice));
            }
            2 => {
                camera.insert(any_place(dice));
                camera.world_scope(|world| world.trigger(CameraCut { entity }));
            }
            3 => {
                camera.insert(any_broken(dice));
            }
            4 => {
                camera.insert(Projection::Perspective(PerspectiveProjection {
                    fov: dice.any(&[0.002, 0.05, 0.8, 2.0, 3.1]),
                    ..default()
                }));
            }
            5 => {
                let projection = OrthographicProjection::default_3d();
                camera.insert(Projection::Orthographic(OrthographicProjection {
                    scale: dice.within(0.01..1.0),
                    ..projection
                }));
            }
            6 => {
                let mut camera = camera.get_mut::<Camera>().expect("a camera");
                camera.is_active = !camera.is_active;
            }
            7 => {
                let viewport = any_viewport(dice);
                camera.get_mut::<Camera>().expect("a camera").viewport = Some(viewport);
            }
            _ => toggle(&mut camera, RenderLayers::layer(dice.pick(2))),
        }
    }

    fn change_caster(&mut self) {
        let caster = self.any(Kind::Casters);
        let (.., other) = self.dice.any(&self.scene);
        let dice = &mut self.dice;
        let mut caster = self.stage.world().entity_mut(caster);
        match dice.pick(7) {
            0..=1 => {
                caster.insert(any_spot(dice));
            }
            2 => hide_or_show(&mut caster),
            3 => {
                caster.insert(other);
            }
            4 => {
                let mut meshes = caster.resource_mut::<Assets<Mesh>>();
                let mesh = meshes.add(Cuboid::new(1.0, dice.within(1.0..6.0), 1.0));
                caster.insert(Mesh3d(mesh));
            }
            5 => toggle(&mut caster, NotShadowCaster),
            _ => toggle(&mut caster, RenderLayers::layer(dice.pick(2))),
        }
    }

    /// Asserts that all maps of the last frame can be drawn.
    fn check(&mut self) {
        let mut plans = self.stage.world().query::<&ShadowPlans>();
        let plans = plans.iter(self.stage.headless.app.world());
        let plans = plans.flat_map(|plans| plans.views.values().flatten());
        for map in plans.filter_map(|plan| plan.map.as_ref()) {
            assert!(map.clip_from_world.as_mat4().is_finite(), "{map:?}");
        }
    }

    /// Takes away what came, and puts back what was.
    fn restore(&mut self) {
        for crowd in &mut self.crowds {
            for came in crowd.members.drain(crowd.kept..) {
                self.stage.world().despawn(came);
            }
        }
        let mut sun = self.stage.world().entity_mut(self.sun);
        sun.remove::<(ShadowPreset, RenderLayers)>();
        sun.insert((original(), self.sun_at, Visibility::Inherited));
        self.switch_sun_on();
        let mut camera = self.stage.world().entity_mut(self.camera);
        camera.remove::<RenderLayers>();
        camera.insert((eye(), Projection::default()));
        let mut view = camera.get_mut::<Camera>().expect("a camera");
        view.is_active = true;
        view.viewport = None;
        for (caster, at, mesh) in &self.scene {
            let mut caster = self.stage.world().entity_mut(*caster);
            caster.remove::<(RenderLayers, NotShadowCaster)>();
            caster.insert((*at, mesh.clone(), Visibility::Inherited));
        }
    }

    fn switch_sun_on(&mut self) {
        let light = self.stage.world().get_mut::<DirectionalLight>(self.sun);
        light.expect("a sun").shadow_maps_enabled = true;
    }

    fn rest(&mut self) {
        for _ in 0..REST {
            self.stage.step();
        }
    }

    /// With Bevy's shadows, and with the plugin's from scratch.
    fn pictures(&mut self) -> [RgbaImage; 2] {
        let mut sun = self.stage.world().entity_mut(self.sun);
        sun.remove::<ParallelSplitShadows>();
        self.stage.step();
        // It was off if it was managed anew while it was switched off.
        self.switch_sun_on();
        self.stage.headless.settle();
        let built_in = self.stage.last_picture();
        let mut sun = self.stage.world().entity_mut(self.sun);
        sun.insert(original());
        self.stage.headless.settle();
        [built_in, self.stage.last_picture()]
    }

    fn counts(&mut self) -> Counts {
        let world = self.stage.world();
        let entities = count_entities(world);
        let meshes = world.resource::<Assets<Mesh>>().len();
        let materials = world.resource::<Assets<StandardMaterial>>().len();
        let presets = world.resource::<Assets<ParallelSplitShadows>>().len();
        let world = self.stage.render_world();
        let target = world.resource::<ShadowTarget>();
        let layers = (0..).take_while(|layer| target.layer(*layer).is_some());
        Counts {
            entities,
            render_entities: count_entities(world),
            meshes,
            render_meshes: world.resource::<RenderAssets<RenderMesh>>().iter().count(),
            materials,
            presets,
            shadow_phases: world.resource::<ViewBinnedRenderPhases<Shadow>>().len(),
            layers: layers.count(),
        }
    }

    /// What buffers and textures take (bytes); nothing where the GPU's driver sees to that.
    fn gpu_memory(&self) -> u64 {
        let device = self.stage.render_world().resource::<RenderDevice>();
        let report = device.wgpu_device().generate_allocator_report();
        report.map_or(0, |report| report.total_allocated_bytes)
    }
}

/// Without those that hold resources, which may be made late.
fn count_entities(world: &World) -> usize {
    let resources = world.resource_entities().iter().count();
    world.entities().count_spawned() as usize - resources
}

fn toggle<C: Component>(entity: &mut EntityWorldMut, component: C) {
    if entity.contains::<C>() {
        entity.remove::<C>();
    } else {
        entity.insert(component);
    }
}

fn hide_or_show(entity: &mut EntityWorldMut) {
    let is_hidden = entity.get::<Visibility>() == Some(&Visibility::Hidden);
    entity.insert(if is_hidden {
        Visibility::Inherited
    } else {
        Visibility::Hidden
    });
}

/// What the sun is given at the start and in the end.
fn original() -> ParallelSplitShadows {
    ParallelSplitShadows {
        map_size: MapSize::Same(256),
        ..shadows()
    }
}

/// Of a light that shines down, along the ground or a little up.
fn any_turn(dice: &mut Dice) -> Transform {
    let (yaw, pitch) = (dice.within(0.0..TAU), dice.within(-FRAC_PI_2..0.2));
    Transform::from_rotation(Quat::from_euler(EulerRot::YXZ, yaw, pitch, 0.0))
}

/// Of a camera, which may look at nothing.
fn any_place(dice: &mut Dice) -> Transform {
    let (yaw, pitch) = (dice.within(0.0..TAU), dice.within(-1.2..0.4));
    let at = Vec3::new(
        dice.within(-10.0..10.0),
        dice.within(0.5..30.0),
        dice.within(-60.0..20.0),
    );
    Transform::from_translation(at).with_rotation(Quat::from_euler(EulerRot::YXZ, yaw, pitch, 0.0))
}

/// Of a caster, at rest, turned or large.
fn any_spot(dice: &mut Dice) -> Transform {
    let at = Vec3::new(
        dice.within(-6.0..6.0),
        dice.within(0.0..4.0),
        dice.within(-50.0..8.0),
    );
    Transform::from_translation(at)
        .with_rotation(Quat::from_rotation_y(dice.within(0.0..TAU)))
        .with_scale(Vec3::splat(dice.any(&[0.3, 1.0, 1.0, 4.0])))
}

/// As broken as Bevy itself allows: it asserts that forward is a direction.
fn any_broken(dice: &mut Dice) -> Transform {
    dice.any(&[
        Transform::from_scale(Vec3::new(0.0, 1.0, 1.0)),
        Transform::from_scale(Vec3::new(1.0, 0.0, 1.0)),
        Transform::from_scale(Vec3::splat(1e-12)),
        Transform::from_translation(Vec3::splat(1e30)),
        Transform::from_translation(Vec3::NAN),
    ])
}

fn any_viewport(dice: &mut Dice) -> Viewport {
    let size = UVec2::new(16 + dice.pick(64) as u32, 16 + dice.pick(48) as u32);
    let room = SIZE - size;
    let at = UVec2::new(
        dice.pick(room.x as usize) as u32,
        dice.pick(room.y as usize) as u32,
    );
    Viewport {
        physical_position: at,
        physical_size: size,
        ..default()
    }
}

fn any_side(dice: &mut Dice) -> u32 {
    64 + dice.pick(MAX_MAP_SIZE as usize - 63) as u32
}

fn any_map_fit(dice: &mut Dice) -> MapFit {
    let warp = match dice.pick(5) {
        0 => MapWarp::Minimax,
        1 => MapWarp::Lispsm,
        2 => MapWarp::Lloyd {
            eta: dice.within(-1.0..1.0),
        },
        3 => MapWarp::Trapezoid {
            focus: dice.within(0.1..0.8),
        },
        _ => MapWarp::Strength(dice.roll()),
    };
    dice.any(&[
        MapFit::Stable,
        MapFit::Steady,
        MapFit::Tight,
        MapFit::Warped(warp),
    ])
}

fn any_fit(dice: &mut Dice, cascades: u32) -> CascadeFit {
    match dice.pick(6) {
        0 => CascadeFit::Auto {
            sharpness: dice.roll(),
        },
        1 => CascadeFit::PerCascade((0..cascades).map(|_| any_map_fit(dice)).collect()),
        _ => match any_map_fit(dice) {
            MapFit::Stable => CascadeFit::Stable,
            MapFit::Steady => CascadeFit::Steady,
            MapFit::Tight => CascadeFit::Tight,
            MapFit::Warped(warp) => CascadeFit::Warped(warp),
        },
    }
}

fn any_filter(dice: &mut Dice) -> ShadowFilter {
    let radius = if dice.roll() < 0.5 {
        FilterRadius::Texels(dice.within(1.0..8.0))
    } else {
        FilterRadius::Meters(dice.within(0.01..1.0))
    };
    match dice.pick(5) {
        0 => ShadowFilter::Camera,
        1 => ShadowFilter::Hardware2x2,
        2 => ShadowFilter::Tent(radius),
        3 => ShadowFilter::Temporal(radius),
        _ => ShadowFilter::Soft {
            sun_degrees: dice.within(0.1..2.0),
        },
    }
}

fn any_comparison(dice: &mut Dice) -> Comparison {
    let meters = dice.within(0.0..0.5);
    let bias = match dice.pick(5) {
        0 => ShadowBias::Automatic,
        1 => ShadowBias::Constant { meters },
        2 => ShadowBias::SlopeScaled {
            factor: dice.within(0.0..4.0),
            meters,
        },
        3 => ShadowBias::NormalOffset {
            texels: dice.within(0.0..3.0),
        },
        _ => ShadowBias::ReceiverPlane { meters },
    };
    Comparison {
        bias,
        depth: dice.any(&[DepthDistribution::Hyperbolic, DepthDistribution::Linear]),
        caster_faces: dice.any(&[CasterFaces::Front, CasterFaces::Back]),
        warp_axis: dice.any(&[WarpAxis::View, WarpAxis::BodyCenter]),
        culling: dice.any(&[CasterCulling::Hull, CasterCulling::Off]),
        focus: dice.any(&[ShadowFocus::Receivers, ShadowFocus::Off]),
        updates: dice.any(&[MapUpdates::WhenNeeded, MapUpdates::EveryFrame]),
    }
}

fn any_config(dice: &mut Dice) -> ParallelSplitShadows {
    let has_faces = dice.pick(7) == 0;
    let cascades = if has_faces {
        4
    } else {
        1 + dice.pick(4) as u32
    };
    let (near, far) = (dice.within(0.1..2.0), dice.within(10.0..400.0));
    // Faces have fewer slices than planes by hand would cut.
    let splits = match dice.pick(if has_faces { 5 } else { 6 }) {
        0 => SplitScheme::Uniform,
        1 => SplitScheme::Logarithmic,
        2 => SplitScheme::Practical {
            lambda: dice.roll(),
        },
        3 => SplitScheme::Geometric {
            gamma: dice.within(1.5..4.0),
            bias: dice.within(0.0..5.0),
        },
        4 => SplitScheme::GeometricScaled {
            gamma: dice.within(1.5..4.0),
            bias: dice.within(0.0..5.0),
        },
        _ => {
            let step = (far - near) / cascades as f32;
            let planes = (1..cascades).map(|plane| near + step * plane as f32);
            SplitScheme::Manual(planes.collect())
        }
    };
    let map_size = match dice.pick(4) {
        0 => MapSize::Same(any_side(dice)),
        1 => MapSize::Halving(MAX_MAP_SIZE),
        2 => {
            let sizes = (0..cascades).map(|_| [any_side(dice), any_side(dice)]);
            MapSize::PerCascade(sizes.collect())
        }
        _ => MapSize::Budget(cascades * 256 * 256),
    };
    let config = ParallelSplitShadows {
        cascades,
        near,
        far,
        splits,
        blend: dice.within(0.0..0.5),
        fade: dice.roll(),
        fit: if has_faces {
            CascadeFit::Faces
        } else {
            any_fit(dice, cascades)
        },
        slack: dice.roll(),
        map_size,
        filter: any_filter(dice),
        grid: dice.any(&[TexelGrid::Light, TexelGrid::Ground]),
        sun_step: dice.roll(),
        delay: dice.pick(4) as u32,
        update_budget: dice.any(&[
            UpdateBudget::Maps(1),
            UpdateBudget::Maps(2),
            UpdateBudget::Texels(1 << 20),
        ]),
        transition: dice.any(&[CascadeTransition::CrossFade, CascadeTransition::Dither]),
        comparison: any_comparison(dice),
    };
    let valid = config.validate(4 * MAX_MAP_SIZE);
    assert!(valid.is_ok(), "{valid:?}: {config:?}");
    config
}

fn bad_config(dice: &mut Dice) -> ParallelSplitShadows {
    let mut config = any_config(dice);
    match dice.pick(6) {
        0 => config.near = f32::NAN,
        1 => config.near = 2.0 * config.far,
        2 => config.far = f32::INFINITY,
        3 => config.cascades = 0,
        4 => config.cascades = 9,
        _ => config.map_size = MapSize::Same(0),
    }
    config
}

/// `PSSM_SOAK_FRAMES` says how many frames something happens in.
#[test]
fn in_the_end_all_is_as_it_was() {
    let frames = std::env::var("PSSM_SOAK_FRAMES").ok();
    let frames: usize = frames.map_or(60, |frames| frames.parse().expect("a number"));
    let mut soak = Soak::new();
    soak.rest();
    let pictures = soak.pictures();
    soak.rest();
    let (counts, memory) = (soak.counts(), soak.gpu_memory());
    warnings::take();
    for _ in 0..frames {
        for _ in 0..=soak.dice.pick(3) {
            soak.act();
        }
        soak.stage.step();
        soak.check();
    }
    soak.restore();
    soak.rest();
    assert_eq!(soak.counts(), counts);
    let found = soak.gpu_memory();
    assert!(found <= memory + MOST_GROWTH, "{found} of {memory} bytes");
    let [built_in, ours] = soak.pictures();
    assert_identical("soak_built_in", &built_in, &pictures[0]);
    assert_identical("soak", &ours, &pictures[1]);
    let mut errors = warnings::take();
    errors.retain(|line| line.starts_with("ERROR"));
    assert!(errors.is_empty(), "{errors:#?}");
}
