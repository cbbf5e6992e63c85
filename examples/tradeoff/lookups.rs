//! What lookups trade, apart from scenes: biases in the cases that they fail in, and what filters
//! cost the main pass.

use core::fmt::Write;

use bevy::{light::ShadowFilteringMethod, prelude::*};
use bevy_pssm::prelude::*;

use crate::study::{
    cases::{Case, bevys_studio, case_studio, defer},
    faults::BiasFaults,
    run::{Effort, View},
    settings::{Setting, Stock},
    studio::Studio,
};

/// Texels per side of all maps: several, for edges fall on texels by chance.
const MAP_SIZES: [u32; 4] = [1024, 1008, 992, 976];
/// Bevy's filters, and how far they read (texels).
const FILTERS: [(ShadowFilteringMethod, f64); 3] = [
    (ShadowFilteringMethod::Hardware2x2, 1.0),
    (ShadowFilteringMethod::Gaussian, 2.65),
    (ShadowFilteringMethod::Temporal, 2.0),
];

/// What is searched for Bevy's best: texels and meters.
const NORMAL_BIASES: [f32; 8] = [0.0, 0.6, 1.2, 1.8, 2.4, 3.6, 5.0, 8.0];
const DEPTH_BIASES: [f32; 6] = [0.0, 0.02, 0.05, 0.1, 0.2, 0.5];

/// Frames that are timed in a row, and how often.
const TIMED_FRAMES: usize = 9;
const TURNS: usize = 3;

/// Bevy's, as they come, but for the range.
fn stock(case: Case, map_size: u32) -> Stock {
    let [near, far] = case.range();
    let config = ParallelSplitShadows {
        near,
        far,
        ..default()
    };
    let stock = Stock::new(map_size, &config);
    Stock {
        first_far: stock.first_far.min(far / 15.0),
        ..stock
    }
}

/// The same cascades for the plugin.
fn config(case: Case, map_size: u32) -> ParallelSplitShadows {
    let [near, far] = case.range();
    let bounds = stock(case, map_size).cascades().bounds;
    ParallelSplitShadows {
        near,
        far,
        splits: SplitScheme::Manual(bounds[..3].to_vec()),
        map_size: MapSize::Same(map_size),
        ..default()
    }
}

/// The same with the least bias that planes need, and none for walls and bends.
fn plane_alone(case: Case, map_size: u32) -> ParallelSplitShadows {
    let mut config = config(case, map_size);
    config.comparison.bias = ShadowBias::ReceiverPlane { meters: 0.0 };
    config
}

/// All tables; Bevy's best is searched for unless it is `quick`. `done` is called after each case.
pub fn report(quick: bool, mut done: impl FnMut(&str)) -> String {
    let mut text = "# Lookups: biases and filters\n\n".to_owned();
    text += &biases(quick, &mut done);
    text += &terminators(&mut done);
    text += &costs(&mut done);
    text
}

fn look(studio: &mut Studio, case: Case) -> View {
    let effort = Effort {
        rays: case.rays(),
        flicker_poses: 0,
        steps: 0,
    };
    let stance = studio.stance();
    studio.survey(&[stance], effort, || ()).remove(0)
}

fn faults(studio: &mut Studio, view: &View, setting: &Setting, reach: f64) -> BiasFaults {
    studio.apply(setting);
    let shares = studio.shares(view);
    studio.bias_faults(view, &shares, reach).0
}

/// The mean over all sizes of maps.
fn mean_faults(
    studio: &mut Studio,
    view: &View,
    setting: impl Fn(u32) -> Setting,
    reach: f64,
) -> BiasFaults {
    let found = MAP_SIZES.map(|size| faults(studio, view, &setting(size), reach));
    let mean = |value: fn(&BiasFaults) -> f64| {
        found.iter().map(value).sum::<f64>() / MAP_SIZES.len() as f64
    };
    BiasFaults {
        stain_pct: mean(|it| it.stain_pct),
        leak_pct: mean(|it| it.leak_pct),
        gap_texels: mean(|it| it.gap_texels),
    }
}

fn biases(quick: bool, done: &mut impl FnMut(&str)) -> String {
    let mut text = "## Biases\n\n\
        Stain: lit pixels that lack a tenth of the light although no shadow is near. Leak: \
        shadowed pixels that get more than half of it. Percent of the lit and of the shadowed. \
        Bevy's best has the fewest leaks of those that do not stain, or else stains least: normal \
        bias (texels), depth bias (meters).\n\n\
        | case | filter | automatic: stain | leak | planes alone: leak | Bevy, defaults: stain | leak | Bevy, best: stain | leak | its biases |\n\
        |---|---|---:|---:|---:|---:|---:|---:|---:|---|\n"
        .to_owned();
    for case in Case::ALL {
        done(&format!("{case:?}"));
        let mut studio = case_studio(case);
        let view = look(&mut studio, case);
        for (filter, reach) in FILTERS {
            let camera = studio.camera;
            studio.world().entity_mut(camera).insert(filter);
            let mut mean =
                |setting: &dyn Fn(u32) -> Setting| mean_faults(&mut studio, &view, setting, reach);
            let ours = mean(&|size| Setting::pssm("", config(case, size)));
            let plane = mean(&|size| Setting::pssm("", plane_alone(case, size)));
            let defaults = mean(&|size| Setting::bevy("", stock(case, size)));
            let mut best: Option<(BiasFaults, f32, f32)> = None;
            let normal_biases = if quick {
                &NORMAL_BIASES[..1]
            } else {
                &NORMAL_BIASES
            };
            let depth_biases = if quick {
                &DEPTH_BIASES[4..5]
            } else {
                &DEPTH_BIASES
            };
            for &normal_bias in normal_biases {
                for depth_bias in depth_biases {
                    let depth_bias = depth_bias * case.range()[1] / Case::Waves.range()[1];
                    let tried = Stock {
                        normal_bias,
                        depth_bias,
                        ..stock(case, MAP_SIZES[0])
                    };
                    let found = faults(&mut studio, &view, &Setting::bevy("", tried), reach);
                    let key = |faults: &BiasFaults| (faults.stain_pct, faults.leak_pct);
                    if best.is_none_or(|(best, ..)| key(&found) < key(&best)) {
                        best = Some((found, normal_bias, depth_bias));
                    }
                }
            }
            let Some((_, normal_bias, depth_bias)) = best else {
                continue;
            };
            let tuned = |size| {
                let biases = Stock {
                    normal_bias,
                    depth_bias,
                    ..stock(case, size)
                };
                Setting::bevy("", biases)
            };
            let best = mean_faults(&mut studio, &view, tuned, reach);
            let _ = writeln!(
                text,
                "| {case:?} | {filter:?} | {:.3} | {:.2} | {:.2} | {:.3} | {:.2} | {:.3} | {:.2} | {normal_bias}, {depth_bias} |",
                ours.stain_pct,
                ours.leak_pct,
                plane.leak_pct,
                defaults.stain_pct,
                defaults.leak_pct,
                best.stain_pct,
                best.leak_pct,
            );
        }
    }
    text + "\n"
}

fn terminators(done: &mut impl FnMut(&str)) -> String {
    let mut text = "## Where light runs out on smooth-shaded meshes\n\n\
        Pixels near there that the sun shines on, as rays from the surface that the shading means say, \
        and that get less than half of its light: percent, with maps of 1024² and 4096².\n\n\
        | case | shading | automatic: 1024² | 4096² | Bevy, defaults: 1024² | 4096² |\n\
        |---|---|---:|---:|---:|---:|\n"
        .to_owned();
    for (case, is_deferred) in Case::SMOOTH
        .into_iter()
        .flat_map(|it| [(it, false), (it, true)])
    {
        let shading = if is_deferred { "deferred" } else { "forward" };
        done(&format!("where light runs out, {case:?}, {shading}"));
        let mut studio = case_studio(case);
        if is_deferred {
            defer(&mut studio);
        }
        let view = look(&mut studio, case);
        let mut dark = |setting: Setting| {
            studio.apply(&setting);
            let shares = studio.shares(&view);
            studio.terminator_faults(&view, &shares).0
        };
        let sizes = [1024, 4096];
        let ours = sizes.map(|size| dark(Setting::pssm("", config(case, size))));
        let bevys = sizes.map(|size| dark(Setting::bevy("", stock(case, size))));
        let _ = writeln!(
            text,
            "| {case:?} | {shading} | {:.2} | {:.2} | {:.2} | {:.2} |",
            ours[0], ours[1], bevys[0], bevys[1]
        );
    }
    text + "\n"
}

fn costs(done: &mut impl FnMut(&str)) -> String {
    let mut text = "## What lookups cost the main pass\n\n\
        Its time on the GPU, over Bevy's with the same filter, the least of frames taken in turn: where \
        all is lit (waves), and with shadows (balls). Bevy's, in an app without the plugin.\n\n\
        | filter | waves | balls |\n|---|---:|---:|\n"
        .to_owned();
    let cases = [Case::Waves, Case::Balls];
    let mut studios = cases.map(|case| {
        done(&format!("times, {case:?}"));
        let mut studio = case_studio(case);
        studio.headless.settle();
        studio
    });
    // Apart, where the shader holds nothing of the plugin's.
    let mut bevys = cases.map(|case| {
        let mut studio = bevys_studio(case);
        studio.headless.settle();
        studio
    });
    for (filter, _) in FILTERS {
        let mut ratios = [0.0; 2];
        for ((studio, bevys), ratio) in studios.iter_mut().zip(&mut bevys).zip(&mut ratios) {
            for studio in [&mut *studio, &mut *bevys] {
                let camera = studio.camera;
                studio.world().entity_mut(camera).insert(filter);
            }
            studio.apply(&Setting::pssm("", config(cases[0], MAP_SIZES[0])));
            bevys.apply(&Setting::bevy("", stock(cases[0], MAP_SIZES[0])));
            *ratio = quotient(|own| times(if own { &mut *studio } else { &mut *bevys }));
        }
        let _ = writeln!(text, "| {filter:?} | {:.2} | {:.2} |", ratios[0], ratios[1]);
    }
    text += "\nThe same over the plugin's own default, which is Bevy's Gaussian in width:\n\n\
        | setting | waves | balls |\n|---|---:|---:|\n";
    for studio in &mut studios {
        let camera = studio.camera;
        studio
            .world()
            .entity_mut(camera)
            .insert(ShadowFilteringMethod::Gaussian);
    }
    let with = |change: &dyn Fn(&mut ParallelSplitShadows)| {
        let mut config = config(cases[0], MAP_SIZES[0]);
        change(&mut config);
        config
    };
    let tent = |texels| ShadowFilter::Tent(FilterRadius::Texels(texels));
    let others = [
        (
            "2×2",
            with(&|config| config.filter = ShadowFilter::Hardware2x2),
        ),
        (
            "tent of 4 texels",
            with(&|config| config.filter = tent(4.0)),
        ),
        (
            "tent of 8 texels",
            with(&|config| config.filter = tent(8.0)),
        ),
        (
            "soft",
            with(&|config| config.filter = ShadowFilter::Soft { sun_degrees: 0.53 }),
        ),
        (
            "normal offset",
            with(&|config| config.comparison.bias = ShadowBias::NormalOffset { texels: 3.0 }),
        ),
        ("tight", with(&|config| config.fit = CascadeFit::Tight)),
        (
            "warped",
            with(&|config| config.fit = CascadeFit::Warped(MapWarp::Minimax)),
        ),
        ("faces", with(&|config| config.fit = CascadeFit::Faces)),
        ("no blending", with(&|config| config.blend = 0.0)),
        (
            "dithered",
            with(&|config| config.transition = CascadeTransition::Dither),
        ),
    ];
    for (name, other) in others {
        let ratios = studios.each_mut().map(|studio| {
            ratio(
                studio,
                &Setting::pssm("", other.clone()),
                &Setting::pssm("", config(cases[0], MAP_SIZES[0])),
            )
        });
        let _ = writeln!(text, "| {name} | {:.2} | {:.2} |", ratios[0], ratios[1]);
    }
    text
}

/// The main pass' time under one setting over that under another.
fn ratio(studio: &mut Studio, setting: &Setting, other: &Setting) -> f64 {
    quotient(|own| {
        studio.apply(if own { setting } else { other });
        times(studio)
    })
}

/// The main pass' times over a few frames.
fn times(studio: &mut Studio) -> Vec<f64> {
    // The first frames' times are those of the setting before, and of new pipelines.
    (0..TIMED_FRAMES + 3)
        .map(|_| {
            studio.shoot();
            studio.cost.gpu.main_milliseconds
        })
        .skip(3)
        .collect()
}

/// The least of one's times over the least of the other's, taken in turn: what else the machine
/// does only adds to them.
fn quotient(mut measure: impl FnMut(bool) -> Vec<f64>) -> f64 {
    let mut taken = [Vec::new(), Vec::new()];
    for _ in 0..TURNS {
        taken[0].extend(measure(true));
        taken[1].extend(measure(false));
    }
    let [own, other] = taken.map(|times| times.into_iter().fold(f64::INFINITY, f64::min));
    own / other.max(f64::MIN_POSITIVE)
}
