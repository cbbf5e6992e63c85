//! A tour in pictures, without a window: each stop's two sides with figures by rays, and enlarged
//! where they differ most.

use core::{fmt::Write as _, time::Duration};
use std::{
    io::{Write as _, stdout},
    path::Path,
    time::Instant,
};

use bevy::{
    camera::visibility::CascadesVisibleEntities, image::ImageSampler, prelude::*,
    ui::widget::NodeImageMode,
};
use bevy_pssm::prelude::*;
use image::{RgbaImage, imageops};
use serde::Deserialize;

use crate::{
    explore::{
        Compare, ExplorerPlugin, Flight, KeptShadows, Opened, Pictures, Side, SideSun, Source,
        Technique, TruthView, caption_of,
    },
    headless::Headless,
    scene::{CurrentScene, SceneDescription},
    truth::accuracy::Fault,
};

/// Where pictures and table go.
const FOLDER: &str = "target/demo";
/// Of the pictures that are enlarged, along the width and the height of each side.
const INSET_SHARE: u32 = 8;
/// Height of the captions (pixels).
const LINE: f32 = 48.0;
/// Between frames while rays are traced, which have more use for the time.
const BREATH: Duration = Duration::from_millis(100);
/// Frames after which what does not appear is given up.
const MAX_STEPS: usize = 20_000;

/// What `*.tour.ron` holds.
#[derive(Deserialize, Debug)]
#[serde(deny_unknown_fields)]
struct Tour {
    /// Width and height of each side (pixels).
    size: (u32, u32),
    stops: Vec<Stop>,
}

/// One picture.
#[derive(Deserialize, Debug)]
#[serde(deny_unknown_fields)]
struct Stop {
    /// A shipped scene's name.
    scene: String,
    /// One of its poses, from 0.
    pose: usize,
    #[serde(default)]
    left: Shown,
    right: Shown,
    /// Shows the grids of texels in place of what is wrong.
    #[serde(default)]
    grids: bool,
}

/// One side.
#[derive(Deserialize, Debug, Default)]
#[serde(default, deny_unknown_fields)]
struct Shown {
    technique: Technique,
    /// In place of the scene's own.
    fit: Option<CascadeFit>,
}

/// Takes the tour of a file, or the part of it that shows one scene.
///
/// # Errors
/// If the file cannot be read, or pictures and table cannot be written.
pub fn run(file: &Path, only: Option<&str>) -> Result<(), BevyError> {
    let start = Instant::now();
    let tour: Tour = ron::from_str(&std::fs::read_to_string(file)?)
        .map_err(|error| format!("{}:{error}", file.display()))?;
    if let Some(scene) = only
        && !tour.stops.iter().any(|stop| stop.scene == scene)
    {
        return Err(format!("The tour has no stop in {scene}.").into());
    }
    std::fs::create_dir_all(FOLDER)?;
    let mut table = format!(
        "{:<16} {:<18} {:<30} {:>8} {:>8} {:>8} {:>8}  casters in cascades 1 2 3 4\n",
        "scene", "pose", "shadows", "wrong %", "dark %", "leak %", "stain %"
    );
    let mut guide = Guide::new(UVec2::from(tour.size));
    let stops = tour.stops.iter();
    for (index, stop) in stops.enumerate() {
        if only.is_some_and(|scene| scene != stop.scene) {
            continue;
        }
        let picture = guide.stop(stop, &mut table)?;
        let kind = if stop.grids { "grids" } else { "pose" };
        let file = format!(
            "{FOLDER}/{:02}_{}_{kind}_{}.png",
            index + 1,
            stop.scene,
            stop.pose + 1
        );
        picture.save(&file)?;
        say(&format!("{file}\n"))?;
    }
    std::fs::write(Path::new(FOLDER).join("table.txt"), &table)?;
    say(&format!(
        "\n{table}\nPictures and table are in {FOLDER}/, after {:.0} s.\n",
        start.elapsed().as_secs_f32()
    ))?;
    Ok(())
}

/// The app, and its screen: both sides, their captions, both enlarged.
struct Guide {
    headless: Headless,
    size: UVec2,
    scene: String,
    /// The scene's.
    own_fit: Option<CascadeFit>,
    captions: [Entity; 2],
    /// Enlarged pictures and marks, frames about where they are from.
    insets: [[Entity; 3]; 2],
}

impl Guide {
    fn new(size: UVec2) -> Self {
        let enlarged = size.y / 2;
        let screen = UVec2::new(2 * size.x, size.y + enlarged + LINE as u32);
        let mut headless = Headless::new(screen, |app| {
            app.add_plugins(ExplorerPlugin {
                screen: None,
                size,
                source: None,
            });
        });
        headless.step();
        let target = headless.render_target();
        let world = headless.app.world_mut();
        world.resource_mut::<TruthView>().hasty = true;
        let pictures = world.resource::<Pictures>().clone();
        let marks = world.resource::<TruthView>().marks.clone();
        let mut images = world.resource_mut::<Assets<Image>>();
        for handle in pictures.images.iter().chain(&marks) {
            if let Some(mut image) = images.get_mut(handle) {
                image.sampler = ImageSampler::nearest();
            }
        }
        let black = Camera {
            clear_color: Color::BLACK.into(),
            ..default()
        };
        let camera = world.spawn((Camera2d, black, target)).id();
        let root = world.spawn((Node::default(), UiTargetCamera(camera))).id();
        let (width, height) = (size.x as f32, size.y as f32);
        let captions = Side::BOTH.map(|side| {
            let left = px(width * side.index() as f32);
            let image = ImageNode::new(pictures.images[side.index()].clone());
            let place = placed(left, px(0), px(width), px(height));
            world.spawn((
                image.with_mode(NodeImageMode::Stretch),
                place,
                ChildOf(root),
            ));
            let place = Node {
                padding: UiRect::all(px(4)),
                ..placed(left, px(height), px(width), px(LINE))
            };
            let text = (Text::default(), TextFont::from_font_size(11.0));
            world.spawn((text, place, ChildOf(root))).id()
        });
        let insets = Side::BOTH.map(|side| {
            let left = px(width * side.index() as f32);
            let place = placed(left, px(height + LINE), px(width), px(enlarged as f32));
            [&pictures.images, &marks]
                .map(|images| {
                    let image = ImageNode::new(images[side.index()].clone());
                    let image = image.with_mode(NodeImageMode::Stretch);
                    world.spawn((image, place.clone(), ChildOf(root))).id()
                })
                .into_iter()
                .chain([{
                    let frame = (Node::default(), BorderColor::all(Color::WHITE));
                    world.spawn((frame, ChildOf(root))).id()
                }])
                .collect::<Vec<_>>()
                .try_into()
                .unwrap_or([root; 3])
        });
        Self {
            headless,
            size,
            scene: String::new(),
            own_fit: None,
            captions,
            insets,
        }
    }

    fn stop(&mut self, stop: &Stop, table: &mut String) -> Result<RgbaImage, BevyError> {
        self.go(stop)?;
        self.until(|world| world.resource::<Flight>().pose.is_none())?;
        self.set_fits(stop);
        let world = self.headless.app.world_mut();
        world.insert_resource(if stop.grids {
            ShadowOverlay::TexelGrid
        } else {
            ShadowOverlay::None
        });
        world.resource_mut::<TruthView>().on = !stop.grids;
        if !stop.grids {
            self.trace()?;
        }
        self.headless.settle();
        self.write(stop, table)?;
        let mut picture = self.headless.picture();
        if stop.grids {
            // Nothing is enlarged.
            let height = self.size.y + LINE as u32;
            picture = imageops::crop_imm(&picture, 0, 0, picture.width(), height).to_image();
        }
        Ok(picture)
    }

    /// Until figures are final. The pictures would only take time meanwhile.
    fn trace(&mut self) -> Result<(), BevyError> {
        let hold = |guide: &mut Self, held| {
            let world = guide.headless.app.world_mut();
            world.resource_mut::<Pictures>().held = held;
        };
        hold(self, true);
        let traced = self.until(|world| {
            let (truth, compare) = (world.resource::<TruthView>(), world.resource::<Compare>());
            if truth.progress < 1.0 {
                std::thread::sleep(BREATH);
            }
            truth.is_final(compare)
        });
        hold(self, false);
        traced
    }

    /// To a scene and a pose of it.
    fn go(&mut self, stop: &Stop) -> Result<(), BevyError> {
        let world = self.headless.app.world_mut();
        *world.resource_mut::<Compare>() = Compare {
            wipe: Some(0.5),
            edited: Side::Left,
            techniques: [stop.left.technique, stop.right.technique],
        };
        if self.scene != stop.scene {
            say(&format!("{}: loading\n", stop.scene))?;
            self.scene.clone_from(&stop.scene);
            self.own_fit = None;
            let mut opened = world.resource_mut::<Opened>();
            opened.open(Source::Shipped(stop.scene.clone()));
        }
        self.until(|world| {
            let mut suns = world.query_filtered::<(), (
                With<SideSun>,
                Or<(With<ParallelSplitShadows>, With<KeptShadows>)>,
            )>();
            world.resource::<CurrentScene>().spawned && suns.iter(world).count() == 2
        })?;
        let world = self.headless.app.world_mut();
        world.resource_mut::<Flight>().pose = Some(stop.pose);
        Ok(())
    }

    fn set_fits(&mut self, stop: &Stop) {
        let world = self.headless.app.world_mut();
        let mut suns = world.query::<(&SideSun, &mut ParallelSplitShadows)>();
        for (SideSun(side), mut shadows) in suns.iter_mut(world) {
            let shown = if *side == Side::Left {
                &stop.left
            } else {
                &stop.right
            };
            let own = self.own_fit.get_or_insert_with(|| shadows.fit.clone());
            let fit = shown.fit.as_ref().unwrap_or(own);
            if shadows.fit != *fit {
                shadows.fit = fit.clone();
            }
        }
    }

    fn until(&mut self, mut done: impl FnMut(&mut World) -> bool) -> Result<(), BevyError> {
        for _ in 0..MAX_STEPS {
            self.headless.step();
            let world = self.headless.app.world_mut();
            if let Some(message) = &world.resource::<Opened>().message {
                return Err(message.clone().into());
            }
            if done(world) {
                return Ok(());
            }
        }
        Err("The scene does not come to rest.".into())
    }

    /// Captions, insets, and a row of the table for each side.
    fn write(&mut self, stop: &Stop, table: &mut String) -> Result<(), BevyError> {
        let size = self.size;
        let world = self.headless.app.world_mut();
        let scenes = world.resource::<Assets<SceneDescription>>();
        let description = scenes.iter().map(|(_, scene)| scene);
        let title = world.resource::<Opened>().title.clone();
        let scene = description.into_iter().find(|scene| scene.title == title);
        let pose = scene.and_then(|scene| Some(scene.camera.poses.get(stop.pose)?.name.clone()));
        let pose = pose.unwrap_or_default();
        let (compare, truth) = (world.resource::<Compare>(), world.resource::<TruthView>());
        let region = most_different(truth, size);
        let texts = Side::BOTH.map(|side| {
            let shown = if side == Side::Left {
                &stop.left
            } else {
                &stop.right
            };
            let fit = shown.fit.as_ref();
            let fit = fit.map_or_else(String::new, |fit| format!(" ({fit:?})"));
            format!("{title}, {pose}\n{}{fit}", caption_of(side, compare, truth))
        });
        let figures = [0, 1].map(|side| truth.results[side].as_ref().map(|it| it.figures));
        let casters = casters_by_side(world);
        for side in Side::BOTH {
            let Some(figures) = figures[side.index()] else {
                continue;
            };
            let compare = world.resource::<Compare>();
            writeln!(
                table,
                "{:<16} {pose:<18} {:<30} {:>8.3} {:>8.3} {:>8.3} {:>8.3}  {}",
                stop.scene,
                format!("{:?}", compare.techniques[side.index()]),
                figures.wrong_pct,
                figures.acne_pct,
                figures.leak_pct,
                figures.stain_pct,
                casters[side.index()],
            )?;
        }
        for side in Side::BOTH {
            let i = side.index();
            if let Some(mut text) = world.get_mut::<Text>(self.captions[i]) {
                text.0.clone_from(&texts[i]);
            }
            let [picture, marks, frame] = self.insets[i];
            for image in [picture, marks] {
                if let Some(mut image) = world.get_mut::<ImageNode>(image) {
                    image.rect = region;
                }
                let shown = region.is_some();
                let display = if shown { Display::Flex } else { Display::None };
                if let Some(mut node) = world.get_mut::<Node>(image) {
                    node.display = display;
                }
            }
            if let (Some(region), Some(mut node)) = (region, world.get_mut::<Node>(frame)) {
                let left = px(region.min.x + (size.x * i as u32) as f32);
                let (width, height) = (px(region.width()), px(region.height()));
                *node = Node {
                    border: UiRect::all(px(1)),
                    ..placed(left, px(region.min.y), width, height)
                };
            } else if let Some(mut node) = world.get_mut::<Node>(frame) {
                node.display = Display::None;
            }
        }
        Ok(())
    }
}

fn placed(left: Val, top: Val, width: Val, height: Val) -> Node {
    Node {
        position_type: PositionType::Absolute,
        left,
        top,
        width,
        height,
        ..default()
    }
}

/// How many casters each cascade draws, left and right.
fn casters_by_side(world: &mut World) -> [String; 2] {
    let mut casters = [String::new(), String::new()];
    let mut suns = world.query::<(&SideSun, &CascadesVisibleEntities)>();
    for (SideSun(side), lists) in suns.iter(world) {
        let most = lists.entities.values().max_by_key(|lists| lists.len());
        let counts = most.into_iter().flatten().map(|list| list.entities.len());
        casters[side.index()] = counts.map(|count| format!("{count:>5}")).collect();
    }
    casters
}

/// Where one side has the most wrong pixels that the other has not (pixels).
fn most_different(truth: &TruthView, size: UVec2) -> Option<Rect> {
    let [Some(left), Some(right)] = &truth.results else {
        return None;
    };
    let inset = UVec2::new(size.x, size.y / 2) / (INSET_SHARE / 2);
    let wrong = |fault: &Fault| f32::from(u8::from(!matches!(fault, Fault::None)));
    let (width, height) = (size.x as usize, size.y as usize);
    // Sums over all that is above and to the left.
    let mut sums = vec![0.0; (width + 1) * (height + 1)];
    for y in 0..height {
        for x in 0..width {
            let at = y * width + x;
            let apart = wrong(&right.faults[at]) - wrong(&left.faults[at]);
            let i = (y + 1) * (width + 1) + x + 1;
            sums[i] = apart + sums[i - 1] + sums[i - width - 1] - sums[i - width - 2];
        }
    }
    let over = |x: usize, y: usize| {
        let (right, below) = (x + inset.x as usize, y + inset.y as usize);
        let sum = |x: usize, y: usize| -> f32 { sums[y * (width + 1) + x] };
        (sum(right, below) - sum(x, below) - sum(right, y) + sum(x, y)).abs()
    };
    let places = (0..=height - inset.y as usize).step_by(4).flat_map(|y| {
        (0..=width - inset.x as usize)
            .step_by(4)
            .map(move |x| (x, y))
    });
    let (x, y) = places.max_by(|a, b| over(a.0, a.1).total_cmp(&over(b.0, b.1)))?;
    let least = Vec2::new(x as f32, y as f32);
    Some(Rect::from_corners(least, least + inset.as_vec2()))
}

/// Progress on the terminal, at once.
fn say(text: &str) -> std::io::Result<()> {
    let mut out = stdout();
    out.write_all(text.as_bytes())?;
    out.flush()
}
