//! The example scenes: as large as they should be, nothing lost by culling, and shadows nearer
//! to the truth than Bevy's at equal texels.
//!
//! Figures are left in `target/test-figures/`.

use bevy::{
    camera::{
        primitives::{Aabb, CascadesFrusta},
        visibility::CascadesVisibleEntities,
    },
    core_pipeline::tonemapping::{DebandDither, Tonemapping},
    light::NotShadowCaster,
    math::Affine3A,
    pbr::DistanceFog,
    prelude::*,
};
use bevy_pssm::{ShadowPlans, prelude::*};
use image::RgbaImage;

use crate::{
    compare::{assert_identical, share_differing},
    scene::{SCENES, SceneEntity, ScenesPlugin, Stream},
    scene_stage::SceneStage,
    stage::take_turn,
    study::{
        accuracy::Figures,
        run::Effort,
        settings::{Setting, Stock},
        studio::{Stance, Studio, linear_camera, measurable_app},
        trace::Rays,
    },
};

/// Counts and area (m²) of each scene: Zhang et al. 2006, section 5.
const PAPER: [(&str, usize, f64, f32); 4] = [
    ("robot_war", 160, 220e3, 1.44e6),
    ("huge_chessboard", 32, 51e3, 0.49e6),
    ("knights", 60, 1e6, 1.6e6),
    ("mining_terrain", 55, 1.3e6, 2.56e6),
];

/// Of pictures that are compared to the bit (pixels).
const SMALL: UVec2 = UVec2::new(128, 96);
/// Random poses and suns per scene.
const POSES: usize = 50;
/// Of those, so many are walked from unless `PSSM_HOLD_POSES` says otherwise.
const WALKS: usize = 6;
/// Frames of each walk.
const STEPS: usize = 6;

/// A scene with nothing between light and picture: no tone mapping, no haze.
fn plain_stage(name: &str, size: UVec2) -> SceneStage {
    let camera = (Tonemapping::None, DebandDither::Disabled, Msaa::Off);
    let mut stage = SceneStage::new(name, size, |_| {}, camera);
    let camera = stage.camera;
    stage.world().entity_mut(camera).remove::<DistanceFog>();
    stage
}

fn write_figures(name: &str, lines: &[String]) {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/target/test-figures");
    std::fs::create_dir_all(folder)
        .and_then(|()| std::fs::write(format!("{folder}/{name}.csv"), lines.join("\n") + "\n"))
        .expect("figures can be written");
}

#[test]
fn scenes_are_as_large_as_the_papers() {
    let _turn = take_turn();
    assert_eq!(PAPER.map(|(name, ..)| name), SCENES);
    for (name, objects, triangles, area) in PAPER {
        let stage = plain_stage(name, UVec2::splat(64));
        let stats = stage.stats();
        assert_eq!(stats.objects, objects, "{name}");
        let ratio = stats.triangles as f64 / triangles;
        assert!(
            (0.97..=1.03).contains(&ratio),
            "{name} has {} triangles, {ratio:.3} of the paper's",
            stats.triangles
        );
        let side = stage.description.ground.size;
        assert!((side * side / area - 1.0).abs() < 0.01, "{name}: {side} m");
        let lens = &stage.description.camera;
        assert_eq!((lens.near, lens.fov_degrees), (1.0, 60.0), "{name}");
        let far = if name == "mining_terrain" {
            1000.0
        } else {
            800.0
        };
        assert_eq!(lens.far, far, "{name}");
    }
}

/// Houses look at the streets around their blocks, and none stands in one.
#[test]
fn the_town_has_streets() {
    // Between balconies (meters).
    const HALF_STREET: f32 = 3.5;
    let _turn = take_turn();
    let mut stage = plain_stage("town", UVec2::splat(64));
    assert_eq!(stage.stats().objects, 384 + 336 + 2 * 144);
    let world = stage.world();
    let mut objects = world.query_filtered::<(&Transform, &Aabb), With<SceneEntity>>();
    let houses = objects
        .iter(world)
        .filter(|(place, _)| place.scale.y >= 12.0);
    let mut count = 0;
    for (place, bounds) in houses {
        count += 1;
        // From the middle of the street that it looks at: streets lie 70 m and 54 m apart.
        let ahead = *place.forward();
        let (at, facing, pitch) = if ahead.x.abs() > 0.5 {
            (place.translation.x, ahead.x, 70.0)
        } else {
            (place.translation.z, ahead.z, 54.0)
        };
        let front = at * facing.signum() + place.scale.z * bounds.half_extents.z;
        let to_street = pitch - front.rem_euclid(pitch);
        assert!(
            (HALF_STREET..HALF_STREET + 2.0).contains(&to_street),
            "{place:?} {to_street}"
        );
    }
    assert_eq!(count, 384);
}

/// Somewhere over the inner half of the ground, looking about.
fn random_place(stage: &SceneStage, random: &mut Stream) -> Transform {
    let reach = 0.25 * stage.description.ground.size;
    let (x, z) = (random.between(-reach, reach), random.between(-reach, reach));
    let height = 1.5 + 60.0 * random.next().powi(3);
    let yaw = random.between(0.0, core::f32::consts::TAU);
    let pitch = random.between(-0.6, 0.15);
    Transform::from_xyz(x, stage.ground(x, z) + height, z).with_rotation(Quat::from_euler(
        EulerRot::YXZ,
        yaw,
        pitch,
        0.0,
    ))
}

fn random_sun(random: &mut Stream) -> Transform {
    let azimuth = random.between(0.0, core::f32::consts::TAU);
    let elevation = random.between(0.1, 1.5);
    Transform::from_rotation(Quat::from_euler(EulerRot::YXZ, azimuth, -elevation, 0.0))
}

/// Casters drawn: by hull culling, and how many meet the same maps' boxes, as Bevy would draw.
fn drawn_by_hull_and_box(stage: &mut SceneStage) -> [usize; 2] {
    let sun = stage.sun;
    let world = stage.world();
    let mut casters = world
        .query_filtered::<(&Aabb, &GlobalTransform), (With<Mesh3d>, Without<NotShadowCaster>)>();
    let casters: Vec<(Aabb, Affine3A)> = casters
        .iter(world)
        .map(|(aabb, transform)| (*aabb, transform.affine()))
        .collect();
    let hull = world
        .get::<CascadesVisibleEntities>(sun)
        .into_iter()
        .flat_map(|lists| lists.entities.values().flatten())
        .map(|list| list.entities.len())
        .sum();
    let boxes = world
        .get::<CascadesFrusta>(sun)
        .into_iter()
        .flat_map(|frusta| frusta.frusta.values().flatten())
        .map(|frustum| {
            casters
                .iter()
                .filter(|(aabb, affine)| frustum.intersects_obb(aabb, affine, false, true))
                .count()
        })
        .sum();
    [hull, boxes]
}

fn check_culling(name: &str) {
    let _turn = take_turn();
    let mut stage = plain_stage(name, SMALL);
    stage.configure(|shadows| shadows.map_size = MapSize::Same(512));
    stage.headless.settle();
    let mut random = Stream::new(7);
    let mut drawn = [0; 2];
    let mut shadowed = 0;
    for pose in 0..POSES {
        let (place, light) = (random_place(&stage, &mut random), random_sun(&mut random));
        stage.stand_at(place);
        let sun = stage.sun;
        stage.world().entity_mut(sun).insert(light);
        let mut picture = |culling| -> RgbaImage {
            stage.configure(|shadows| shadows.comparison.culling = culling);
            stage.headless.picture()
        };
        let off = picture(CasterCulling::Off);
        let hull = picture(CasterCulling::Hull);
        assert_identical(&format!("culling_{name}"), &hull, &off);
        for (sum, count) in drawn.iter_mut().zip(drawn_by_hull_and_box(&mut stage)) {
            *sum += count;
        }
        // That equal pictures mean something: some have shadows to lose.
        if pose % 10 == 0 {
            stage.set_shadow_maps(false);
            shadowed += usize::from(share_differing(&stage.headless.picture(), &hull, 12) > 0.002);
            stage.set_shadow_maps(true);
        }
    }
    let [hull, boxes] = drawn;
    let ratio = hull as f64 / boxes as f64;
    write_figures(
        &format!("culling_{name}"),
        &[
            "scene,poses,casters_hull,casters_box,ratio".to_owned(),
            format!("{name},{POSES},{hull},{boxes},{ratio:.3}"),
        ],
    );
    assert!(hull < boxes, "{name}: {hull} casters against {boxes}");
    assert!(
        shadowed >= 2,
        "{name}: only {shadowed} of 5 pictures show shadows"
    );
}

/// Pictures of walks from random poses, of which maps are drawn in how many frames.
fn walks(stage: &mut SceneStage, updates: MapUpdates, poses: usize) -> (Vec<RgbaImage>, usize) {
    let (camera, sun) = (stage.camera, stage.sun);
    stage.configure(|shadows| shadows.comparison.updates = updates);
    stage.headless.settle();
    let mut random = Stream::new(11);
    let mut pictures = Vec::new();
    let mut drawn = 0;
    for _ in 0..poses {
        let (mut place, light) = (random_place(stage, &mut random), random_sun(&mut random));
        stage.world().entity_mut(sun).insert(light);
        for _ in 0..STEPS {
            place.translation += 0.15 * *place.forward();
            place.rotate_y(0.01);
            stage.stand_at(place);
            stage.headless.step();
            let picture = RgbaImage::from_raw(SMALL.x, SMALL.y, stage.headless.read_back());
            pictures.push(picture.expect("a picture"));
            let plans = stage.world().get::<ShadowPlans>(sun).expect("a sun");
            let maps = plans.views[&camera]
                .iter()
                .filter_map(|plan| plan.map.as_ref());
            drawn += maps.filter(|map| map.redraw.is_some()).count();
        }
    }
    (pictures, drawn)
}

/// Where nothing but the camera moves, what is held is what would be drawn.
#[test]
fn held_pictures_of_all_scenes_are_those_of_maps_drawn_anew() {
    let _turn = take_turn();
    let poses = std::env::var("PSSM_HOLD_POSES").ok();
    let poses = poses.map_or(WALKS, |poses| poses.parse().expect("a number"));
    for name in SCENES {
        let mut stage = plain_stage(name, SMALL);
        stage.configure(|shadows| shadows.map_size = MapSize::Same(512));
        let (anew, every) = walks(&mut stage, MapUpdates::EveryFrame, poses);
        let (held, needed) = walks(&mut stage, MapUpdates::WhenNeeded, poses);
        for (frame, (held, anew)) in held.iter().zip(&anew).enumerate() {
            if held != anew {
                assert_identical(&format!("held_{name}_{frame}"), held, anew);
            }
        }
        assert!(needed < every / 2, "{name}: {needed} of {every} maps drawn");
    }
}

#[test]
fn culling_loses_nothing_in_robot_war() {
    check_culling("robot_war");
}

#[test]
fn culling_loses_nothing_in_huge_chessboard() {
    check_culling("huge_chessboard");
}

#[test]
fn culling_loses_nothing_in_knights() {
    check_culling("knights");
}

#[test]
fn culling_loses_nothing_in_mining_terrain() {
    check_culling("mining_terrain");
}

/// Bevy's best over the distances of each scene's preset, as `scripts/tradeoff` finds it: end of
/// the first cascade (meters) and normal bias, with a depth bias of 0.05.
const TUNED: [(f32, f32); 4] = [(60.0, 1.2), (100.0, 1.2), (35.0, 1.5), (60.0, 1.2)];

/// By rays, at equal cascades: fewer wrong pixels, fewer stains and less error than Bevy's own
/// shadows as they come and tuned to the scene; under a warp a third of the wrong pixels, and fewer
/// with a sixth of the texels.
#[test]
fn shadows_are_nearer_to_the_truth_than_bevys() {
    let _turn = take_turn();
    let size = UVec2::new(320, 240);
    let mut lines = vec!["scene,technique,wrong_pct,stain_pct,mae_pct".to_owned()];
    let mut failures = Vec::new();
    let warped = CascadeFit::Warped(MapWarp::Minimax);
    let sharp = CascadeFit::Auto { sharpness: 1.0 };
    for (name, (first_far, normal_bias)) in SCENES.into_iter().zip(TUNED) {
        let app = measurable_app(size, |app| {
            app.add_plugins(ScenesPlugin);
        });
        let stage = SceneStage::in_app(app, linear_camera(), |world, current| {
            current.load(name, world.resource::<AssetServer>());
        })
        .unwrap_or_else(|error| panic!("{name}: {error}"));
        let poses: Vec<Transform> = (0..2).map(|index| stage.pose(index)).collect();
        let world = stage.headless.app.world();
        let preset = world.get::<ParallelSplitShadows>(stage.sun);
        let preset = preset.cloned().expect("the sun has a preset");
        let mut studio = Studio::new(stage.headless, stage.camera, stage.sun, size);
        let stance = studio.stance();
        let stances = poses.into_iter().map(|camera| Stance {
            camera,
            ..stance.clone()
        });
        let stances: Vec<Stance> = stances.collect();
        let effort = Effort {
            rays: Rays::at_edges(2),
            flicker_poses: 0,
            steps: 0,
        };
        let views = studio.survey(&stances, effort, || ());
        let defaults = Stock::new(2048, &preset);
        let tuned = Stock {
            first_far,
            normal_bias,
            depth_bias: 0.05,
            ..defaults
        };
        let with = |fit, map_size| ParallelSplitShadows {
            near: preset.near,
            far: preset.far,
            fit,
            map_size: MapSize::Same(map_size),
            ..default()
        };
        let mut figures = |setting: Setting| {
            studio.apply(&setting);
            let figures = studio.figures(&views, || ());
            let Figures {
                wrong_pct,
                stain_pct,
                mae_pct,
                ..
            } = figures;
            let setting = setting.name;
            lines.push(format!(
                "{name},{setting},{wrong_pct:.3},{stain_pct:.3},{mae_pct:.3}"
            ));
            figures
        };
        let bevys = [("defaults", defaults), ("tuned", tuned)]
            .map(|(name, stock)| figures(Setting::bevy(name, stock)));
        // How many of Bevy's wrong pixels they may have.
        for (setting, config, share) in [
            ("steady", with(CascadeFit::Steady, 2048), 0.4),
            ("stable", with(CascadeFit::Stable, 2048), 1.0),
            ("tight", with(CascadeFit::Tight, 2048), 0.45),
            ("warped", with(warped.clone(), 2048), 1.0 / 3.0),
            ("warped 836", with(warped.clone(), 836), 1.0),
            ("faces", with(CascadeFit::Faces, 2048), 0.5),
            ("auto", with(sharp.clone(), 2048), 0.4),
        ] {
            let ours = figures(Setting::pssm(setting, config));
            let is_better = |other: &Figures| {
                ours.wrong_pct <= share * other.wrong_pct
                    && ours.stain_pct < other.stain_pct
                    && ours.mae_pct < other.mae_pct
            };
            if !bevys.iter().all(is_better) {
                failures.push(format!("{name} {setting}"));
            }
        }
    }
    write_figures("truth", &lines);
    assert!(failures.is_empty(), "{failures:?}: {lines:#?}");
}
