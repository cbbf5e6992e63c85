//! The explorer: widgets, keys and pointer, the wipe, the truth, and files that are not as they
//! should be.

use std::{
    path::{Path, PathBuf},
    sync::MutexGuard,
};

use bevy::{
    camera::RenderTarget,
    feathers::controls::OptionIndex,
    input::{
        ButtonState,
        keyboard::{Key, KeyboardInput},
    },
    picking::pointer::{Location, PointerAction, PointerButton, PointerId, PointerInput},
    prelude::*,
    render::render_resource::{TextureFormat, TextureUsages},
    ui::{Selected, UiGlobalTransform},
    ui_widgets::SliderValue,
    window::PrimaryWindow,
};
use bevy_pssm::prelude::*;
use image::RgbaImage;

use crate::{
    explore::{
        Compare, Control, ExplorerPlugin, Flight, Opened, Side, SideSun, Source, TruthView,
        WipeBar,
        settings::{self, Track, Value},
    },
    headless::Headless,
    scene::CurrentScene,
    scene_stage::SceneStage,
    stage::take_turn,
    study::{
        run::Effort,
        settings::{Setting, Stock},
        studio::{Studio, linear_camera, measurable_app},
        trace::Rays,
    },
    warnings,
};

const SCREEN: UVec2 = UVec2::new(960, 540);

/// The explorer on a screen of pixels.
struct Explorer {
    headless: Headless,
    window: Entity,
    target: RenderTarget,
    _turn: MutexGuard<'static, ()>,
}

impl Explorer {
    fn open(source: Source) -> Self {
        let turn = take_turn();
        let mut screen = None;
        let mut headless = Headless::new(SCREEN, |app| {
            let world = app.world_mut();
            let window = world.spawn((Window::default(), PrimaryWindow)).id();
            let format = TextureFormat::Rgba8UnormSrgb;
            let mut image = Image::new_target_texture(SCREEN.x, SCREEN.y, format, None);
            image.texture_descriptor.usage |= TextureUsages::COPY_SRC;
            let image = world.resource_mut::<Assets<Image>>().add(image);
            screen = Some((window, image.clone()));
            app.add_plugins(ExplorerPlugin {
                screen: Some(image.into()),
                size: SCREEN,
                source: Some(source),
            });
        });
        let (window, image) = screen.expect("the app was set up");
        headless.target = image;
        let target = headless.render_target();
        let mut explorer = Self {
            headless,
            window,
            target,
            _turn: turn,
        };
        explorer.headless.settle();
        explorer
    }

    fn world(&mut self) -> &mut World {
        self.headless.app.world_mut()
    }

    fn steps(&mut self, count: usize) {
        for _ in 0..count {
            self.headless.step();
        }
    }

    fn until(&mut self, what: &str, mut done: impl FnMut(&mut World) -> bool) {
        for _ in 0..4000 {
            self.headless.step();
            if done(self.world()) {
                return;
            }
        }
        panic!("never {what}");
    }

    /// Until the scene and its settings are there.
    fn settle(&mut self) {
        self.until("set up", |world| {
            let mut suns = world.query::<(&SideSun, &ParallelSplitShadows)>();
            world.resource::<CurrentScene>().spawned
                && suns.iter(world).any(|(sun, _)| sun.0 == Side::Left)
        });
        self.headless.settle();
    }

    fn press(&mut self, key_code: KeyCode, logical_key: &Key) {
        let window = self.window;
        for state in [ButtonState::Pressed, ButtonState::Released] {
            self.world().write_message(KeyboardInput {
                key_code,
                logical_key: logical_key.clone(),
                state,
                text: None,
                repeat: false,
                window,
            });
            self.headless.step();
        }
        self.steps(2);
    }

    fn letter(&mut self, key_code: KeyCode) {
        self.press(
            key_code,
            &Key::Unidentified(bevy::input::keyboard::NativeKey::Unidentified),
        );
    }

    fn point(&mut self, position: Vec2, action: PointerAction) {
        let target = self
            .target
            .normalize(None)
            .expect("an image needs no window");
        let location = Location { target, position };
        self.world()
            .write_message(PointerInput::new(PointerId::Mouse, location, action));
        self.headless.step();
    }

    fn drag(&mut self, from: Vec2, to: Vec2) {
        self.point(from, PointerAction::Move { delta: Vec2::ONE });
        self.point(from, PointerAction::Press(PointerButton::Primary));
        // In two steps: what is dragged must outlast the first.
        let delta = 0.5 * (to - from);
        self.point(from + delta, PointerAction::Move { delta });
        self.point(to, PointerAction::Move { delta });
        self.point(to, PointerAction::Release(PointerButton::Primary));
        self.steps(2);
    }

    /// Where a widget is, and how large (pixels).
    fn place(&mut self, entity: Entity) -> (Vec2, Vec2) {
        let world = self.world();
        let center = world
            .get::<UiGlobalTransform>(entity)
            .expect("it is laid out");
        let size = world.get::<ComputedNode>(entity).expect("it is laid out");
        (center.translation, size.size())
    }

    fn widget(&mut self, control: &Control) -> Entity {
        let world = self.world();
        let mut widgets = world.query::<(Entity, &Control)>();
        let found = widgets.iter(world).find(|(_, it)| *it == control);
        found
            .unwrap_or_else(|| panic!("no widget for {control:?}"))
            .0
    }

    fn shadows(&mut self) -> ParallelSplitShadows {
        let world = self.world();
        let mut suns = world.query::<(&SideSun, &ParallelSplitShadows)>();
        let left = suns.iter(world).find(|(sun, _)| sun.0 == Side::Left);
        left.expect("the left side has settings").1.clone()
    }

    fn picture(&mut self, name: &str) -> RgbaImage {
        let picture = self.headless.picture();
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/target/test-pictures/explorer");
        std::fs::create_dir_all(folder).expect("pictures can be written");
        picture
            .save(format!("{folder}/{name}.png"))
            .expect("pictures can be written");
        picture
    }
}

fn setting(path: &str) -> Control {
    Control::Setting(path.into())
}

/// Pixels of the picture's area in which two screens differ.
fn changed(a: &RgbaImage, b: &RgbaImage) -> usize {
    let pixels = a.enumerate_pixels().zip(b.pixels());
    pixels
        .filter(|((x, ..), _)| *x > 340)
        .filter(|((_, _, a), b)| a != b)
        .count()
}

#[test]
fn widgets_and_settings_never_disagree() {
    let mut explorer = Explorer::open(Source::Shipped("robot_war".into()));
    explorer.settle();
    explorer.picture("panel");

    // By the pointer.
    let slider = explorer.widget(&setting(".far"));
    explorer
        .world()
        .trigger(bevy::ui_widgets::ScrollIntoView { entity: slider });
    explorer.steps(3);
    let (center, size) = explorer.place(slider);
    let before = explorer.shadows().far;
    let to = center + Vec2::new(-0.3 * size.x, 0.0);
    explorer.drag(center, to);
    let far = explorer.shadows().far;
    // From the middle of four magnitudes and more to a fifth of the way.
    assert!(far < 0.5 && far > 0.1, "{before} became {far}");

    // By the program.
    let value = |explorer: &mut Explorer| {
        let slider = explorer.widget(&setting(".far"));
        explorer
            .world()
            .get::<SliderValue>(slider)
            .expect("a slider")
            .0
    };
    let near_by = value(&mut explorer);
    let world = explorer.world();
    for mut shadows in world.query::<&mut ParallelSplitShadows>().iter_mut(world) {
        shadows.far = 700.0;
    }
    explorer.steps(2);
    assert!(value(&mut explorer) > near_by + 0.05);

    // By a file that changes.
    let presets = explorer.world().resource::<AssetServer>().clone();
    let preset: Handle<ParallelSplitShadows> = presets.load("shadows/fast.shadows.ron");
    let world = explorer.world();
    let mut suns = world.query_filtered::<Entity, With<SideSun>>();
    let suns: Vec<Entity> = suns.iter(world).collect();
    for sun in suns {
        world.entity_mut(sun).insert(ShadowPreset(preset.clone()));
    }
    explorer.until("in force", |world| {
        let mut shadows = world.query::<&ParallelSplitShadows>();
        shadows.iter(world).any(|shadows| shadows.cascades == 3)
    });
    explorer.steps(3);
    let chosen = explorer.widget(&Control::Preset);
    let world = explorer.world();
    let mut rows = world.query_filtered::<(Entity, &OptionIndex), With<Selected>>();
    let rows: Vec<Entity> = rows.iter(world).map(|(row, _)| row).collect();
    let parents = |world: &World, mut entity: Entity| {
        let mut path = Vec::new();
        while let Some(parent) = world.get::<ChildOf>(entity) {
            entity = parent.parent();
            path.push(entity);
        }
        path
    };
    assert!(
        rows.iter()
            .any(|row| parents(world, *row).contains(&chosen)),
        "the preset's name is not selected"
    );
    let mut presets = world.resource_mut::<Assets<ParallelSplitShadows>>();
    presets.get_mut(&preset).expect("it is loaded").blend = 0.4;
    explorer.steps(3);
    assert_eq!(explorer.shadows().blend, 0.4);
    let slider = explorer.widget(&setting(".blend"));
    let shown = explorer
        .world()
        .get::<SliderValue>(slider)
        .expect("a slider")
        .0;
    assert!((shown - 0.8).abs() < 1e-3, "{shown}");

    // By keys: the fit, which has further fields in some of its forms.
    let world = explorer.world();
    for mut shadows in world.query::<&mut ParallelSplitShadows>().iter_mut(world) {
        shadows.cascades = 4;
    }
    let fit = explorer.shadows().fit;
    explorer.letter(KeyCode::KeyI);
    assert_ne!(explorer.shadows().fit, fit);
    for _ in 0..7 {
        explorer.letter(KeyCode::KeyI);
        let shadows = explorer.shadows();
        assert_eq!(shadows.validate(16384), Ok(()), "{:?}", shadows.fit);
    }

    // By Tab and arrows.
    explorer.press(KeyCode::Tab, &Key::Tab);
    let focused = explorer
        .world()
        .resource::<bevy::input_focus::InputFocus>()
        .get();
    assert!(focused.is_some());
    let slider = explorer.widget(&setting(".blend"));
    let world = explorer.world();
    let mut focus = world.resource_mut::<bevy::input_focus::InputFocus>();
    focus.set(slider, bevy::input_focus::FocusCause::Navigated);
    let before = explorer.shadows().blend;
    explorer.press(KeyCode::ArrowLeft, &Key::ArrowLeft);
    assert!(explorer.shadows().blend < before);
    explorer.picture("panel_scrolled");

    // At twice the size all of a line is still within the panel.
    explorer.world().insert_resource(UiScale(2.0));
    explorer.steps(4);
    explorer.picture("panel_twice");
    let slider = explorer.widget(&setting(".blend"));
    let (center, size) = explorer.place(slider);
    assert!(size.x > 100.0 && center.x + 0.5 * size.x < 0.55 * SCREEN.x as f32);
}

#[test]
fn every_field_has_a_row_and_every_choice_holds() {
    let defaults = ParallelSplitShadows::default();
    let rows = settings::rows(&defaults);
    // The names of all fields, by another way.
    let text = ron::to_string(&defaults).expect("settings can be written");
    let names = text
        .split(['(', ','])
        .filter_map(|part| Some(part.split_once(':')?.0));
    for name in names.filter(|name| *name != "comparison") {
        let label = name.replace('_', " ");
        assert!(
            rows.iter().any(|row| row.label == label),
            "{name} has no row"
        );
    }
    let mut forms = 0;
    for row in &rows {
        let Value::Choice { names, .. } = &row.value else {
            continue;
        };
        for chosen in 0..names.len() {
            let mut shadows = defaults.clone();
            settings::choose(&mut shadows, &row.path, chosen);
            assert_eq!(
                shadows.validate(16384),
                Ok(()),
                "{}: {}",
                row.path,
                names[chosen]
            );
            // What depends on the choice can be set, to either end of its slider.
            for inner in settings::rows(&shadows) {
                let Value::Number { range, whole, .. } = &inner.value else {
                    continue;
                };
                if !inner.path.starts_with(&row.path) {
                    continue;
                }
                let track = Track::new(range.as_ref(), *whole);
                for position in [0.0, 0.5, 1.0] {
                    let value = track.value(position);
                    settings::set_number(&mut shadows, &inner.path, value);
                    // Few whole numbers lie far apart.
                    let off = (track.position(value) - position).abs();
                    let nearest = if *whole { 0.501 * track.step() } else { 0.0 };
                    assert!(off < nearest.max(0.02), "{}", inner.path);
                }
                forms += 1;
            }
            settings::reset(&mut shadows, &row.path);
            assert!(settings::is_default(&shadows, &row.path), "{}", row.path);
        }
    }
    assert!(forms > 20, "{forms}");
}

#[test]
fn views_follow_keys_and_pointer() {
    let mut explorer = Explorer::open(Source::Shipped("robot_war".into()));
    explorer.settle();
    let plain = explorer.picture("plain");

    explorer.letter(KeyCode::KeyT);
    let overlay = explorer.picture("overlay");
    assert!(changed(&plain, &overlay) > 10_000);
    for _ in 0..7 {
        explorer.letter(KeyCode::KeyT);
    }

    explorer.letter(KeyCode::KeyL);
    explorer.steps(3);
    let maps = explorer.picture("maps");
    assert!(changed(&plain, &maps) > 10_000);
    explorer.letter(KeyCode::KeyL);

    explorer.letter(KeyCode::KeyF);
    explorer.steps(2);
    let frozen = explorer.picture("frozen");
    assert!(changed(&plain, &frozen) > 1000);
    explorer.letter(KeyCode::KeyF);

    // Both sides of the wipe, which follows the pointer.
    explorer.letter(KeyCode::KeyV);
    explorer.headless.settle();
    let half = explorer.picture("wipe");
    assert!(changed(&plain, &half) > 500);
    let world = explorer.world();
    let mut bars = world.query_filtered::<Entity, With<WipeBar>>();
    let bar = bars.single(world).expect("one bar");
    let (center, _) = explorer.place(bar);
    explorer.drag(center, center - Vec2::new(200.0, 0.0));
    let wipe = explorer.world().resource::<Compare>().wipe;
    assert!(wipe.is_some_and(|wipe| wipe < 0.3), "{wipe:?}");
    let moved = explorer.picture("wipe_moved");
    assert!(changed(&half, &moved) > 500);
}

/// The report's figures, of the plugin's shadows and of Bevy's own.
fn reported(size: UVec2) -> [f64; 2] {
    let _turn = take_turn();
    let headless = measurable_app(size, |app| {
        app.add_plugins(crate::scene::ScenesPlugin);
    });
    let stage = SceneStage::in_app(headless, linear_camera(), |world, current| {
        current.load("robot_war", world.resource::<AssetServer>());
    });
    let mut stage = stage.expect("the scene loads");
    stage.stand_at_pose(0);
    let (camera, sun) = (stage.camera, stage.sun);
    let shadows = stage.world().get::<ParallelSplitShadows>(sun).cloned();
    let shadows = shadows.expect("it has its preset");
    let mut studio = Studio::new(stage.headless, camera, sun, size);
    studio.headless.settle();
    let effort = Effort {
        rays: Rays::at_edges(1),
        flicker_poses: 0,
        steps: 0,
    };
    let stance = studio.stance();
    let views = studio.survey(&[stance], effort, || ());
    let stock = Stock::new(2048, &shadows);
    [Setting::pssm("", shadows), Setting::bevy("", stock)].map(|setting| {
        studio.apply(&setting);
        studio.headless.settle();
        studio.figures(&views, || ()).wrong_pct
    })
}

#[test]
fn truth_is_the_reports() {
    let mut explorer = Explorer::open(Source::Shipped("robot_war".into()));
    explorer.settle();
    explorer.letter(KeyCode::KeyV);
    explorer.letter(KeyCode::KeyR);
    explorer.until("traced", |world| {
        let (truth, compare) = (world.resource::<TruthView>(), world.resource::<Compare>());
        truth.is_final(compare)
    });
    explorer.picture("truth");
    let truth = explorer.world().resource::<TruthView>();
    let shown = [0, 1].map(|side| truth.results[side].as_ref().map(|it| it.figures.wrong_pct));
    let size = explorer.world().resource::<crate::explore::Pictures>().size;

    // A camera that moves has no figures until it rests.
    explorer.world().resource_mut::<Flight>().pose = Some(1);
    explorer.steps(3);
    assert!(explorer.world().resource::<TruthView>().results[0].is_none());
    explorer.until("traced again", |world| {
        let (truth, compare) = (world.resource::<TruthView>(), world.resource::<Compare>());
        truth.is_final(compare)
    });
    drop(explorer);
    let reported = reported(size);
    for (side, reported) in reported.into_iter().enumerate() {
        let shown = shown[side].expect("both sides are traced");
        assert!(
            (shown - reported).abs() < 1e-6,
            "side {side} shows {shown} % wrong where the report has {reported} %"
        );
    }
}

fn file(name: &str, content: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/test-pictures/explorer");
    std::fs::create_dir_all(&folder).expect("files can be written");
    let file = folder.join(name);
    std::fs::write(&file, content).expect("files can be written");
    file
}

#[test]
fn odd_files_are_spoken_of() {
    let pillars = include_str!("../../assets/models/pillars.gltf");
    let broken = file("broken.gltf", &pillars[..pillars.len() / 2]);
    let empty = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"name":"nothing"}]}"#;
    let empty = file("empty.gltf", empty);
    let lights: String = (0..1000)
        .map(|_| r#",{"extensions":{"KHR_lights_punctual":{"light":0}}}"#)
        .collect();
    let numbers: String = (8..1008).map(|node| format!("{node},")).collect();
    let crowded = pillars
        .replacen(
            "\"scene\": 0,",
            r#""extensionsUsed":["KHR_lights_punctual"],"extensions":{"KHR_lights_punctual":{"lights":[{"type":"directional","intensity":1000}]}},"scene":0,"#,
            1,
        )
        .replacen("    0,\n", &format!("    {numbers}0,\n"), 1)
        .replacen(" ],\n \"meshes\"", &format!("{lights} ],\n \"meshes\""), 1);
    let crowded = file("crowded.gltf", &crowded);
    let plain = file("plain.gltf", pillars);

    let mut explorer = Explorer::open(Source::Gltf(plain));
    let says = |explorer: &mut Explorer, what: &str| {
        explorer.until(what, |world| {
            let message = &world.resource::<Opened>().message;
            message
                .as_ref()
                .is_some_and(|message| message.contains(what))
        });
        explorer.steps(3);
    };
    says(&mut explorer, "a sun was added");
    explorer.headless.settle();
    let pillars = explorer.picture("gltf");

    let open = |explorer: &mut Explorer, file: PathBuf| {
        explorer
            .world()
            .resource_mut::<Opened>()
            .open(Source::Gltf(file));
    };
    // What stood there stays.
    open(&mut explorer, broken);
    says(&mut explorer, "cannot be shown");
    explorer.world().resource_mut::<Opened>().message = None;
    explorer.steps(3);
    let world = explorer.world();
    assert!(world.query::<&Mesh3d>().iter(world).count() >= 8);

    open(&mut explorer, empty);
    says(&mut explorer, "no meshes");
    open(&mut explorer, crowded);
    says(&mut explorer, "1000 directional lights");
    explorer.headless.settle();
    let crowded = explorer.picture("gltf_crowded");
    assert!(changed(&pillars, &crowded) > 0);
    // Its sun is among those that shine.
    let world = explorer.world();
    for mut light in world
        .query::<(&mut DirectionalLight, &SideSun)>()
        .iter_mut(world)
    {
        light.0.illuminance = 0.0;
    }
    explorer.headless.settle();
    let without = explorer.picture("gltf_without_sun");
    assert!(changed(&crowded, &without) > 1000);
    let world = explorer.world();
    assert_eq!(world.query::<&SideSun>().iter(world).count(), 2);
    let _ = warnings::take();
}
