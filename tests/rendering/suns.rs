//! Suns that move, rise and set.

use bevy::prelude::*;
use bevy_pssm::prelude::*;
use image::RgbaImage;

use crate::{
    compare::{assert_identical, save, share_differing},
    stage::{Stage, shadows},
};

/// How the sun stands, from east to west (degrees).
fn at_elevation(degrees: f32) -> Transform {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let to_sun = Vec3::new(cos, sin, 0.0);
    Transform::default().looking_to(-to_sun, Vec3::Z)
}

fn place(stage: &mut Stage, sun: Entity, at: Transform) -> RgbaImage {
    *stage
        .world()
        .get_mut::<Transform>(sun)
        .expect("a light has one") = at;
    stage.step();
    stage.last_picture()
}

/// A tenth of a degree moves shadows of what is four meters high by less than a centimeter.
#[test]
fn nothing_jumps_in_the_zenith() {
    for fit in [CascadeFit::Steady, CascadeFit::Stable, CascadeFit::Tight] {
        for (grid, sun_step) in [
            (TexelGrid::Light, 0.0),
            (TexelGrid::Light, 0.05),
            (TexelGrid::Ground, 0.0),
        ] {
            let mut stage = Stage::new();
            let sun = stage.sun();
            let config = ParallelSplitShadows {
                fit: fit.clone(),
                grid,
                sun_step,
                ..shadows()
            };
            stage.world().entity_mut(sun).insert(config);
            stage.camera();
            place(&mut stage, sun, at_elevation(89.8));
            stage.headless.settle();
            let mut last = stage.last_picture();
            for degrees in [89.9, 89.95, 90.0, 90.05, 90.1] {
                let now = place(&mut stage, sun, at_elevation(degrees));
                let differing = share_differing(&now, &last, 12);
                let name = format!("zenith_{fit:?}_{grid:?}_{degrees}");
                save(&name, &now, &last);
                assert!(differing < 0.002, "{name}, {sun_step}: {differing}");
                last = now;
            }
        }
    }
}

/// A sun sets and a moon rises: no frame misses a shadow of either.
#[test]
fn suns_hand_over() {
    let mut stage = Stage::new();
    let lights = [stage.sun(), stage.sun()];
    for light in lights {
        stage.world().entity_mut(light).insert(shadows());
    }
    *stage
        .world()
        .get_mut::<Transform>(lights[1])
        .expect("a light has one") = at_elevation(40.0);
    stage.camera();
    let full = stage
        .world()
        .get::<DirectionalLight>(lights[0])
        .expect("a light")
        .illuminance;
    let mut show = |shares: [f32; 2]| {
        for (light, share) in lights.into_iter().zip(shares) {
            let mut light = stage.world().get_mut::<DirectionalLight>(light);
            light.as_mut().expect("a light").illuminance = share * full;
        }
        stage.step();
        let first = stage.last_picture();
        for _ in 0..4 {
            stage.step();
        }
        [first, stage.last_picture()]
    };
    // All pipelines are there.
    for _ in 0..4 {
        show([1.0, 0.5]);
    }
    for (index, shares) in [
        [1.0, 0.0],
        [0.5, 0.0],
        [0.25, 0.1],
        [0.0, 0.1],
        [0.0, 0.5],
        [0.3, 0.5],
    ]
    .into_iter()
    .enumerate()
    {
        let [first, settled] = show(shares);
        assert_identical(&format!("hand_over_{index}"), &first, &settled);
    }
}
