//! Each extreme by itself, with every fit.

use core::cell::Cell;

use bevy::math::{DVec3, EulerRot, Quat, Vec3};
use bevy_pssm::{
    config::MIN_MAP_SIZE,
    plan::{CasterChanges, split_planes},
    prelude::*,
};
use proptest::prelude::*;

use super::case::*;

/// Each kind, and each way to be warped.
fn fits() -> Vec<CascadeFit> {
    let warps = [
        MapWarp::Minimax,
        MapWarp::Lispsm,
        MapWarp::Lloyd { eta: -0.5 },
        MapWarp::Lloyd { eta: 0.7 },
        MapWarp::Trapezoid { focus: 0.2 },
        MapWarp::Strength(0.1),
        MapWarp::Strength(1.0),
    ];
    let mut fits = vec![
        CascadeFit::Stable,
        CascadeFit::Steady,
        CascadeFit::Tight,
        CascadeFit::Faces,
        CascadeFit::Auto { sharpness: 0.5 },
        CascadeFit::Auto { sharpness: 1.0 },
        CascadeFit::PerCascade(vec![
            MapFit::Warped(MapWarp::Minimax),
            MapFit::Tight,
            MapFit::Steady,
            MapFit::Stable,
        ]),
    ];
    fits.extend(warps.map(CascadeFit::Warped));
    fits
}

impl Case {
    /// Three boxes of any size before a camera that is nowhere in particular.
    pub fn ordinary() -> Self {
        let placed = |at: Spot, half: f64| Placed {
            at,
            half: DVec3::splat(half),
        };
        let thirds = [-0.9, 0.05, 0.95];
        let spots = thirds.iter().flat_map(|x| {
            thirds
                .iter()
                .flat_map(move |y| [0.4, 0.7, 0.95].map(|depth| [*x, *y, depth]))
        });
        Self {
            lenses: vec![Lens::Endless {
                fov: 60.0,
                aspect: 1.6,
                near: 0.1,
            }],
            configs: vec![ParallelSplitShadows::default()],
            eye: Vec3::new(3.0, 1.7, -2.0),
            turn: Quat::from_euler(EulerRot::YXZ, 0.4, -0.2, 0.0),
            scale: 1.0,
            sun: Sun::Anywhere(DVec3::new(0.3, 0.7, -0.45)),
            scene: Scene::Boxes(vec![
                placed([0.2, -0.3, 0.4], 0.2),
                placed([-0.5, 0.1, 0.7], 3.0),
                placed([0.1, -0.2, 0.9], 30.0),
            ]),
            is_anchored: false,
            reach: 4.0,
            frames: vec![STILL],
            spots: spots.collect(),
        }
    }

    pub fn with_lens(lens: Lens) -> Self {
        Self {
            lenses: vec![lens],
            ..Self::ordinary()
        }
    }

    pub fn with_config(config: ParallelSplitShadows) -> Self {
        Self {
            configs: vec![config],
            ..Self::ordinary()
        }
    }

    /// `None` if there is no such fit with these settings.
    fn with_fit(&self, fit: &CascadeFit) -> Option<Self> {
        let configs: Vec<ParallelSplitShadows> = self
            .configs
            .iter()
            .map(|config| ParallelSplitShadows {
                fit: for_cascades(fit, config.cascades),
                ..config.clone()
            })
            .collect();
        let are_valid = configs
            .iter()
            .all(|config| config.validate(MAX_MAP_SIZE).is_ok());
        are_valid.then(|| Self {
            configs,
            ..self.clone()
        })
    }

    /// Checks everything with each fit. How many points were seen.
    fn try_all_fits(&self) -> Result<usize, TestCaseError> {
        let mut seen = 0;
        for fit in fits() {
            if let Some(case) = self.with_fit(&fit) {
                let points = case.run(everything_holds);
                seen += points.map_err(|error| TestCaseError::fail(format!("{fit:?}: {error}")))?;
            }
        }
        Ok(seen)
    }

    fn holds(&self) {
        let seen = self.try_all_fits();
        assert!(matches!(seen, Ok(1..)), "{seen:?}: {self:?}");
    }
}

#[test]
fn near_and_far_may_be_close_or_far_apart() {
    for ratio in [1.0001, 1.1, 1e4, 1e8] {
        let (near, far) = (1e4 / ratio, 1e4);
        for cascades in [1, 4] {
            let config = ParallelSplitShadows {
                cascades,
                near,
                far,
                ..Default::default()
            };
            let [fov, aspect] = [60.0, 1.6];
            for lens in [
                Lens::Endless { fov, aspect, near },
                Lens::Ending {
                    fov,
                    aspect,
                    near,
                    far,
                },
            ] {
                for scene in [Scene::Everywhere, Case::ordinary().scene] {
                    let case = Case {
                        scene,
                        lenses: vec![lens],
                        ..Case::with_config(config.clone())
                    };
                    case.holds();
                }
            }
        }
    }
}

#[test]
fn every_scheme_may_have_any_range() {
    for ratio in [1.0001, 1e8] {
        let range = [1e3 / ratio, 1e3];
        for splits in [
            SplitScheme::Uniform,
            SplitScheme::Logarithmic,
            SplitScheme::Practical { lambda: 0.5 },
            SplitScheme::Geometric {
                gamma: 50.0,
                bias: 0.0,
            },
            SplitScheme::Geometric {
                gamma: 1.001,
                bias: 100.0,
            },
            SplitScheme::GeometricScaled {
                gamma: 50.0,
                bias: 0.1,
            },
            SplitScheme::Manual(vec![0.1, 0.5, 0.9]),
        ] {
            let case = Case::with_config(ParallelSplitShadows {
                near: range[0],
                far: range[1],
                splits: over_range(splits, range, 4),
                ..Default::default()
            });
            let [fov, aspect, near] = [60.0, 1.6, range[0]];
            let case = Case {
                lenses: vec![Lens::Endless { fov, aspect, near }],
                ..case
            };
            case.holds();
        }
    }
}

/// What is nearer than `near` is the first cascade's, even if that ends there.
#[test]
fn nothing_before_a_first_split_at_near_is_without_a_map() {
    let config = ParallelSplitShadows {
        cascades: 2,
        splits: SplitScheme::Geometric {
            gamma: 1e20,
            bias: 0.0,
        },
        ..Default::default()
    };
    let [near, far] = [config.near, config.far].map(f64::from);
    assert_eq!(split_planes(&config.splits, near, far, 2)[1], near);
    for scene in [Scene::Everywhere, Scene::Boxes(vec![ALL])] {
        let case = Case {
            scene,
            ..Case::with_config(config.clone())
        };
        case.holds();
    }
}

#[test]
fn views_may_be_narrow_or_wide() {
    for fov in [0.1, 1.0, 60.0, 175.0] {
        for aspect in [0.01, 1.0, 100.0] {
            let near = 0.1;
            Case::with_lens(Lens::Endless { fov, aspect, near }).holds();
        }
    }
}

#[test]
fn orthographic_views_may_be_small_or_large() {
    for height in [0.01, 1e5_f32] {
        for aspect in [0.01, 1.0, 100.0] {
            let far = 10.0 * height;
            for near in [0.0, -far] {
                let case = Case::with_lens(Lens::Orthographic {
                    height,
                    aspect,
                    near,
                    far,
                });
                case.holds();
            }
        }
    }
}

#[test]
fn suns_may_stand_along_any_axis() {
    for axis in 0..4 {
        for sign in [-1.0, 1.0] {
            for tilt in [0.0, 1e-7] {
                for scene in [Scene::Everywhere, Case::ordinary().scene] {
                    let case = Case {
                        sun: Sun::Beside {
                            axis,
                            sign,
                            tilt,
                            side: 0.7,
                        },
                        scene,
                        ..Case::ordinary()
                    };
                    case.holds();
                }
            }
        }
    }
}

/// Along the direction to the middle of what is seen, and along the camera's up as well: a warp can run
/// along neither.
#[test]
fn suns_may_stand_along_all_that_a_warp_might_run_along() {
    let case = Case {
        lenses: vec![Lens::Orthographic {
            height: 4000.0,
            aspect: 1.0,
            near: -100.0,
            far: 100.0,
        }],
        eye: Vec3::ZERO,
        turn: Quat::IDENTITY,
        sun: Sun::Anywhere(DVec3::Y),
        scene: Scene::Boxes(vec![Placed {
            at: [0.0, 0.75, 0.0],
            half: DVec3::splat(0.5),
        }]),
        ..Case::with_config(ParallelSplitShadows {
            slack: 0.0,
            comparison: Comparison {
                warp_axis: WarpAxis::BodyCenter,
                ..Default::default()
            },
            ..Default::default()
        })
    };
    case.holds();
}

#[test]
fn cameras_may_be_far_from_the_origin() {
    for distance in [1e5, 1e7] {
        for away in [Vec3::X, Vec3::NEG_Y, Vec3::new(0.6, 0.1, -0.79)] {
            for is_anchored in [false, true] {
                let case = Case {
                    eye: distance * away,
                    is_anchored,
                    ..Case::ordinary()
                };
                case.holds();
            }
        }
    }
}

/// Where a warp loses a point to rounding, the point is nearer to the eye than rounding reaches: at a
/// hundred kilometers from the origin no map of the default range does.
#[test]
fn warps_lose_nothing_within_a_hundred_kilometers() {
    let case = Case {
        eye: Vec3::new(6e4, 100.0, -8e4),
        scene: Scene::Everywhere,
        ..Case::ordinary()
    };
    for fit in fits() {
        let case = case.with_fit(&fit).expect("the settings allow all fits");
        let outcome = case.run(|planned| {
            for plan in &planned.plans {
                let Some(map) = &plan.map else {
                    continue;
                };
                for point in &planned.points {
                    let is_held = holds(&map.clip_from_world, *point);
                    let is_known = Rounding::of(plan, map, *point).is_some();
                    prop_assert!(is_known || !is_held, "{point}: {map:?}");
                }
            }
            Ok(())
        });
        assert!(matches!(outcome, Ok(1..)), "{fit:?}: {outcome:?}");
    }
}

/// A fraction of a millimeter of flat ground, tens of kilometers from the origin: much larger than what `f64`
/// tells apart there, and much smaller than a billionth of the distance.
#[test]
fn tiny_views_far_from_the_origin_lose_nothing() {
    for distance in [4e4, 57_889.48] {
        let case = Case {
            lenses: vec![Lens::Ending {
                fov: 0.1,
                aspect: 1.0,
                near: 7.5e-7,
                far: 3e-4,
            }],
            eye: distance * Vec3::X,
            turn: Quat::from_rotation_x(-0.876),
            sun: Sun::Anywhere(DVec3::X),
            scene: Scene::Coplanar(vec![Placed {
                at: [0.0, 0.0, 0.8],
                half: DVec3::splat(0.03),
            }]),
            ..Case::with_config(ParallelSplitShadows {
                cascades: 1,
                near: 8e-6,
                far: 100.0,
                slack: 0.0,
                ..Default::default()
            })
        };
        for yaw in 0..63 {
            let yaw = 0.1 * yaw as f32;
            let case = Case {
                frames: vec![Frame { yaw, ..STILL }],
                ..case.clone()
            };
            for fit in fits() {
                let Some(case) = case.with_fit(&fit) else {
                    continue;
                };
                let seen = case.run(nothing_is_missed);
                assert!(
                    matches!(seen, Ok(1..)),
                    "{distance} {yaw} {fit:?}: {seen:?}"
                );
            }
        }
    }
}

/// A third of a millimeter thick and a hundred kilometers long, with the sun along that, nearly: the plane
/// that fits best is nearly parallel to the light.
#[test]
fn thin_slices_along_the_light_keep_depths_in_order() {
    for tilt in [1e-9, 3e-9, 1e-8] {
        for yaw in [0.4, 1.0, 2.0, 2.6] {
            for side in [0.0, 0.7, 2.0] {
                let case = Case {
                    lenses: vec![Lens::Orthographic {
                        height: 6e4,
                        aspect: 3.0,
                        near: 0.0,
                        far: 3e-4,
                    }],
                    eye: Vec3::ZERO,
                    turn: Quat::from_euler(EulerRot::YXZ, yaw, -0.2, 0.0),
                    sun: Sun::Beside {
                        axis: 0,
                        sign: -1.0,
                        tilt,
                        side,
                    },
                    scene: Scene::Everywhere,
                    ..Case::with_config(ParallelSplitShadows {
                        cascades: 1,
                        near: 1e-5,
                        far: 1e-3,
                        fit: CascadeFit::Warped(MapWarp::Minimax),
                        ..Default::default()
                    })
                };
                let seen = case.run(maps_are_sound);
                assert!(matches!(seen, Ok(1..)), "{tilt} {yaw} {side}: {seen:?}");
            }
        }
    }
}

/// At the origin no texel is too small; but a wide view's far end is a hundred million times as large as the
/// distance from the warp's nearest line to its center of projection.
#[test]
fn strong_warps_of_wide_views_keep_depths_in_order() {
    let suns = [
        DVec3::new(0.3, 0.7, -0.45),
        DVec3::new(-0.5, 0.3, 0.2),
        DVec3::new(0.1, 0.9, 0.3),
        DVec3::new(-0.6, 0.2, -0.7),
    ];
    let near = 1e-5;
    for fov in [150.0, 175.0] {
        for yaw in [0.4, 1.0, 2.0, 2.6] {
            for sun in suns {
                let case = Case {
                    lenses: vec![Lens::Endless {
                        fov,
                        aspect: 1.6,
                        near,
                    }],
                    eye: Vec3::ZERO,
                    turn: Quat::from_euler(EulerRot::YXZ, yaw, -0.2, 0.0),
                    sun: Sun::Anywhere(sun),
                    scene: Scene::Everywhere,
                    ..Case::with_config(ParallelSplitShadows {
                        cascades: 1,
                        near,
                        far: 1e3,
                        fit: CascadeFit::Warped(MapWarp::Strength(1.0)),
                        ..Default::default()
                    })
                };
                let seen = case.run(maps_are_sound);
                assert!(matches!(seen, Ok(1..)), "{fov} {yaw} {sun}: {seen:?}");
            }
        }
    }
}

#[test]
fn scenes_may_be_small_or_large() {
    let scaled = |half: f64| -> Vec<Placed> {
        let placed = |at: Spot| Placed {
            at,
            half: DVec3::splat(half),
        };
        vec![placed([0.2, -0.3, 0.6]), placed([-0.5, 0.1, 0.8])]
    };
    for scene in [
        Scene::Everywhere,
        Scene::Fog,
        Scene::Boxes(scaled(0.0)[..1].to_vec()),
        Scene::Boxes(scaled(5e-4)),
        Scene::Boxes(scaled(5e4)),
        Scene::Boxes(vec![ALL]),
        Scene::Coplanar(scaled(10.0)),
        Scene::Coplanar(scaled(5e4)),
    ] {
        let case = Case {
            scene,
            ..Case::ordinary()
        };
        case.holds();
    }
}

/// Millimeters, some centimeters before the eye, where `near` is a meter.
#[test]
fn things_may_be_tiny_and_much_nearer_than_near() {
    let spots = [[0.2, -0.3, 0.1], [-0.5, 0.1, 0.15], [0.1, -0.2, 0.2]];
    let placed = spots.map(|at| Placed {
        at,
        half: DVec3::splat(2e-3),
    });
    let [fov, aspect, near] = [60.0, 1.6, 0.01];
    let case = Case {
        scene: Scene::Boxes(placed.to_vec()),
        ..Case::with_lens(Lens::Endless { fov, aspect, near })
    };
    case.holds();
}

#[test]
fn nothing_to_shadow_is_no_map_with_any_fit() {
    let case = Case {
        scene: Scene::Boxes(Vec::new()),
        ..Case::ordinary()
    };
    for fit in fits() {
        let case = case.with_fit(&fit).expect("the settings allow all fits");
        let outcome = case.run(|planned| {
            let is_empty = planned.plans.iter().all(|plan| plan.map.is_none());
            prop_assert!(is_empty, "{:?}", planned.plans);
            Ok(())
        });
        assert!(matches!(outcome, Ok(0)), "{fit:?}: {outcome:?}");
    }
}

#[test]
fn maps_may_be_small_or_large_or_both() {
    let odd = [[64, 16_384], [16_384, 64], [100, 3001], [64, 64]];
    for cascades in 1..=4 {
        for map_size in [
            MapSize::Same(MIN_MAP_SIZE),
            MapSize::Same(MAX_MAP_SIZE),
            MapSize::Halving(MIN_MAP_SIZE << (cascades - 1)),
            MapSize::Halving(MAX_MAP_SIZE),
            MapSize::PerCascade(odd[..cascades as usize].to_vec()),
            MapSize::Budget(cascades * (2 * MIN_MAP_SIZE).pow(2)),
            MapSize::Budget(cascades * (MAX_MAP_SIZE / 2).pow(2)),
        ] {
            let case = Case::with_config(ParallelSplitShadows {
                cascades,
                map_size,
                ..Default::default()
            });
            case.holds();
        }
    }
}

/// A turn, a cut, a jump, a change of settings, of the projection, and back; a sun that moves and
/// then jumps, casters that change, and maps that wait.
#[test]
fn histories_may_be_of_anything() {
    let near = ParallelSplitShadows {
        cascades: 4,
        near: 1e-3,
        far: 40.0,
        splits: SplitScheme::Uniform,
        slack: 1.0,
        map_size: MapSize::Same(777),
        ..Default::default()
    };
    let delayed = ParallelSplitShadows {
        delay: 2,
        ..Default::default()
    };
    let turned = |yaw: f32| Frame { yaw, ..STILL };
    let waiting = |yaw: f32| Frame {
        config: 2,
        ..turned(yaw)
    };
    let case = Case {
        lenses: vec![
            Lens::Endless {
                fov: 60.0,
                aspect: 1.6,
                near: 0.1,
            },
            Lens::Orthographic {
                height: 30.0,
                aspect: 0.5,
                near: -50.0,
                far: 1000.0,
            },
        ],
        configs: vec![ParallelSplitShadows::default(), near, delayed],
        frames: vec![
            STILL,
            turned(0.05),
            turned(2.5),
            STILL,
            Frame {
                step: 300.0,
                ..STILL
            },
            Frame { config: 1, ..STILL },
            Frame { lens: 1, ..STILL },
            Frame {
                lens: 1,
                config: 1,
                ..STILL
            },
            STILL,
            Frame { sun: 1e-3, ..STILL },
            Frame {
                sun: 0.02,
                changes: CasterChanges::Anywhere,
                ..STILL
            },
            Frame {
                sun: 1.5,
                changes: CasterChanges::AtOnce(None),
                ..STILL
            },
            waiting(0.0),
            Frame {
                changes: CasterChanges::Anywhere,
                ..waiting(0.05)
            },
            waiting(0.1),
            waiting(0.1),
            STILL,
        ],
        ..Case::ordinary()
    };
    case.holds();
}

/// The last of some values up to which everything holds with every fit.
fn last_good<T: Copy>(values: &[T], case: impl Fn(T) -> Case) -> Option<T> {
    let values = values.iter().copied();
    values
        .take_while(|value| case(*value).try_all_fits().is_ok())
        .last()
}

#[test]
fn fields_of_view_end_at() {
    let found = last_good(&[175.0, 177.0, 179.0, 179.9, 179.99], |fov| {
        let [aspect, near] = [1.6, 0.1];
        Case::with_lens(Lens::Endless { fov, aspect, near })
    });
    assert_eq!(found, Some(179.99));
}

#[test]
fn aspects_end_at() {
    let found = last_good(&[1e2, 1e3, 1e4, 1e5, 1e6], |aspect| {
        let [fov, near] = [60.0, 0.1];
        Case::with_lens(Lens::Endless { fov, aspect, near })
    });
    assert_eq!(found, Some(1e6));
}

/// Of one cascade, warped as strongly as can be.
#[test]
fn ratios_of_the_strongest_warp_end_at() {
    let ratios = [1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8];
    let holds = |ratio: f32| {
        let [fov, aspect, near] = [60.0, 1.6, 1e3 / ratio];
        let case = Case {
            lenses: vec![Lens::Endless { fov, aspect, near }],
            scene: Scene::Everywhere,
            ..Case::with_config(ParallelSplitShadows {
                cascades: 1,
                near,
                far: 1e3,
                ..Default::default()
            })
        };
        let fit = CascadeFit::Warped(MapWarp::Strength(1.0));
        let case = case.with_fit(&fit).expect("the settings allow the fit");
        case.run(everything_holds).is_ok()
    };
    let found = ratios.iter().copied().take_while(|it| holds(*it)).last();
    assert_eq!(found, Some(1e8));
}

/// From the origin, in powers of two (meters): three boxes from 0.2 to 30 m before the camera, by default
/// settings.
#[test]
fn lookups_are_off_by_less_than_a_quarter_of_a_texel_up_to() {
    let is_close = |fit: &CascadeFit, distance: f32| {
        let case = Case {
            eye: distance * Vec3::new(0.6, 0.1, -0.79),
            ..Case::ordinary()
        };
        let case = case.with_fit(fit).expect("the settings allow all fits");
        let worst = Cell::new(0.0_f64);
        let outcome = case.run(|planned| {
            for plan in &planned.plans {
                let Some(map) = &plan.map else {
                    continue;
                };
                let points = planned.points.iter();
                for point in points.filter(|point| holds(&map.clip_from_world, **point)) {
                    let off = apart(plan, map, *point).max_element();
                    worst.set(worst.get().max(off));
                }
            }
            Ok(())
        });
        outcome.is_ok() && worst.get() <= LEAST_ROUNDING
    };
    let farthest = |fit: CascadeFit| {
        let distances = (0..24).map(|power| f32::powi(2.0, power));
        distances.take_while(|it| is_close(&fit, *it)).last()
    };
    let found = [
        CascadeFit::Stable,
        CascadeFit::Steady,
        CascadeFit::Tight,
        CascadeFit::Warped(MapWarp::Minimax),
    ]
    .map(farthest);
    assert_eq!(found, [65_536.0, 1024.0, 1024.0, 1024.0].map(Some));
}
