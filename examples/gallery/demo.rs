//! Pictures and figures without a window.

use std::{
    fmt::Write as _,
    io::{Write as _, stdout},
    path::Path,
    time::Instant as Clock,
};

use bevy::{
    camera::visibility::CascadesVisibleEntities,
    core_pipeline::tonemapping::Tonemapping,
    diagnostic::DiagnosticsStore,
    light::DirectionalLightShadowMap,
    platform::time::Instant,
    prelude::*,
};
use bevy_pssm::prelude::*;
use image::RgbaImage;

use crate::{
    headless::Headless,
    measure::{Counts, MeasurePlugin, counts},
    scene::{Ground, SceneDescription, SceneStats, SceneSun, ScenesPlugin},
    set::{CurrentScene, SceneCamera, set_up},
};

const SIZE: UVec2 = UVec2::new(800, 600);
const FOLDER: &str = "target/demo";
const MAP_SIZE: usize = 2048;

/// One side of the comparison, at one pose.
struct Shot {
    picture: RgbaImage,
    casters: Vec<usize>,
    counts: Counts,
    texels: u64,
}

/// Renders all poses of the scenes.
///
/// # Errors
/// If a picture or the table cannot be written.
pub fn run(scenes: &[&str]) -> Result<(), BevyError> {
    let start = Clock::now();
    std::fs::create_dir_all(FOLDER)?;
    let mut table = String::from(
        "Casters drawn per cascade (nearest first) and what the shadow passes did,\n\
         sums over all poses of a scene. Shadow texels are equal: 4 maps of 2048².\n\n",
    );
    writeln!(
        table,
        "{:<16} {:<9} {:>30} {:>8} {:>12} {:>12} {:>9}",
        "scene", "shadows", "casters in cascades 1 2 3 4", "total", "vertices", "primitives", "Mtexels"
    )?;
    for name in scenes {
        say(&format!("{name}: loading\n"))?;
        show_scene(name, &mut table)?;
    }
    std::fs::write(Path::new(FOLDER).join("table.txt"), &table)?;
    say(&format!(
        "\n{table}\nPictures and table are in {FOLDER}/, after {:.0} s.\n",
        start.elapsed().as_secs_f32()
    ))?;
    Ok(())
}

fn show_scene(name: &str, table: &mut String) -> Result<(), BevyError> {
    let mut stage = Stage::new(name);
    let scene = stage.scene();
    let stats = *stage.headless.app.world().resource::<SceneStats>();
    say(&format!(
        "{name}: {} objects, {} triangles\n",
        stats.objects, stats.triangles
    ))?;
    let mut sums = [Sum::default(), Sum::default()];
    for (index, pose) in scene.camera.poses.iter().enumerate() {
        stage.stand_at(&scene, index);
        let shots = [true, false].map(|ours| stage.shoot(&scene, &pose.name, ours));
        for (sum, shot) in sums.iter_mut().zip(&shots) {
            sum.add(shot);
        }
        let file = format!("{FOLDER}/{name}_{}.png", index + 1);
        side_by_side(&shots[0].picture, &shots[1].picture).save(&file)?;
        say(&format!("{name}: {file} ({})\n", pose.name))?;
    }
    for (sum, label) in sums.iter().zip(["plugin", "built-in"]) {
        let casters: Vec<String> = sum.casters.iter().map(ToString::to_string).collect();
        writeln!(
            table,
            "{name:<16} {label:<9} {:>30} {:>8} {:>12} {:>12} {:>9.1}",
            casters.join("  "),
            sum.casters.iter().sum::<usize>(),
            sum.counts.vertices,
            sum.counts.primitives,
            sum.texels as f64 / 1e6,
        )?;
    }
    Ok(())
}

/// Sums over the poses of a scene.
#[derive(Default)]
struct Sum {
    casters: Vec<usize>,
    counts: Counts,
    texels: u64,
}

impl Sum {
    fn add(&mut self, shot: &Shot) {
        self.casters.resize(self.casters.len().max(shot.casters.len()), 0);
        for (sum, casters) in self.casters.iter_mut().zip(&shot.casters) {
            *sum += casters;
        }
        self.counts.vertices += shot.counts.vertices;
        self.counts.primitives += shot.counts.primitives;
        self.texels += shot.texels;
    }
}

/// A scene in an app of its own.
struct Stage {
    headless: Headless,
    label: Entity,
}

impl Stage {
    fn new(name: &str) -> Self {
        let mut headless = Headless::new(SIZE, |app| {
            app.add_plugins((PssmPlugin, ScenesPlugin, MeasurePlugin))
                .insert_resource(DirectionalLightShadowMap { size: MAP_SIZE })
                .init_resource::<CurrentScene>()
                .add_systems(Update, set_up);
        });
        let target = headless.render_target();
        let world = headless.app.world_mut();
        let camera = world
            .spawn((Camera3d::default(), SceneCamera, target, Tonemapping::TonyMcMapface))
            .id();
        let label = world
            .spawn((
                Text::default(),
                TextFont::from_font_size(20.0),
                Node {
                    position_type: PositionType::Absolute,
                    left: px(10.0),
                    top: px(8.0),
                    padding: UiRect::all(px(6.0)),
                    ..default()
                },
                BackgroundColor(Color::srgba(0.0, 0.0, 0.0, 0.6)),
                UiTargetCamera(camera),
            ))
            .id();
        world.resource_scope(|world, mut current: Mut<CurrentScene>| {
            current.load(name, world.resource::<AssetServer>());
        });
        let mut stage = Self { headless, label };
        let configured = |stage: &mut Self| {
            let world = stage.headless.app.world_mut();
            let mut suns = world.query_filtered::<(), (With<SceneSun>, With<ParallelSplitShadows>)>();
            suns.iter(world).next().is_some()
        };
        while !configured(&mut stage) {
            stage.headless.step();
        }
        stage
    }

    fn scene(&self) -> SceneDescription {
        let world = self.headless.app.world();
        let current = &world.resource::<CurrentScene>().handle;
        let scenes = world.resource::<Assets<SceneDescription>>();
        scenes.get(current).cloned().expect("the scene was spawned from it")
    }

    fn stand_at(&mut self, scene: &SceneDescription, pose: usize) {
        let world = self.headless.app.world_mut();
        let ground = world.resource::<Ground>().clone();
        let place = scene.camera.pose(pose, |x, z| ground.height(x, z));
        let mut cameras = world.query_filtered::<&mut Transform, With<SceneCamera>>();
        for mut transform in cameras.iter_mut(world) {
            *transform = place;
        }
    }

    fn shoot(&mut self, scene: &SceneDescription, pose: &str, ours: bool) -> Shot {
        let side = if ours { "bevy_pssm" } else { "Bevy's built-in shadows" };
        let text = format!("{}: {pose}\n{side}, 4 maps of {MAP_SIZE}²", scene.title);
        let world = self.headless.app.world_mut();
        if let Some(mut label) = world.get_mut::<Text>(self.label) {
            label.0 = text;
        }
        let mut suns = world.query_filtered::<&mut ParallelSplitShadows, With<SceneSun>>();
        for mut shadows in suns.iter_mut(world) {
            shadows.enabled = ours;
        }
        self.headless.settle();
        let since = Instant::now();
        let picture = self.headless.picture();
        self.headless.step();
        self.headless.step();

        let world = self.headless.app.world_mut();
        let counts = counts(world.resource::<DiagnosticsStore>(), ours, since);
        let mut suns =
            world.query_filtered::<(&CascadesVisibleEntities, &ParallelSplitShadows), With<SceneSun>>();
        let (casters, texels) = suns
            .iter(world)
            .next()
            .map(|(lists, shadows)| {
                let casters: Vec<usize> = lists
                    .entities
                    .values()
                    .flat_map(|views| views.iter().map(|list| list.entities.len()))
                    .collect();
                let texels = (0..casters.len())
                    .map(|cascade| match ours {
                        true => u64::from(shadows.map_size.of_cascade(cascade)).pow(2),
                        false => (MAP_SIZE as u64).pow(2),
                    })
                    .sum();
                (casters, texels)
            })
            .unwrap_or_default();
        Shot { picture, casters, counts, texels }
    }
}

fn side_by_side(left: &RgbaImage, right: &RgbaImage) -> RgbaImage {
    let mut both = RgbaImage::new(left.width() + right.width(), left.height());
    image::imageops::replace(&mut both, left, 0, 0);
    image::imageops::replace(&mut both, right, i64::from(left.width()), 0);
    both
}

/// Progress on the terminal, at once.
fn say(text: &str) -> std::io::Result<()> {
    let mut out = stdout();
    out.write_all(text.as_bytes())?;
    out.flush()
}
