//! Pictures and figures without a window.

use core::fmt::Write as _;
use std::{
    io::{Write as _, stdout},
    path::Path,
    time::Instant as Clock,
};

use bevy::{
    camera::visibility::CascadesVisibleEntities, core_pipeline::tonemapping::Tonemapping,
    diagnostic::DiagnosticsStore, platform::time::Instant, prelude::*,
};
use bevy_pssm::{ShadowPlans, debug::GRID_TEXELS, prelude::*};
use image::RgbaImage;

use crate::{
    measure::{Counts, MeasurePlugin, counts},
    scene_stage::SceneStage,
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
        "scene",
        "shadows",
        "casters in cascades 1 2 3 4",
        "total",
        "vertices",
        "primitives",
        "Mtexels"
    )?;
    for name in scenes {
        say(&format!("{name}: loading\n"))?;
        show_scene(name, &mut table)?;
    }
    show_grids()?;
    std::fs::write(Path::new(FOLDER).join("table.txt"), &table)?;
    say(&format!(
        "\n{table}\nPictures and table are in {FOLDER}/, after {:.0} s.\n",
        start.elapsed().as_secs_f32()
    ))?;
    Ok(())
}

fn show_scene(name: &str, table: &mut String) -> Result<(), BevyError> {
    let mut stage = SceneStage::new(
        name,
        SIZE,
        |app| {
            app.add_plugins(MeasurePlugin);
        },
        (Tonemapping::TonyMcMapface, Msaa::Off),
    );
    let label = spawn_label(&mut stage);
    let stats = stage.stats();
    say(&format!(
        "{name}: {} objects, {} triangles\n",
        stats.objects, stats.triangles
    ))?;
    let mut sums = [Sum::default(), Sum::default()];
    for (index, pose) in stage.description.camera.poses.clone().iter().enumerate() {
        stage.stand_at_pose(index);
        let shots = [true, false].map(|ours| {
            let side = if ours {
                "bevy_pssm"
            } else {
                "Bevy's built-in shadows"
            };
            let text = format!(
                "{}: {}\n{side}, 4 maps of {MAP_SIZE} x {MAP_SIZE}",
                stage.description.title, pose.name
            );
            if let Some(mut label) = stage.world().get_mut::<Text>(label) {
                label.0 = text;
            }
            stage.use_plugin(ours, MAP_SIZE);
            if index == 0 {
                stage.headless.settle();
            }
            shoot(&mut stage, ours)
        });
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

/// How fits spread their texels over what is seen: as Lloyd et al. 2006, Figs. 2 and 15.
fn show_grids() -> Result<(), BevyError> {
    let mut stage = SceneStage::new("robot_war", SIZE, |_| (), (Tonemapping::None, Msaa::Off));
    let label = spawn_label(&mut stage);
    stage.stand_at_pose(0);
    stage.use_plugin(true, MAP_SIZE);
    stage.headless.settle();
    stage.world().insert_resource(ShadowOverlay::TexelGrid);
    let fits = [
        ("stable", CascadeFit::Stable),
        ("steady", CascadeFit::Steady),
        ("tight", CascadeFit::Tight),
        ("warped", CascadeFit::Warped(MapWarp::Minimax)),
    ];
    let mut pictures = Vec::new();
    for (name, fit) in fits {
        stage.configure(|shadows| shadows.fit = fit);
        if let Some(mut label) = stage.world().get_mut::<Text>(label) {
            label.0 = format!("{name}: squares of {GRID_TEXELS} x {GRID_TEXELS} texels");
        }
        stage.headless.settle();
        pictures.push(stage.headless.picture());
    }
    let file = format!("{FOLDER}/texel_grids.png");
    let rows = pictures.chunks(2);
    let rows: Vec<_> = rows.map(|pair| side_by_side(&pair[0], &pair[1])).collect();
    let mut all = RgbaImage::new(2 * SIZE.x, 2 * SIZE.y);
    for (row, picture) in rows.iter().enumerate() {
        image::imageops::replace(&mut all, picture, 0, row as i64 * i64::from(SIZE.y));
    }
    all.save(&file)?;
    say(&format!("{file}\n"))?;
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
        self.casters
            .resize(self.casters.len().max(shot.casters.len()), 0);
        for (sum, casters) in self.casters.iter_mut().zip(&shot.casters) {
            *sum += casters;
        }
        self.counts.vertices += shot.counts.vertices;
        self.counts.primitives += shot.counts.primitives;
        self.texels += shot.texels;
    }
}

fn spawn_label(stage: &mut SceneStage) -> Entity {
    let camera = stage.camera;
    let label = (
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
    );
    stage.world().spawn(label).id()
}

fn shoot(stage: &mut SceneStage, ours: bool) -> Shot {
    let since = Instant::now();
    let picture = stage.headless.picture();
    // Measurements arrive a frame late.
    stage.headless.step();

    let sun = stage.sun;
    let world = stage.world();
    let counts = counts(world.resource::<DiagnosticsStore>(), ours, since);
    let casters: Vec<usize> = world
        .get::<CascadesVisibleEntities>(sun)
        .into_iter()
        .flat_map(|lists| lists.entities.values().flatten())
        .map(|list| list.entities.len())
        .collect();
    let plans = world.get::<ShadowPlans>(sun).filter(|_| ours);
    let plans = plans.and_then(|plans| plans.views.values().next());
    let texels = (0..casters.len())
        .map(|cascade| {
            let plan = plans.and_then(|plans| plans.get(cascade));
            plan.map_or(UVec2::splat(MAP_SIZE as u32), |plan| plan.map_size)
        })
        .map(|size| u64::from(size.x) * u64::from(size.y))
        .sum();
    Shot {
        picture,
        casters,
        counts,
        texels,
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
