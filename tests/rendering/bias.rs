//! The automatic bias holds where biases fail, under any map and filter.

use bevy::prelude::*;
use bevy_pssm::prelude::*;

use crate::{
    stage::take_turn,
    study::{
        cases::{BiasFaults, Case, case_studio},
        run::{Effort, View},
        settings::Setting,
        studio::Studio,
    },
};

fn look(studio: &mut Studio) -> View {
    let effort = Effort {
        rays: 1,
        flicker_poses: 0,
        steps: 0,
    };
    let stance = studio.stance();
    studio.survey(&[stance], effort, || ()).remove(0)
}

/// Fits, sizes, radii and warps: each value with several of the others'.
fn variations() -> Vec<(ParallelSplitShadows, f64, f64)> {
    use CascadeFit::{Stable, Tight};
    [
        (Stable, 1024, 1.0, 0.0),
        (Stable, 1024, 2.65, 0.0),
        (Stable, 1024, 5.0, 0.0),
        (Stable, 256, 1.0, 0.0),
        (Stable, 256, 5.0, 0.0),
        (Stable, 4096, 2.65, 0.0),
        (Stable, 4096, 5.0, 0.0),
        (Tight, 1024, 2.65, 0.0),
        (Tight, 256, 5.0, 0.0),
        (Tight, 4096, 1.0, 0.0),
        (Stable, 1024, 2.65, 0.2),
        (Stable, 1024, 1.0, 1.0),
        (Stable, 1024, 5.0, 1.0),
        (Stable, 256, 2.65, 0.5),
        (Stable, 4096, 2.65, 1.0),
    ]
    .into_iter()
    .map(|(fit, size, radius, warp)| {
        let config = ParallelSplitShadows {
            far: 150.0,
            fit,
            map_size: MapSize::Same(size),
            filter: ShadowFilter::Tent(FilterRadius::Texels(radius)),
            ..default()
        };
        (config, radius, warp)
    })
    .collect()
}

fn keep(name: &str, view: &View, shares: &[Option<f32>], marks: &[bool]) {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/target/test-pictures");
    let size = view.truth.size();
    let picture = image::RgbImage::from_fn(size.x, size.y, |x, y| {
        let pixel = (y * size.x + x) as usize;
        let share = shares[pixel];
        let grey = share.map_or(90, |share| (share * 255.0) as u8);
        match (marks[pixel], share) {
            (true, _) => image::Rgb([255, 0, 0]),
            (false, None) => image::Rgb([70, 80, 110]),
            (false, Some(_)) => image::Rgb([grey; 3]),
        }
    });
    std::fs::create_dir_all(folder)
        .and_then(|()| {
            let file = format!("{folder}/bias_{name}.png");
            picture.save(file).map_err(std::io::Error::other)
        })
        .expect("pictures can be written");
}

/// No lit pixel lacks light: in percent of those that no shadow is near, at most `most`.
fn check(case: Case, most: f64) {
    let _turn = take_turn();
    let mut studio = case_studio(case);
    let view = look(&mut studio);
    let mut failures = Vec::new();
    for (config, radius, warp) in variations() {
        let name = format!(
            "{case:?}_{:?}_{:?}_{radius}_{warp}",
            config.fit, config.map_size
        );
        studio.warp(warp);
        studio.apply(&Setting::pssm(name.clone(), config));
        let shares = studio.shares(&view);
        let (found, marks) = studio.bias_faults(&view, &shares, radius);
        keep(&name, &view, &shares, &marks);
        let BiasFaults {
            stain_pct,
            gap_texels,
            ..
        } = found;
        if stain_pct > most || gap_texels > 1.5 {
            failures.push(format!("{name}: {found:?}"));
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// Within a texel of a wall that the sun grazes, a map cannot tell the wall from a caster.
const FEET: f64 = 0.02;

#[test]
fn slopes() {
    check(Case::Slopes, 0.0);
}

#[test]
fn balls() {
    check(Case::Balls, 0.0);
}

#[test]
fn waves() {
    check(Case::Waves, 0.0);
}

#[test]
fn walls() {
    check(Case::Walls, FEET);
}

#[test]
fn fences() {
    check(Case::Fences, FEET);
}

#[test]
fn contact() {
    check(Case::Contact, FEET);
}
