//! What shadow settings trade: speed, memory and accuracy, measured against rays.

#[path = "../common/headless.rs"]
mod headless;
#[path = "../common/measure.rs"]
mod measure;
#[path = "../scenes/mod.rs"]
mod scene;
#[path = "../common/scene_stage.rs"]
mod scene_stage;
#[path = "../truth/mod.rs"]
mod truth;
#[path = "../common/warnings.rs"]
mod warnings;

mod arguments;
mod lookups;
mod pareto;
mod plot;
mod progress;
mod report;
mod study;

use core::error::Error;
use std::{process::ExitCode, time::Instant};

use bevy::{
    prelude::*,
    render::{
        renderer::{RenderAdapterInfo, RenderDevice},
        settings::WgpuFeatures,
    },
};
use bevy_pssm::prelude::*;
use clap::Parser;
use image::RgbImage;

use arguments::{Arguments, Baseline, NamedScene};
use progress::{Progress, tell};
use report::{SceneReport, picture_name};
use scene::ScenesPlugin;
use scene_stage::SceneStage;
use study::{
    day::sun_settings,
    flicker::Motion,
    path::Path,
    paths::{FOLLOWED, PathRow},
    pictures,
    row::Row,
    run::{Effort, Outcome, View},
    settings::{Setting, Stock, Technique, grid, map_sizes},
    studio::{Stance, Studio, linear_camera, measurable_app},
    trace::Rays,
    tune::{TUNED_SIZE, attempts},
};

/// Rays across a pixel, for fractions.
const RAYS: u32 = 4;
/// Poses at which flicker is measured: the first ones. Motions cost a frame each.
const FLICKER_POSES: usize = 1;

/// The settings of which alternatives are worked out.
const TO_BLUR: &str = "steady 2048 2×2";
const TO_PREFILTER: &str = "steady 2048";

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            #[expect(clippy::print_stderr, reason = "a message for who called")]
            {
                eprintln!("{error}");
            }
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    let start = Instant::now();
    if arguments.lookups {
        let text = lookups::report(arguments.quick, |case| tell(&format!("{case}\n")));
        let file = arguments.out.join("lookups.md");
        std::fs::create_dir_all(&arguments.out)
            .and_then(|()| std::fs::write(&file, text))
            .map_err(|error| format!("--out {}: {error}", file.display()))?;
        tell(&format!("The report is {}.\n", file.display()));
        return Ok(());
    }
    let scenes = arguments.scenes()?;
    let wanted = arguments.settings()?;
    let out = &arguments.out;
    std::fs::create_dir_all(out.join("pictures"))
        .map_err(|error| format!("--out {}: {error}", out.display()))?;
    let mut progress = Progress::new(scenes.iter().map(|scene| frames(arguments, scene)).sum());
    let mut head = String::new();
    let mut reports = Vec::new();
    for scene in &scenes {
        progress.say(&format!("{}: loading", scene.name));
        let stage = load(arguments, scene).map_err(|error| {
            let warnings = warnings::take().join("\n");
            format!("{}: {error}\n{warnings}", scene.name)
        })?;
        head = adapter(&stage);
        reports.push(measure_scene(
            arguments,
            scene,
            &wanted,
            stage,
            &mut progress,
        )?);
        // After each scene, so that a run cut short leaves something.
        report::write_csv(out, &reports)?;
    }
    let size = arguments.picture_size();
    head = format!("{head} Pictures of {} × {} pixels.", size.x, size.y);
    report::write(out, &head, &reports)?;
    for warning in warnings::take() {
        tell(&format!("{warning}\n"));
    }
    tell(&format!(
        "\n{head}\nThe report is {}, after {:.0} s.\n",
        out.join("report.md").display(),
        start.elapsed().as_secs_f32()
    ));
    Ok(())
}

/// Pictures that a scene will take: its own two per pose, then one per setting and pose, and one
/// per setting and small motion.
fn frames(arguments: &Arguments, scene: &NamedScene) -> usize {
    let poses = arguments.poses(scene.description.camera.poses.len());
    let motions = FLICKER_POSES.min(poses) * Motion::ALL.len() * arguments.frames as usize;
    let own = if !arguments.shadows.is_empty() {
        arguments.shadows.len()
    } else {
        grid(&ParallelSplitShadows::default(), arguments.quick).len()
    };
    let (stock, tuning) = match arguments.baseline {
        Baseline::Bevy => (
            2 * map_sizes(arguments.quick).len(),
            attempts(arguments.quick) * poses,
        ),
        Baseline::None => (0, 0),
    };
    let looked_at = paths(arguments).map(|(_, path)| path.looks(arguments.every).frames.len());
    let along = own.min(FOLLOWED.len()) * looked_at.sum::<usize>();
    2 * poses + (own + stock) * (poses + motions) + tuning + along
}

/// Those that are asked for.
fn paths(arguments: &Arguments) -> impl Iterator<Item = (&'static str, Path)> {
    let wanted = arguments.paths.as_deref();
    let all = Path::ALL.iter().filter(move |(name, _)| {
        let is_named = |start: &String| name.starts_with(start.as_str());
        wanted.is_some_and(|starts| starts.is_empty() || starts.iter().any(is_named))
    });
    let under_suns = Path::UNDER_SUNS.iter().filter(|_| arguments.suns);
    all.chain(under_suns).copied()
}

fn load(arguments: &Arguments, scene: &NamedScene) -> Result<SceneStage, String> {
    let app = measurable_app(arguments.picture_size(), |app| {
        app.add_plugins(ScenesPlugin);
    });
    let description = scene.description.clone();
    SceneStage::in_app(app, linear_camera(), |world, current| {
        current.handle = world.resource_mut::<Assets<_>>().add(description);
        current.spawned = false;
    })
}

/// The adapter, and what it cannot measure.
fn adapter(stage: &SceneStage) -> String {
    let world = stage.headless.app.world();
    let info = world.resource::<RenderAdapterInfo>();
    let features = world.resource::<RenderDevice>().features();
    let mut text = format!("Adapter: {} ({}).", info.name, info.driver_info);
    if !features.contains(WgpuFeatures::TIMESTAMP_QUERY) {
        text += " It has no timestamps: times on the GPU read zero.";
    }
    if !features.contains(WgpuFeatures::PIPELINE_STATISTICS_QUERY) {
        text += " It has no pipeline statistics: counts of the passes read zero.";
    }
    text
}

fn measure_scene(
    arguments: &Arguments,
    scene: &NamedScene,
    wanted: &[Setting],
    stage: SceneStage,
    progress: &mut Progress,
) -> Result<SceneReport, Box<dyn Error>> {
    let name = &scene.name;
    let poses = arguments.poses(scene.description.camera.poses.len());
    let places: Vec<Transform> = (0..poses).map(|index| stage.pose(index)).collect();
    let world = stage.headless.app.world();
    let preset = world.get::<ParallelSplitShadows>(stage.sun).cloned();
    let preset = preset.unwrap_or_default();

    let ground = stage.ground.clone();
    let size = arguments.picture_size();
    let mut studio = Studio::new(stage.headless, stage.camera, stage.sun, size);
    let start = studio.stance();
    let stances: Vec<Stance> = places
        .into_iter()
        .map(|camera| Stance {
            camera,
            ..start.clone()
        })
        .collect();
    progress.say(&format!("{name}: tracing rays"));
    let effort = Effort {
        rays: Rays::at_edges(RAYS),
        flicker_poses: FLICKER_POSES,
        steps: arguments.frames as usize,
    };
    let views = studio.survey(&stances, effort, || (0..2).for_each(|_| progress.step()));

    let mut settings = if wanted.is_empty() {
        grid(&preset, arguments.quick)
    } else {
        wanted.to_vec()
    };
    if arguments.baseline == Baseline::Bevy {
        progress.say(&format!("{name}: tuning Bevy's own shadows"));
        let defaults = |map_size| Stock::new(map_size, &preset);
        let tuned = studio.tune(&views, defaults(TUNED_SIZE), arguments.quick, || {
            progress.step();
        });
        for map_size in map_sizes(arguments.quick).iter().copied() {
            settings.push(Setting::bevy(
                format!("bevy {map_size}"),
                defaults(map_size),
            ));
            let tuned = Stock { map_size, ..tuned };
            settings.push(Setting::bevy(format!("bevy {map_size} tuned"), tuned));
        }
    }

    let mut report = SceneReport {
        name: name.clone(),
        paths: Vec::new(),
        suns: Vec::new(),
        settings: Vec::new(),
        rows: Vec::new(),
        worst_pose: Vec::new(),
        alternatives: Vec::new(),
    };
    for setting in settings {
        progress.say(&format!("{name}: {}", setting.name));
        let outcome = studio.measure(&views, &setting, || progress.step());
        let worst = worst_pose(&views, &outcome);
        let file = arguments.out.join(picture_name(name, &setting.name));
        triptych(&views[worst], &outcome, worst).save(file)?;
        report.rows.push(Row::new(name, &outcome, views.len()));
        if setting.name == TO_BLUR {
            let shares: Vec<_> = outcome.shots.iter().map(|s| s.shares.clone()).collect();
            report.alternatives.extend(studio.blurred(&views, &shares));
        } else if setting.name == TO_PREFILTER && !arguments.quick {
            progress.say(&format!("{name}: alternatives"));
            report.alternatives.extend(studio.prefiltered(&views[0]));
        }
        report.worst_pose.push(worst);
        report.settings.push(setting);
    }
    if paths(arguments).next().is_some() {
        let ground = |x: f32, z: f32| ground.height(x, z);
        let is_followed =
            |setting: &&Setting| !wanted.is_empty() || FOLLOWED.contains(&setting.name.as_str());
        let followed: Vec<_> = report.settings.iter().filter(is_followed).collect();
        let paths = paths(arguments);
        report.paths = follow(
            name,
            &mut studio,
            &stances,
            &ground,
            &followed,
            (paths, arguments.every),
            progress,
        );
    }
    if arguments.suns {
        let stock = report
            .settings
            .iter()
            .filter_map(|setting| match setting.technique {
                Technique::Bevy(stock) if stock.map_size == TUNED_SIZE => Some(stock),
                _ => None,
            });
        let stock: Vec<_> = stock.collect();
        let config = ParallelSplitShadows {
            near: preset.near,
            far: preset.far,
            ..ParallelSplitShadows::default()
        };
        let settings = sun_settings(&config, &stock);
        let tracer = studio.tracer(&stances[0]);
        let say = |text: &str| progress.say(&format!("{name}: {text}"));
        report.suns = studio.under_moving_suns(name, &stances[0], &settings, &tracer, say);
    }
    Ok(report)
}

/// Steadiness and accuracy of settings along paths.
fn follow(
    scene: &str,
    studio: &mut Studio,
    poses: &[Stance],
    ground: &dyn Fn(f32, f32) -> f32,
    settings: &[&Setting],
    (paths, every): (impl Iterator<Item = (&'static str, Path)>, usize),
    progress: &mut Progress,
) -> Vec<PathRow> {
    progress.say(&format!("{scene}: tracing rays along paths"));
    let tracer = studio.tracer(&poses[0]);
    let routes =
        paths.map(|(name, path)| (name, studio.explore(path, every, &tracer, poses, ground)));
    let routes: Vec<_> = routes.collect();
    let mut rows = Vec::new();
    for setting in settings {
        progress.say(&format!("{scene}: {} along paths", setting.name));
        studio.apply(setting);
        for (path, route) in &routes {
            let found = studio.travel(route, setting, || progress.step());
            rows.push(PathRow::new(scene, &setting.name, path, &found));
        }
    }
    rows
}

fn worst_pose(views: &[View], outcome: &Outcome) -> usize {
    let faults = |index: &usize| views[*index].truth.faults(&outcome.shots[*index].shares);
    (0..views.len()).max_by_key(faults).unwrap_or(0)
}

/// Picture, truth and difference side by side.
fn triptych(view: &View, outcome: &Outcome, pose: usize) -> RgbImage {
    let shot = &outcome.shots[pose];
    let panels = [
        shot.picture.to_image(view.truth.size()),
        pictures::truth(&view.truth),
        pictures::difference(&view.truth, &shot.shares),
    ];
    let [width, height] = view.truth.size().to_array();
    let mut all = RgbImage::new(3 * width, height);
    for (index, panel) in panels.iter().enumerate() {
        image::imageops::replace(&mut all, panel, i64::from(width) * index as i64, 0);
    }
    all
}
