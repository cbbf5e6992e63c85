//! What a camera and a light cost the CPU each frame: gathering what the camera sees, planning, and
//! testing casters; and what a map that is drawn costs it in the render world.

#[path = "../examples/common/headless.rs"]
mod headless;
#[path = "../examples/common/server.rs"]
mod server;
#[path = "../examples/common/warnings.rs"]
mod warnings;

use core::{hint::black_box, time::Duration};
use std::{fs, process, sync::LazyLock, thread, time::Instant};

use bevy::{
    camera::{
        CameraProjection, PerspectiveProjection, Viewport, primitives::Aabb,
        visibility::NoFrustumCulling,
    },
    light::{
        CascadeShadowConfigBuilder, DirectionalLightShadowMap, NotShadowCaster,
        cascade::build_directional_light_cascades, check_dir_light_mesh_visibility,
        update_directional_light_frusta,
    },
    math::{DAffine3, DMat3, DVec3},
    prelude::*,
    render::RenderApp,
};
use bevy_pssm::{
    CascadeFit, Comparison, MapSize, MapUpdates, MapWarp, ParallelSplitShadows, PssmPlugin,
    geometry::{
        light_frame::LightFrame, oriented_box::OrientedBox, receivers::Receivers, slice::ViewVolume,
    },
    plan::{CasterChanges, PlanHistory, PlanInputs, lookup_reach, plan_cascades},
    systems::{cull_casters, find_changes, plan_shadows},
};
use criterion::{Criterion, SamplingMode, criterion_group, criterion_main};
use server::server_app;

const CASTERS: usize = 10_000;
const RECEIVERS: usize = 100_000;

fn planning(criterion: &mut Criterion) {
    let projection = PerspectiveProjection::default();
    let view = ViewVolume::new(
        DAffine3::from_translation(DVec3::new(500.0, 20.0, -300.0)),
        &projection.get_clip_from_view(),
    )
    .expect("a sound camera");
    let light = LightFrame::new(DVec3::new(0.3, 0.7, 0.4)).expect("a direction");
    let reach = lookup_reach(
        &ParallelSplitShadows::default(),
        &DirectionalLight::default(),
    );
    let mut receivers = Receivers::new(&view);
    receivers.add(&OrientedBox {
        center: DVec3::new(500.0, 0.0, -800.0),
        half_axes: DMat3::from_diagonal(DVec3::new(800.0, 12.0, 800.0)),
    });
    let plan = |config: &ParallelSplitShadows, history: &mut PlanHistory| {
        let inputs = PlanInputs {
            view: black_box(&view),
            light: &light,
            config,
            reach,
            receivers: &receivers,
            image_height: 1080.0,
            changes: &CasterChanges::Anywhere,
        };
        plan_cascades(&inputs, history)
    };
    for (name, fit) in [
        ("stable", CascadeFit::Stable),
        ("tight", CascadeFit::Tight),
        ("warped", CascadeFit::Warped(MapWarp::Minimax)),
        ("faces", CascadeFit::Faces),
        ("auto", CascadeFit::Auto { sharpness: 1.0 }),
    ] {
        let config = ParallelSplitShadows {
            fit,
            ..Default::default()
        };
        let mut history = PlanHistory::default();
        criterion.bench_function(&format!("plan 4 cascades, {name}"), |bencher| {
            bencher.iter(|| plan(&config, &mut history));
        });
    }

    let plan = plan(
        &ParallelSplitShadows::default(),
        &mut PlanHistory::default(),
    );
    let boxes: Vec<OrientedBox> = (0..CASTERS)
        .map(|i| {
            let (row, column) = (i / 100, i % 100);
            OrientedBox {
                center: DVec3::new(10.0 * column as f64, 2.0, -10.0 * row as f64),
                half_axes: DMat3::from_diagonal(DVec3::new(1.0, 2.0, 1.5)),
            }
        })
        .collect();
    criterion.bench_function(
        &format!("test {CASTERS} casters against 4 hulls"),
        |bencher| {
            bencher.iter(|| {
                plan.iter()
                    .filter_map(|cascade| cascade.map.as_ref())
                    .map(|map| {
                        let meets = |it: &&OrientedBox| map.hull.intersects_box(it);
                        black_box(&boxes).iter().filter(meets).count()
                    })
                    .sum::<usize>()
            });
        },
    );
}

/// The whole system, with very many meshes in view.
fn gathering(criterion: &mut Criterion) {
    for (name, fit) in [
        ("stable", CascadeFit::Stable),
        ("warped", CascadeFit::Warped(MapWarp::Minimax)),
    ] {
        let mut app = crowded_app(fit);
        let world = app.world_mut();
        let mut system = IntoSystem::into_system(plan_shadows);
        system.initialize(world);
        criterion.bench_function(
            &format!("plan over {RECEIVERS} meshes, {name}"),
            |bencher| {
                bencher.iter(|| system.run((), world));
            },
        );
    }
}

fn crowded_app(fit: CascadeFit) -> App {
    let mut app = server_app(AssetPlugin::default());
    app.finish();
    app.cleanup();
    let world = app.world_mut();
    world.spawn((Camera3d::default(), Transform::from_xyz(0.0, 20.0, 0.0)));
    world.spawn((
        DirectionalLight::default(),
        Transform::default().looking_to(Vec3::new(1.0, -1.0, 0.2), Vec3::Y),
        ParallelSplitShadows { fit, ..default() },
    ));
    world.spawn_batch((0..RECEIVERS).map(|i| {
        let (row, column) = (i / 400, i % 400);
        let place = Vec3::new(column as f32 - 200.0, 0.0, -200.0 - row as f32);
        (
            Mesh3d::default(),
            Aabb::from_min_max(Vec3::splat(-0.5), Vec3::splat(0.5)),
            Transform::from_translation(place),
            Visibility::default(),
        )
    }));
    app.update();
    app
}

/// What moves from frame to frame.
#[derive(Clone, Copy, PartialEq)]
enum Moves {
    Nothing,
    Camera,
    /// One mesh of a hundred.
    Some,
    All,
}

/// What a frame costs the main world, beside the systems of Bevy's that the plugin's stand in for, in the
/// same world.
fn frames(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("frame");
    group.sample_size(20);
    for (count, views) in [
        (1_000, 1),
        (10_000, 1),
        (100_000, 1),
        (100_000, 2),
        (1_000_000, 1),
    ] {
        let mut ours = Schedule::default();
        ours.add_systems((find_changes, plan_shadows, cull_casters).chain());
        let mut bevys = Schedule::default();
        bevys.add_systems(
            (
                build_directional_light_cascades,
                update_directional_light_frusta,
                check_dir_light_mesh_visibility,
            )
                .chain(),
        );
        let shadows = ParallelSplitShadows::default();
        let apps = [
            ("plugin", wide_app(count, views, shadows), ours),
            ("built-in", wide_app(count, views, ()), bevys),
        ];
        for (name, mut app, mut schedule) in apps {
            let mut advancing = Schedule::default();
            advancing.add_systems(advance);
            for (moving, moves) in [
                ("nothing", Moves::Nothing),
                ("the camera", Moves::Camera),
                ("one in a hundred", Moves::Some),
                ("all", Moves::All),
            ] {
                let world = app.world_mut();
                let many = ["", " before two cameras, under two suns"][views - 1];
                group.bench_function(
                    format!("{count} meshes{many}, {moving} moves, {name}"),
                    |bencher| {
                        bencher.iter_custom(|times| {
                            let mut spent = Duration::ZERO;
                            for frame in 0..times {
                                world.insert_resource(Motion { moves, frame });
                                advancing.run(world);
                                let start = Instant::now();
                                schedule.run(world);
                                spent += start.elapsed();
                            }
                            spent
                        });
                    },
                );
            }
        }
    }
}

/// Where a camera stands at first.
#[derive(Component)]
struct Base(GlobalTransform);

/// What moves in the next frame.
#[derive(Resource)]
struct Motion {
    moves: Moves,
    frame: u64,
}

/// On Bevy's threads, as transforms are propagated: so what systems find in their caches is what they do in a game.
fn advance(
    motion: Res<Motion>,
    mut cameras: Query<(&mut GlobalTransform, &Base)>,
    mut meshes: Query<&mut GlobalTransform, (With<Mesh3d>, Without<Base>)>,
) {
    // To and fro: what cameras see is not worked out anew.
    let swing = match motion.moves {
        Moves::Camera => 0.01 * ((motion.frame % 20) as f32 - 10.0).abs(),
        _ => 0.0,
    };
    let swing = Transform::from_rotation(Quat::from_rotation_y(swing));
    for (mut at, base) in &mut cameras {
        at.set_if_neq(base.0.mul_transform(swing));
    }
    let turn = Transform::from_rotation(Quat::from_rotation_y(0.01));
    let turn = |mut at: Mut<GlobalTransform>| *at = at.mul_transform(turn);
    match motion.moves {
        Moves::Nothing | Moves::Camera => {}
        Moves::Some => meshes.iter_mut().step_by(100).for_each(turn),
        Moves::All => meshes.par_iter_mut().for_each(turn),
    }
}

/// Meshes over two kilometers, cameras in their middle, and a sun for each.
fn wide_app(count: usize, views: usize, shadows: impl Bundle + Clone) -> App {
    let mut app = server_app(AssetPlugin::default());
    app.finish();
    app.cleanup();
    let world = app.world_mut();
    let viewport = Viewport {
        physical_size: UVec2::new(1920, 1080),
        ..default()
    };
    for view in 0..views {
        let side = 1.0 - 2.0 * view as f32;
        let eye = Transform::from_xyz(0.0, 20.0, 0.0).looking_to(Vec3::NEG_Z * side, Vec3::Y);
        world.spawn((
            Camera3d::default(),
            Camera {
                viewport: Some(viewport.clone()),
                order: view as isize,
                ..default()
            },
            eye,
            Base(eye.into()),
        ));
        world.spawn((
            DirectionalLight {
                shadow_maps_enabled: true,
                ..default()
            },
            CascadeShadowConfigBuilder {
                maximum_distance: 500.0,
                ..default()
            }
            .build(),
            Transform::default().looking_to(Vec3::new(side, -1.0, 0.2), Vec3::Y),
            shadows.clone(),
        ));
    }
    let side = (count as f32).sqrt().ceil();
    world.spawn_batch((0..count).map(move |i| {
        let (row, column) = ((i as f32 / side).floor(), i as f32 % side);
        let place = 2000.0 * Vec3::new(column / side - 0.5, 0.0, row / side - 0.5);
        (
            Mesh3d::default(),
            Aabb::from_min_max(Vec3::splat(-0.5), Vec3::splat(0.5)),
            Transform::from_translation(place),
            Visibility::default(),
        )
    }));
    for _ in 0..3 {
        app.update();
    }
    app
}

/// Whose maps an app draws.
#[derive(Clone, Copy, PartialEq)]
enum Maps {
    None,
    /// None, though the plugin is there.
    Idle,
    BuiltIn,
    /// Bevy's, and nothing casts shadows.
    Empty,
    Plugin(MapUpdates),
}

/// What four maps cost in extracting and rendering a frame: on the CPU, by Bevy's own threads, beyond what frames without
/// them cost that are drawn in turn with theirs, some at a time. A machine that is slower now and then is so for both.
fn render_worlds(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("render world");
    // Many frames to a sample: a difference of few may be below none.
    group.sample_size(30).sampling_mode(SamplingMode::Flat);
    group.measurement_time(Duration::from_secs(15));
    let drawn = Maps::Plugin(MapUpdates::EveryFrame);
    let held = Maps::Plugin(MapUpdates::WhenNeeded);
    let pairs = [
        ("nothing, over no shadows", Maps::None, Maps::None),
        ("built-in, over no shadows", Maps::BuiltIn, Maps::None),
        (
            "built-in and empty, over no shadows",
            Maps::Empty,
            Maps::None,
        ),
        ("plugin, drawn over held", drawn, held),
        ("plugin, held over no shadows", held, Maps::None),
        (
            "plugin, no light managed, over no shadows",
            Maps::Idle,
            Maps::None,
        ),
    ];
    let counts = [100, 4000].into_iter();
    for (count, (name, with, without)) in counts.flat_map(|count| pairs.map(|it| (count, it))) {
        let mut with = drawing_app(count, with);
        let mut without = drawing_app(count, without);
        group.bench_function(format!("{count} meshes, {name}"), |bencher| {
            bencher.iter_custom(|times| {
                let (mut more, mut less) = (Duration::ZERO, Duration::ZERO);
                for block in 0..times.div_ceil(BLOCK) {
                    let frames = BLOCK.min(times - block * BLOCK);
                    more += render_frames(&mut with, frames);
                    less += render_frames(&mut without, frames);
                }
                more.saturating_sub(less).max(Duration::from_nanos(1))
            });
        });
    }
}

/// An app that renders small pictures of meshes, with or without maps, Bevy's or the plugin's.
fn drawing_app(count: usize, maps: Maps) -> headless::Headless {
    let mut headless = headless::Headless::new(UVec2::splat(16), |app| {
        app.insert_resource(DirectionalLightShadowMap { size: 64 });
        if matches!(maps, Maps::Plugin(_) | Maps::Idle) {
            app.add_plugins(PssmPlugin);
        }
    });
    spawn_drawn(&mut headless, count, maps);
    headless.settle();
    headless
}

/// So many frames of an app follow one another: games draw no other one's in between.
const BLOCK: u64 = 16;

/// What the render world of an app spends on so many frames, once it has found its code and data again.
fn render_frames(headless: &mut headless::Headless, frames: u64) -> Duration {
    render_frame(headless);
    (0..frames).map(|_| render_frame(headless)).sum()
}

/// Updates an app, and tells what its render world has spent, until all that the GPU has drawn is put away: sooner or
/// later it is.
fn render_frame(headless: &mut headless::Headless) -> Duration {
    headless.app.main_mut().run_default_schedule();
    let before = spent_by_bevy();
    let apps = headless.app.sub_apps_mut();
    apps.update_subapp_by_label(RenderApp);
    headless.finish();
    let spent = spent_by_bevy() - before;
    headless.app.main_mut().world_mut().clear_trackers();
    spent
}

/// What the main thread and Bevy's pools have spent on the CPU, without the driver's threads: a software device draws on the
/// same processor. What the clock says where the system does not tell.
fn spent_by_bevy() -> Duration {
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    let main = process::id().to_string();
    let is_bevys = |thread: &fs::DirEntry| {
        let name = fs::read_to_string(thread.path().join("comm")).unwrap_or_default();
        let is_pooled = name.contains("Task Po") || name.starts_with("Async Compute T");
        is_pooled || thread.file_name() == *main
    };
    let spent = |thread: fs::DirEntry| {
        let spent = fs::read_to_string(thread.path().join("schedstat")).ok()?;
        spent.split(' ').next()?.parse().ok()
    };
    // Brings the account of the running thread up to date.
    thread::yield_now();
    let threads = fs::read_dir("/proc/self/task").into_iter().flatten();
    let spent = threads.flatten().filter(is_bevys).filter_map(spent);
    let spent: Duration = spent.map(Duration::from_nanos).sum();
    if spent.is_zero() {
        START.elapsed()
    } else {
        spent
    }
}

/// Meshes of eight kinds, in all maps.
fn spawn_drawn(headless: &mut headless::Headless, count: usize, maps: Maps) {
    let target = headless.render_target();
    let world = headless.app.world_mut();
    let meshes = (0..8).map(|kind| Mesh::from(Cuboid::new(1.0, 1.0 + kind as f32, 1.0)));
    let meshes: Vec<_> = meshes.collect();
    let mut assets = world.resource_mut::<Assets<Mesh>>();
    let meshes: Vec<_> = meshes.into_iter().map(|mesh| assets.add(mesh)).collect();
    let material = world
        .resource_mut::<Assets<StandardMaterial>>()
        .add(Color::WHITE);
    let side = (count as f32).sqrt().ceil();
    for i in 0..count {
        let (row, column) = ((i as f32 / side).floor(), i as f32 % side);
        let mut mesh = world.spawn((
            Mesh3d(meshes[i % meshes.len()].clone()),
            MeshMaterial3d(material.clone()),
            // All of them are in all maps, whoever culls.
            NoFrustumCulling,
            Transform::from_xyz(400.0 * (column / side - 0.5), 0.0, -400.0 * row / side),
        ));
        if maps == Maps::Empty {
            mesh.insert(NotShadowCaster);
        }
    }
    world.spawn((
        Camera3d::default(),
        target,
        Transform::from_xyz(0.0, 20.0, 0.0).looking_to(Vec3::new(0.0, -0.1, -1.0), Vec3::Y),
    ));
    let mut sun = world.spawn((
        DirectionalLight {
            shadow_maps_enabled: !matches!(maps, Maps::None | Maps::Idle),
            ..default()
        },
        CascadeShadowConfigBuilder {
            maximum_distance: 500.0,
            ..default()
        }
        .build(),
        Transform::default().looking_to(Vec3::new(1.0, -1.0, 0.2), Vec3::Y),
    ));
    if let Maps::Plugin(updates) = maps {
        sun.insert(ParallelSplitShadows {
            far: 500.0,
            map_size: MapSize::Same(64),
            comparison: Comparison {
                updates,
                ..default()
            },
            ..default()
        });
    }
}

criterion_group!(benches, planning, gathering, frames, render_worlds);
criterion_main!(benches);
