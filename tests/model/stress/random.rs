//! Cases at random, over all ranges.

use core::{f64::consts::TAU, ops::Range};

use bevy::math::{DMat3, DVec3};
use bevy_pssm::{
    config::MIN_MAP_SIZE, geometry::oriented_box::OrientedBox, plan::CasterChanges, prelude::*,
};
use proptest::{prelude::*, test_runner::RngSeed};

use super::case::*;
use crate::{
    fitted::warp,
    splits::any_scheme,
    views::{any_direction, any_turn},
};

fn powers(range: Range<f64>) -> impl Strategy<Value = f64> {
    range.prop_map(|power| 10_f64.powf(power))
}

/// Of far to near.
fn ratio() -> impl Strategy<Value = f64> {
    powers(-4.0..8.0).prop_map(|more| 1.0 + more)
}

/// Those in perspective with their near planes as shares of where splits begin.
fn lens() -> impl Strategy<Value = Lens> {
    let fov = || prop_oneof![0.1..175.0_f32, Just(0.1_f32), Just(175.0_f32)];
    let aspect = || powers(-2.0..2.0).prop_map(|aspect| aspect as f32);
    let near = || powers(-3.0..0.3).prop_map(|near| near as f32);
    prop_oneof![
        (fov(), aspect(), near()).prop_map(|(fov, aspect, near)| Lens::Endless {
            fov,
            aspect,
            near
        }),
        (fov(), aspect(), near(), ratio()).prop_map(|(fov, aspect, near, ratio)| Lens::Ending {
            fov,
            aspect,
            near,
            far: (f64::from(near) * ratio) as f32,
        }),
        (
            powers(-2.0..5.0),
            aspect(),
            powers(-1.0..6.0),
            any::<bool>()
        )
            .prop_map(|(height, aspect, far, sees_behind)| Lens::Orthographic {
                height: height as f32,
                aspect,
                near: if sees_behind { -far as f32 } else { 0.0 },
                far: far as f32,
            }),
    ]
}

fn map_fit() -> impl Strategy<Value = MapFit> {
    prop_oneof![
        Just(MapFit::Stable),
        Just(MapFit::Steady),
        Just(MapFit::Tight),
        warp().prop_map(MapFit::Warped),
    ]
}

/// With one fit for each of four cascades.
fn fit() -> impl Strategy<Value = CascadeFit> {
    prop_oneof![
        1 => Just(CascadeFit::Stable),
        1 => Just(CascadeFit::Steady),
        1 => Just(CascadeFit::Tight),
        3 => warp().prop_map(CascadeFit::Warped),
        1 => Just(CascadeFit::Faces),
        1 => (0.0..=1.0_f32).prop_map(|sharpness| CascadeFit::Auto { sharpness }),
        2 => prop::collection::vec(map_fit(), 4).prop_map(CascadeFit::PerCascade),
    ]
}

fn map_size(kind: u32, sides: [u32; 8], cascades: u32) -> MapSize {
    match kind {
        0 => MapSize::Same(sides[0]),
        1 => MapSize::Halving(sides[0].max(MIN_MAP_SIZE << (cascades - 1))),
        2 => {
            let pairs = sides.chunks_exact(2).map(|pair| [pair[0], pair[1]]);
            MapSize::PerCascade(pairs.take(cascades as usize).collect())
        }
        _ => MapSize::Budget(cascades * sides[0].clamp(2 * MIN_MAP_SIZE, MAX_MAP_SIZE / 2).pow(2)),
    }
}

fn config() -> impl Strategy<Value = ParallelSplitShadows> {
    let shares = prop::array::uniform3(0.1..0.9_f32);
    let splits = prop_oneof![
        4 => any_scheme(),
        1 => shares.prop_map(|shares| SplitScheme::Manual(shares.to_vec())),
    ];
    let side = (6.0..=14.0_f64).prop_map(|power| power.exp2() as u32);
    let size = (0..4_u32, prop::array::uniform8(side));
    let shares = (
        0.0..=0.5_f32,
        0.0..=1.0_f32,
        prop_oneof![Just(0.0_f32), 0.0..=1.0_f32],
    );
    let motion = (
        prop_oneof![Just(0.05_f32), 0.0..=1.0_f32],
        prop_oneof![2 => Just(0), 1 => 1..5_u32],
    );
    let comparison = (
        any::<bool>(),
        prop::bool::weighted(0.2),
        prop::bool::weighted(0.3),
    );
    (
        1..=4_u32,
        powers(-2.0..7.0),
        ratio(),
        splits,
        fit(),
        size,
        shares,
        motion,
        comparison,
    )
        .prop_map(
            |(cascades, far, ratio, splits, fit, size, shares, motion, comparison)| {
                let has_faces = fit == CascadeFit::Faces;
                let cascades = if has_faces { 4 } else { cascades };
                let splits = match splits {
                    SplitScheme::Manual(_) if has_faces => SplitScheme::Logarithmic,
                    splits => splits,
                };
                let far = far as f32;
                let near = (f64::from(far) / ratio).max(1e-6) as f32;
                let (kind, sides) = size;
                let (blend, fade, slack) = shares;
                let (sun_step, delay) = motion;
                let (is_to_center, is_unfocused, is_grounded) = comparison;
                ParallelSplitShadows {
                    cascades,
                    near,
                    far,
                    splits: over_range(splits, [near, far], cascades),
                    blend,
                    fade,
                    fit: for_cascades(&fit, cascades),
                    slack,
                    map_size: map_size(kind, sides, cascades),
                    grid: if is_grounded {
                        TexelGrid::Ground
                    } else {
                        TexelGrid::Light
                    },
                    sun_step,
                    delay,
                    update_budget: match delay % 3 {
                        0 => UpdateBudget::Maps(1),
                        1 => UpdateBudget::Maps(2),
                        _ => UpdateBudget::Texels(3 << 20),
                    },
                    comparison: Comparison {
                        warp_axis: if is_to_center {
                            WarpAxis::BodyCenter
                        } else {
                            WarpAxis::View
                        },
                        focus: if is_unfocused {
                            ShadowFocus::Off
                        } else {
                            ShadowFocus::Receivers
                        },
                        ..Default::default()
                    },
                    ..Default::default()
                }
            },
        )
}

fn sun() -> impl Strategy<Value = Sun> {
    let tilt = prop_oneof![Just(0.0), powers(-10.0..-7.0)];
    prop_oneof![
        any_direction().prop_map(Sun::Anywhere),
        (0..4_usize, any::<bool>(), tilt, 0.0..TAU).prop_map(|(axis, is_back, tilt, side)| {
            Sun::Beside {
                axis,
                sign: if is_back { -1.0 } else { 1.0 },
                tilt,
                side,
            }
        }),
    ]
}

/// A little out of the picture, too.
fn spot() -> impl Strategy<Value = Spot> {
    (-1.1..1.1_f64, -1.1..1.1_f64, 0.0..1.0_f64).prop_map(|(x, y, depth)| [x, y, depth])
}

fn placed() -> impl Strategy<Value = Placed> {
    let shape = prop::array::uniform3(0.03..1.0_f64);
    (spot(), powers(-3.0..5.0), shape).prop_map(|(at, half, shape)| Placed {
        at,
        half: half * DVec3::from(shape),
    })
}

fn scene() -> impl Strategy<Value = Scene> {
    let boxes = || prop::collection::vec(placed(), 1..6);
    let point = spot().prop_map(|at| Placed {
        at,
        half: DVec3::ZERO,
    });
    prop_oneof![
        6 => boxes().prop_map(Scene::Boxes),
        2 => Just(Scene::Everywhere),
        1 => Just(Scene::Fog),
        1 => Just(Scene::Boxes(Vec::new())),
        1 => Just(Scene::Boxes(vec![ALL])),
        1 => point.prop_map(|point| Scene::Boxes(vec![point])),
        1 => boxes().prop_map(Scene::Coplanar),
    ]
}

/// Of none, or of some that matter to all maps.
fn changes() -> impl Strategy<Value = CasterChanges> {
    let all = OrientedBox {
        center: DVec3::ZERO,
        half_axes: DMat3::from_diagonal(ALL.half),
    };
    prop_oneof![
        3 => Just(CasterChanges::At(Vec::new())),
        1 => prop::sample::select(vec![
            CasterChanges::At(vec![all]),
            CasterChanges::Anywhere,
            CasterChanges::AtOnce(Some(vec![all])),
            CasterChanges::AtOnce(None),
        ]),
    ]
}

fn frame() -> impl Strategy<Value = Frame> {
    let yaw = prop_oneof![Just(0.0_f32), -0.1..0.1_f32, -3.0..3.0_f32];
    let step = prop_oneof![Just(0.0), powers(-3.0..3.0)];
    let sun = prop_oneof![Just(0.0), powers(-5.0..0.5)];
    (0..2_usize, 0..2_usize, yaw, step, sun, changes()).prop_map(
        |(lens, config, yaw, step, sun, changes)| Frame {
            lens,
            config,
            yaw,
            step: step as f32,
            sun,
            changes,
        },
    )
}

fn case() -> impl Strategy<Value = Case> {
    let distance = prop_oneof![Just(0.0), powers(0.0..7.0)];
    let eye = (any_direction(), distance).prop_map(|(away, distance)| (distance * away).as_vec3());
    (
        prop::collection::vec(lens(), 1..3),
        prop::collection::vec(config(), 1..3),
        eye,
        any_turn(),
        sun(),
        scene(),
        any::<bool>(),
        prop_oneof![Just(1.0), Just(4.0), Just(9.0)],
        prop::collection::vec(frame(), 1..7),
        prop::collection::vec(spot(), 30),
    )
        .prop_map(
            |(lenses, configs, eye, turn, sun, scene, is_anchored, reach, frames, spots)| {
                let near = configs[0].near;
                Case {
                    lenses: lenses.iter().map(|lens| lens.scaled(near)).collect(),
                    configs,
                    eye,
                    turn,
                    scale: 1.0,
                    sun,
                    scene,
                    is_anchored,
                    reach,
                    frames,
                    spots,
                }
            },
        )
}

proptest! {
    #![proptest_config(ProptestConfig {
        // The same cases wherever there are no more: one in two million still fails (docs/range.md).
        rng_seed: RngSeed::Fixed(1),
        ..ProptestConfig::with_cases(64)
    })]

    #[test]
    fn all_maps_are_sound(case in case()) {
        if case.is_told_apart() {
            case.run(maps_are_sound)?;
        }
    }

    #[test]
    fn nothing_that_is_seen_is_without_a_map(case in case()) {
        if case.is_told_apart() {
            case.run(nothing_is_missed)?;
        }
    }

    #[test]
    fn lookups_are_off_by_what_rounding_says(case in case()) {
        if case.is_told_apart() {
            case.run(lookups_agree)?;
        }
    }
}
