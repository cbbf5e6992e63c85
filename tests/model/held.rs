//! Maps that stay as they are while they serve.

use bevy::math::{DMat3, DVec3, Quat, Vec3};
use bevy_pssm::{
    geometry::{
        fit::LookupReach, light_frame::LightFrame, oriented_box::OrientedBox, receivers::Receivers,
        slice::ViewVolume,
    },
    plan::{
        CascadeMap, CascadePlan, CasterChanges, PlanHistory, PlanInputs, Redraw, plan_cascades,
    },
    prelude::*,
};

use crate::{
    motion::texels,
    views::{perspective, volume},
};

/// A camera over wide ground, and what it has been planned for.
struct Walker {
    eye: DVec3,
    yaw: f32,
    /// Vertical field of view (radians).
    fov: f32,
    config: ParallelSplitShadows,
    to_light: DVec3,
    /// What stands on the ground.
    things: Vec<OrientedBox>,
    history: PlanHistory,
}

impl Walker {
    fn new(fit: CascadeFit) -> Self {
        Self {
            eye: DVec3::new(3.0, 1.7, -2.0),
            yaw: 0.3,
            fov: 0.8,
            config: ParallelSplitShadows {
                fit,
                ..Default::default()
            },
            to_light: DVec3::new(0.3, 0.7, -0.45),
            things: Vec::new(),
            history: PlanHistory::default(),
        }
    }

    fn view(&self) -> ViewVolume {
        let turn = Quat::from_rotation_y(self.yaw);
        volume(&perspective(self.fov, 1.6), self.eye.as_vec3(), turn)
    }

    fn plan(&mut self, changes: &CasterChanges) -> Vec<CascadePlan> {
        let view = self.view();
        let mut receivers = Receivers::new(&view);
        receivers.add(&OrientedBox {
            center: DVec3::ZERO,
            half_axes: DMat3::from_diagonal(DVec3::new(900.0, 0.1, 900.0)),
        });
        self.things.iter().for_each(|thing| receivers.add(thing));
        let light = LightFrame::new(self.to_light).expect("a direction");
        let inputs = PlanInputs {
            view: &view,
            light: &light,
            config: &self.config,
            reach: LookupReach { texels: 3.0 },
            receivers: &receivers,
            image_height: 1080.0,
            changes,
        };
        plan_cascades(&inputs, &mut self.history)
    }

    /// Maps drawn anew per frame, and maps that casters are added to, of those that there are, on a path.
    fn shares_drawn(&mut self, frames: u32, step: impl Fn(&mut Self)) -> [f64; 2] {
        let nothing = CasterChanges::At(Vec::new());
        self.plan(&nothing);
        let [mut anew, mut added_to, mut all] = [0; 3];
        for _ in 0..frames {
            step(self);
            for redraw in reasons(&self.plan(&nothing)) {
                all += 1;
                match redraw {
                    None => (),
                    Some(Redraw::Added) => added_to += 1,
                    Some(_) => anew += 1,
                }
            }
        }
        [anew, added_to].map(|drawn| f64::from(drawn) / f64::from(all))
    }

    fn forward(&self) -> DVec3 {
        (Quat::from_rotation_y(self.yaw) * Vec3::NEG_Z).as_dvec3()
    }
}

fn fits() -> [CascadeFit; 3] {
    [CascadeFit::Steady, CascadeFit::Stable, CascadeFit::Tight]
}

fn reasons(plans: &[CascadePlan]) -> Vec<Option<Redraw>> {
    let maps = plans.iter().filter_map(|plan| plan.map.as_ref());
    maps.map(|map| map.redraw).collect()
}

/// Which maps are drawn.
fn drawn(plans: &[CascadePlan]) -> Vec<usize> {
    let reasons = reasons(plans).into_iter().enumerate();
    let drawn = reasons.filter(|(_, why)| why.is_some());
    drawn.map(|(index, _)| index).collect()
}

#[test]
fn while_a_camera_moves_few_maps_are_drawn() {
    for (fit, most) in fits().into_iter().zip([
        [[0.0; 2], [0.004, 0.02], [0.06, 0.095], [0.03, 0.09]],
        [[0.0; 2], [0.004, 0.02], [0.06, 0.11], [0.03, 0.11]],
        // Fitted closely, it has little to spare.
        [[0.0; 2], [0.27, 0.01], [0.37, 0.09], [0.32, 0.02]],
    ]) {
        let shares = |step: &dyn Fn(&mut Walker)| Walker::new(fit.clone()).shares_drawn(600, step);
        let found = [
            shares(&|_| ()),
            shares(&|it| it.eye += it.forward() * (6.0 / 60.0)),
            shares(&|it| it.yaw += (90.0_f32 / 60.0).to_radians()),
            shares(&|it| it.eye += it.forward() * (50.0 / 60.0)),
        ];
        let mut pairs = found.as_flattened().iter().zip(most.as_flattened());
        let is_few = pairs.all(|(found, most)| found <= most);
        assert!(
            is_few,
            "{fit:?} draws {found:?} of its maps, {most:?} at most"
        );
    }
}

/// A view that keeps turning quickly has somewhat larger maps after a while, which are drawn less often, until it has rested
/// for some seconds. One that turns slowly, or once by a right angle, has not.
#[test]
fn maps_have_more_to_spare_while_a_view_keeps_turning() {
    let nothing = CasterChanges::At(Vec::new());
    let texel = |plans: &[CascadePlan]| {
        let maps = plans.iter().filter_map(|plan| plan.map.as_ref());
        maps.map(|map| map.texel.max_element()).fold(0.0, f64::max)
    };
    let turn = |walker: &mut Walker, step: f32, frames: u32| -> Vec<f64> {
        let plans = (0..frames).map(|_| {
            walker.yaw += step.to_radians();
            walker.plan(&nothing)
        });
        plans.map(|plans| texel(&plans)).collect()
    };
    for (step, frames, is_quick) in [
        (1.5, 600, true),
        (-2.0, 300, true),
        (0.5, 1200, false),
        (9.0, 10, false),
    ] {
        let mut walker = Walker::new(CascadeFit::Steady);
        let before = texel(&walker.plan(&nothing));
        let texels = turn(&mut walker, step, frames);
        let most = texels.into_iter().fold(0.0, f64::max) / before;
        assert_eq!(most > 1.2, is_quick, "{most} times at {step} degrees");
        assert!(most < 1.1_f64.powi(5), "{most} times at {step} degrees");
        let rested = turn(&mut walker, 0.0, 400)[399] / before;
        assert!(rested < 1.11, "{rested} times at rest");
        let redraws = reasons(&walker.plan(&nothing));
        assert!(redraws.iter().all(Option::is_none), "{redraws:?}");
    }
    // Large steps are few.
    for slack in [0.5, 1.0] {
        let mut walker = Walker::new(CascadeFit::Steady);
        walker.config.slack = slack;
        let before = texel(&walker.plan(&nothing));
        let texels = turn(&mut walker, 1.5, 300);
        let most = texels.into_iter().fold(0.0, f64::max) / before;
        assert!(most < 2.01, "{most} times with a slack of {slack}");
    }
    let on = |walker: &mut Walker| walker.yaw += 1.5_f32.to_radians();
    let mut walker = Walker::new(CascadeFit::Steady);
    let [[first, _], _, [then, _]] = [60, 60, 480].map(|frames| walker.shares_drawn(frames, on));
    assert!(then < 0.7 * first, "{then} of the maps, {first} at first");
}

/// How many times as large as a fresh plan's a walker's texels are, for each map that both have.
fn times_too_large(walker: &mut Walker) -> Vec<f64> {
    let nothing = CasterChanges::At(Vec::new());
    let held = texels(&walker.plan(&nothing));
    let history = core::mem::take(&mut walker.history);
    let fresh = texels(&walker.plan(&nothing));
    walker.history = history;
    let pairs = held.into_iter().zip(fresh);
    pairs
        .filter_map(|(held, fresh)| Some(held? / fresh?))
        .collect()
}

/// What may be held too large where no turn goes on: seven steps, and three to spare.
const MOST_TIMES: f64 = 2.86;

/// While a view goes on turning, maps serve for what it has seen on the way, and for what it sees as soon as it stops.
#[test]
fn maps_keep_their_texels_where_a_view_turns_to_emptiness_and_back() {
    let nothing = CasterChanges::At(Vec::new());
    for degrees in [1.5_f32, -1.0] {
        let mut walker = Walker::new(CascadeFit::Steady);
        // Five meters beyond the ground's edge.
        walker.eye.x = 905.0;
        let round = (360.0 / degrees.abs()) as u32;
        let turn = |walker: &mut Walker| {
            walker.yaw += degrees.to_radians();
            texels(&walker.plan(&nothing))
        };
        let mut last = [None; 4];
        let (mut changes, mut empty) = (0, 0);
        for frame in 0..4 * round {
            let now = turn(&mut walker);
            empty += u32::from(now.iter().all(Option::is_none));
            let mut is_changed = false;
            for (last, now) in last.iter_mut().zip(now) {
                is_changed |= last.is_some() && now.is_some() && *last != now;
                *last = now.or(*last);
            }
            // After a first turn and a half.
            changes += u32::from(is_changed && frame >= 3 * round / 2);
        }
        assert!(empty > round / 3, "{empty} frames in which nothing is seen");
        assert_eq!(changes, 0, "changes at {degrees} degrees a frame");

        let mut compared = 0;
        for more in (0..round).step_by(10) {
            for _ in 0..round + more {
                turn(&mut walker);
            }
            for _ in 0..10 {
                walker.plan(&nothing);
            }
            let times = times_too_large(&mut walker);
            compared += times.len();
            assert!(
                times.iter().all(|it| *it < MOST_TIMES),
                "{times:?}, {more} frames on"
            );
            walker.history = PlanHistory::default();
        }
        assert!(compared > 20, "{compared} maps");
    }
}

/// Posts to the left and to the right, nearer than the ground, have splits begin elsewhere: maps' texels stay as they are
/// for all that, if they are not much too large.
#[test]
fn maps_keep_their_texels_where_a_view_turns_to_nearer_things_and_back() {
    let nothing = CasterChanges::At(Vec::new());
    // One that turns quickly gets more to spare, once. A lens that breathes by half a thousandth does not zoom.
    for (degrees, breath, most) in [(0.5_f32, 0.0, 0), (0.5, 0.0005, 0), (-2.0, 0.0, 1)] {
        let mut walker = Walker::new(CascadeFit::Steady);
        walker.eye.y = 6.0;
        walker.things = [3.0, -4.0]
            .map(|side| OrientedBox {
                center: walker.eye + side * DVec3::new(1.0, -0.25, 0.0),
                half_axes: DMat3::from_diagonal(DVec3::new(0.2, 1.0, 0.2)),
            })
            .to_vec();
        let sides = |plans: &[CascadePlan]| -> Vec<_> {
            let maps = plans.iter().map(|plan| plan.map.as_ref());
            maps.map(|map| map.map(|map| map.texel)).collect()
        };
        let mut last = sides(&walker.plan(&nothing));
        let (mut changes, mut splits) = (0, Vec::<u64>::new());
        let wide = walker.fov;
        for frame in 0..600_u16 {
            walker.yaw += degrees.to_radians();
            walker.fov = wide * (1.0 + breath * (0.1 * f32::from(frame)).sin());
            let plans = walker.plan(&nothing);
            splits.push(plans[0].far.to_bits());
            let now = sides(&plans);
            changes += u32::from(now != last);
            last = now;
        }
        splits.dedup();
        assert!(splits.len() > 1, "splits stay where they are");
        assert!(
            changes <= most,
            "{changes} changes at {degrees} degrees, breathing by {breath}"
        );
        for _ in 0..10 {
            walker.plan(&nothing);
        }
        let times = times_too_large(&mut walker);
        let is_bounded = times.iter().all(|it| *it < MOST_TIMES);
        assert!(is_bounded, "{times:?} at {degrees} degrees");
    }
}

/// What has been seen afar on the way does not make maps of what is next to the camera as coarse.
#[test]
fn maps_become_finer_where_a_view_turns_to_what_is_much_nearer() {
    let nothing = CasterChanges::At(Vec::new());
    let mut walker = Walker::new(CascadeFit::Steady);
    walker.eye.y = 60.0;
    walker.things = vec![OrientedBox {
        center: walker.eye + DVec3::new(2.0, -1.0, 0.0),
        half_axes: DMat3::from_diagonal(DVec3::new(0.5, 0.5, 3.0)),
    }];
    let mut nearest = f64::INFINITY;
    for frame in 0..250 {
        walker.yaw += 1.0_f32.to_radians();
        nearest = nearest.min(walker.plan(&nothing)[0].far);
        let times = times_too_large(&mut walker);
        let is_bounded = times.iter().all(|it| *it < MOST_TIMES);
        assert!(is_bounded, "{times:?} in frame {frame}");
    }
    assert!(nearest < 20.0, "{nearest} m");
}

/// A turn is one about where the view is: what was seen from elsewhere, or through another lens, counts no more.
#[test]
fn maps_become_finer_where_a_view_turns_and_comes_near() {
    let nothing = CasterChanges::At(Vec::new());
    let cases: [(&str, f64, fn(&mut Walker)); 2] = [
        ("zooming", 6.0, |walker| walker.fov *= 0.98),
        ("coming down", 60.0, |walker| {
            walker.eye.y = 1.7 + 0.97 * (walker.eye.y - 1.7);
        }),
    ];
    for (name, height, step) in cases {
        let mut walker = Walker::new(CascadeFit::Steady);
        walker.eye.y = height;
        for frame in 0..400 {
            walker.yaw += 1.5_f32.to_radians();
            if frame >= 250 {
                step(&mut walker);
            }
            let times = times_too_large(&mut walker);
            assert!(!times.is_empty());
            if frame >= 250 {
                assert!(
                    times.iter().all(|it| *it < 3.6),
                    "{name}: {times:?} in frame {frame}"
                );
            }
            walker.plan(&nothing);
        }
    }
}

/// What a zoom enlarges shows its texels: meanwhile maps are not held as long as they might be.
#[test]
fn maps_stay_fine_while_a_view_zooms() {
    let nothing = CasterChanges::At(Vec::new());
    for (degrees, first) in [(0.0_f32, 0), (0.1, 0), (1.0, 0), (0.0, 400)] {
        let mut walker = Walker::new(CascadeFit::Steady);
        let wide = walker.fov;
        let mut worst: f64 = 1.0;
        for frame in first..first + 700 {
            // To a third and back, after a while at rest, and to it again; or from it.
            let share = (f64::from(frame) - 100.0).max(0.0) / 300.0;
            let there_and_back = 1.0 - (share % 2.0 - 1.0).abs();
            walker.fov = wide / (1.0 + 2.0 * there_and_back as f32);
            walker.yaw += degrees.to_radians();
            walker.plan(&nothing);
            let times = times_too_large(&mut walker);
            assert!(!times.is_empty());
            worst = times.into_iter().fold(worst, f64::max);
        }
        assert!(
            worst < 1.22,
            "{worst} times, turning by {degrees}°, from frame {first} on"
        );
    }
}

/// Wherever one goes, lookups stay inside of maps that were laid some time ago, and so do casters.
#[test]
fn held_maps_cover_what_is_seen() {
    let nothing = CasterChanges::At(Vec::new());
    for fit in fits() {
        let mut walker = Walker::new(fit);
        let mut held = 0;
        for frame in 0..900 {
            walker.eye += walker.forward() * (6.0 / 60.0);
            walker.yaw += (0.7 * (0.02 * f64::from(frame)).sin() / 60.0) as f32;
            let plans = walker.plan(&nothing);
            let view = walker.view();
            for plan in &plans {
                let Some(map) = &plan.map else {
                    continue;
                };
                held += usize::from(map.redraw.is_none());
                let slice = view.slice(plan.near, plan.far).expect("it is not empty");
                let guard = 1.0 - 2.0 * 3.0 / plan.map_size.as_dvec2();
                // Where the rays of the slice's corners meet the ground, and the corners on it.
                for [a, b] in (0..8).flat_map(|a| (0..a).map(move |b| [a, b])) {
                    let [a, b] = [a, b].map(|corner| slice.corners[corner]);
                    let share = a.y / (a.y - b.y);
                    if !(0.0..=1.0).contains(&share) {
                        continue;
                    }
                    let seen = a + share * (b - a);
                    let ndc = map.clip_from_world.project_point3(seen);
                    let is_inside = ndc.truncate().abs().cmple(guard + 1e-9).all();
                    assert!(
                        is_inside && ndc.z >= 0.0 && ndc.z <= 1.0,
                        "frame {frame}: {ndc}"
                    );
                    let caster = OrientedBox {
                        center: seen + 40.0 * walker.to_light,
                        half_axes: DMat3::ZERO,
                    };
                    assert!(map.hull.intersects_box(&caster), "frame {frame}: {seen}");
                }
            }
        }
        assert!(held > 1000, "{held} maps were held");
    }
}

#[test]
fn only_casters_that_matter_have_maps_drawn() {
    let nothing = CasterChanges::At(Vec::new());
    let at = |center: DVec3| {
        CasterChanges::At(vec![OrientedBox {
            center,
            half_axes: DMat3::from_diagonal(DVec3::splat(0.5)),
        }])
    };
    for fit in fits() {
        let mut walker = Walker::new(fit);
        let first = walker.plan(&nothing);
        assert!(reasons(&first).iter().all(|it| *it == Some(Redraw::New)));
        assert!(reasons(&walker.plan(&nothing)).iter().all(Option::is_none));

        let behind = walker.eye - 200.0 * walker.forward();
        assert!(
            reasons(&walker.plan(&at(behind)))
                .iter()
                .all(Option::is_none)
        );
        let before = walker.eye + 6.0 * walker.forward();
        let near = reasons(&walker.plan(&at(before)));
        assert_eq!(near[0], Some(Redraw::Casters));
        assert_eq!(near.last(), Some(&None));
        let towards_light = before + 300.0 * walker.to_light;
        assert_eq!(
            reasons(&walker.plan(&at(towards_light)))[0],
            Some(Redraw::Casters)
        );
        let anywhere = reasons(&walker.plan(&CasterChanges::Anywhere));
        assert!(anywhere.iter().all(|it| *it == Some(Redraw::Casters)));

        walker.to_light.x += 0.01;
        let turned = reasons(&walker.plan(&nothing));
        assert!(turned.iter().all(|it| *it == Some(Redraw::Light)));
        walker.config.map_size = MapSize::Same(1024);
        let resized = reasons(&walker.plan(&nothing));
        assert!(resized.iter().all(|it| *it == Some(Redraw::New)));
        walker.config.comparison.updates = MapUpdates::EveryFrame;
        walker.plan(&nothing);
        let every = reasons(&walker.plan(&nothing));
        assert!(every.iter().all(|it| *it == Some(Redraw::EveryFrame)));
    }
}

/// What changes where a map holds nothing costs nothing.
#[test]
fn maps_that_hold_what_changes_are_drawn() {
    let nothing = CasterChanges::At(Vec::new());
    for fit in [CascadeFit::Steady, CascadeFit::Stable] {
        let mut walker = Walker::new(fit);
        walker.plan(&nothing);
        let at = |center: DVec3| {
            CasterChanges::At(vec![OrientedBox {
                center,
                half_axes: DMat3::from_diagonal(DVec3::splat(0.1)),
            }])
        };
        let behind = at(walker.eye - 50.0 * walker.forward());
        assert!(reasons(&walker.plan(&behind)).iter().all(Option::is_none));
        let near = at(walker.eye + 6.0 * walker.forward() - 1.5 * DVec3::Y);
        assert_eq!(reasons(&walker.plan(&near))[0], Some(Redraw::Casters));
        assert!(reasons(&walker.plan(&nothing)).iter().all(Option::is_none));
    }
}

/// Where casters matter to a held map now, they would matter to one that is drawn now.
#[test]
fn held_maps_know_which_casters_matter_now() {
    let nothing = CasterChanges::At(Vec::new());
    let mut walker = Walker::new(CascadeFit::Stable);
    walker.config.slack = 0.0;
    let mut held = 0;
    for frame in 0..6 {
        let plans = walker.plan(&nothing);
        let mut newcomer = Walker {
            config: walker.config.clone(),
            history: PlanHistory::default(),
            things: Vec::new(),
            ..walker
        };
        for (plan, fresh) in plans.iter().zip(newcomer.plan(&nothing)) {
            let maps = [plan.map.as_ref(), fresh.map.as_ref()];
            let [now, of_fresh] = maps.map(|map| map.map(|map| &map.hull_now));
            assert!(now == of_fresh, "frame {frame}");
            held += usize::from(plan.map.as_ref().is_some_and(|map| map.redraw.is_none()));
        }
        walker.eye += 0.1 * walker.forward();
    }
    assert!(held > 0, "no map was held");
}

/// Where a view turns, maps hold casters of what it comes to see, but none beyond their own sides.
#[test]
fn maps_look_ahead_as_far_as_they_reach() {
    let nothing = CasterChanges::At(Vec::new());
    let mut walker = Walker::new(CascadeFit::Steady);
    walker.plan(&nothing);
    let (mut drawn, mut all) = (0, 0);
    for frame in 0..240 {
        walker.yaw += 1.5_f32.to_radians();
        let plans = walker.plan(&nothing);
        for map in plans.iter().filter_map(|plan| plan.map.as_ref()) {
            all += 1;
            let Some(redraw) = map.redraw else {
                continue;
            };
            drawn += u32::from(redraw != Redraw::Added);
            let world_from_clip = map.clip_from_world.inverse();
            for side in [DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y] {
                for step in -9..10 {
                    let along = 0.1 * f64::from(step);
                    let beside = 1.02 * side + along * DVec3::new(side.y, side.x, 0.0);
                    let beside = world_from_clip.project_point3(beside + 0.95 * DVec3::Z);
                    let holds = map.hull.intersects_sphere(beside, 0.0);
                    assert!(!holds, "frame {frame}: {beside}");
                }
            }
        }
    }
    let share = f64::from(drawn) / f64::from(all);
    assert!(share < 0.1, "{share} of all maps drawn anew");
}

/// What a map was drawn with before casters were added to it, it still holds: and has to be drawn anew if that changes.
#[test]
fn maps_that_are_added_to_keep_what_they_held() {
    let nothing = CasterChanges::At(Vec::new());
    let mut added = 0;
    for fit in fits() {
        let mut walker = Walker::new(fit);
        let mut firsts: Vec<CascadeMap> = Vec::new();
        for _ in 0..60 {
            let plans = walker.plan(&nothing);
            let maps: Vec<_> = plans.into_iter().filter_map(|plan| plan.map).collect();
            firsts.resize_with(maps.len(), || maps[0].clone());
            for (first, map) in firsts.iter_mut().zip(&maps) {
                match map.redraw {
                    Some(Redraw::Added) => added += 1,
                    None => (),
                    Some(_) => first.clone_from(map),
                }
                assert_eq!(map.clip_from_world, first.clip_from_world);
            }
            // On the ground, where the map held casters at first and is not to any more.
            let places = (0..360).map(|degrees| {
                let turn = Quat::from_rotation_y((degrees as f32).to_radians());
                let at = walker.eye + 200.0 * (turn * Vec3::X).as_dvec3();
                at.with_y(0.0)
            });
            let is_left = |place: &DVec3| {
                let holds = |map: &CascadeMap| map.hull.intersects_sphere(*place, 0.5);
                let is_left = |(first, map)| holds(first) && !holds(map);
                firsts.last().zip(maps.last()).is_some_and(is_left)
            };
            if let Some(place) = places.into_iter().find(is_left) {
                let changed = CasterChanges::At(vec![OrientedBox {
                    center: place,
                    half_axes: DMat3::from_diagonal(DVec3::splat(0.4)),
                }]);
                let mut history = walker.history.clone();
                core::mem::swap(&mut history, &mut walker.history);
                let why = reasons(&walker.plan(&changed));
                assert_eq!(why.last(), Some(&Some(Redraw::Casters)));
                walker.history = history;
            }
            walker.yaw += 1.0_f32.to_radians();
        }
    }
    assert!(added > 20, "casters were added {added} times");
}

/// Who looks to and fro has the same casters added once.
#[test]
fn casters_are_added_once_where_a_view_swings() {
    let nothing = CasterChanges::At(Vec::new());
    for fit in [CascadeFit::Steady, CascadeFit::Stable] {
        let mut walker = Walker::new(fit);
        let yaw = walker.yaw;
        let mut drawn = [0; 2];
        for (half, drawn) in drawn.iter_mut().enumerate() {
            for frame in 0..240 {
                let phase = 0.1 * (240 * half + frame) as f32;
                walker.yaw = yaw + 0.05 * phase.sin();
                *drawn += reasons(&walker.plan(&nothing)).iter().flatten().count();
            }
        }
        assert!(drawn[0] > 4, "what was added first");
        assert!(drawn[1] <= 4, "{drawn:?} maps were drawn");
    }
}

/// However long a view goes on, maps do not hold casters for ever that have not mattered for long.
#[test]
fn maps_are_not_added_to_for_ever() {
    let nothing = CasterChanges::At(Vec::new());
    let mut walker = Walker::new(CascadeFit::Stable);
    walker.config.slack = 4.0;
    let mut in_a_row = [0; 4];
    let mut most = 0;
    for frame in 0..4000 {
        walker.yaw += (0.01 + 0.000_01 * f64::from(frame)) as f32;
        walker.eye.x += 0.002;
        for (count, redraw) in in_a_row.iter_mut().zip(reasons(&walker.plan(&nothing))) {
            match redraw {
                Some(Redraw::Added) => *count += 1,
                None => (),
                Some(_) => *count = 0,
            }
            most = most.max(*count);
        }
    }
    assert!((5..=32).contains(&most), "{most} times");
}

/// Maps whose casters change in every frame hold what matters now and no more.
#[test]
fn maps_that_do_not_last_have_nothing_to_spare() {
    let nothing = CasterChanges::At(Vec::new());
    let mut walker = Walker::new(CascadeFit::Steady);
    walker.plan(&nothing);
    walker.plan(&nothing);
    for has_lasted in [true, false, false] {
        let plans = walker.plan(&CasterChanges::Anywhere);
        for map in plans.iter().filter_map(|plan| plan.map.as_ref()) {
            assert_eq!(map.hull != map.hull_now, has_lasted);
        }
    }
}

/// Several maps are due in the same frame: one is drawn, unless the others have waited long enough.
#[test]
fn maps_that_may_wait_are_drawn_one_after_the_other() {
    let nothing = CasterChanges::At(Vec::new());
    for fit in fits() {
        let mut totals = [0, 0];
        for (delay, total) in [0, 4].into_iter().zip(&mut totals) {
            let mut walker = Walker::new(fit.clone());
            walker.config.delay = delay;
            let mut most = 0;
            for frame in 0..300 {
                walker.eye += walker.forward() * (30.0 / 60.0);
                walker.yaw += (90.0_f32 / 60.0).to_radians();
                let drawn = reasons(&walker.plan(&nothing)).iter().flatten().count();
                *total += drawn;
                if frame > 0 {
                    most = most.max(drawn);
                }
            }
            // Four frames are enough for four maps.
            if delay > 0 {
                assert_eq!(most, 1, "{fit:?}");
            }
            // What has waited is not forgotten.
            let later = (0..8).map(|_| reasons(&walker.plan(&nothing)).iter().flatten().count());
            let later: Vec<_> = later.collect();
            assert_eq!(later[4..], [0; 4], "{fit:?} {later:?}");
        }
        assert!(totals[1] <= totals[0], "{fit:?}: {totals:?}");
    }
}

/// All maps are due: those that fit the budget are drawn, the nearest first, or one.
#[test]
fn budgets_say_how_many_are_drawn_in_a_frame() {
    let nothing = CasterChanges::At(Vec::new());
    let sizes = MapSize::PerCascade(vec![[2048; 2], [1024; 2], [512; 2], [512; 2]]);
    let million = |count: u32| UpdateBudget::Texels(count << 20);
    for (budget, expected) in [
        (UpdateBudget::Maps(1), [vec![0], vec![1], vec![2], vec![3]]),
        (
            UpdateBudget::Maps(2),
            [vec![0, 1], vec![2, 3], vec![], vec![]],
        ),
        (
            UpdateBudget::Maps(3),
            [vec![0, 1, 2], vec![3], vec![], vec![]],
        ),
        (
            UpdateBudget::Maps(4),
            [vec![0, 1, 2, 3], vec![], vec![], vec![]],
        ),
        // The first is larger than the budget; the others fit it.
        (million(2), [vec![0], vec![1, 2, 3], vec![], vec![]]),
        (million(1), [vec![0], vec![1], vec![2, 3], vec![]]),
        (million(5), [vec![0, 1], vec![2, 3], vec![], vec![]]),
        (
            UpdateBudget::Texels(1),
            [vec![0], vec![1], vec![2], vec![3]],
        ),
    ] {
        let mut walker = Walker::new(CascadeFit::Steady);
        walker.config.map_size = sizes.clone();
        walker.config.delay = 8;
        walker.config.update_budget = budget;
        walker.plan(&nothing);
        walker.plan(&nothing);
        for (frame, expected) in expected.into_iter().enumerate() {
            let changes = if frame == 0 {
                &CasterChanges::Anywhere
            } else {
                &nothing
            };
            let drawn = drawn(&walker.plan(changes));
            assert_eq!(drawn, expected, "{budget:?}, frame {frame}");
        }
    }
}

/// Who has waited longest goes first, though nearer maps are due in every frame, and though it is larger than
/// the budget.
#[test]
fn budgets_keep_room_for_who_has_waited() {
    let nothing = CasterChanges::At(Vec::new());
    for (budget, expected) in [
        (
            UpdateBudget::Maps(2),
            [vec![0, 1], vec![2, 3], vec![0, 1], vec![2, 3]],
        ),
        (
            UpdateBudget::Texels(1),
            [vec![0], vec![1], vec![2], vec![3]],
        ),
    ] {
        let mut walker = Walker::new(CascadeFit::Steady);
        walker.config.delay = 60;
        walker.config.update_budget = budget;
        walker.plan(&nothing);
        walker.plan(&nothing);
        for expected in expected {
            let drawn = drawn(&walker.plan(&CasterChanges::Anywhere));
            assert_eq!(drawn, expected, "{budget:?}");
        }
    }
}

/// Maps that wait to be drawn anew are not only added to when it is their turn.
#[test]
fn what_is_due_outlasts_what_is_added() {
    let nothing = CasterChanges::At(Vec::new());
    for fit in fits() {
        for before in 0..40 {
            let mut walker = Walker::new(fit.clone());
            walker.config.delay = 6;
            let turn = |walker: &mut Walker| walker.yaw += 1.5_f32.to_radians();
            for _ in 0..before {
                walker.plan(&nothing);
                turn(&mut walker);
            }
            let mut drawn = [None; 4];
            for frame in 0..10 {
                let changes = if frame == 0 {
                    &CasterChanges::Anywhere
                } else {
                    &nothing
                };
                for (first, redraw) in drawn.iter_mut().zip(reasons(&walker.plan(changes))) {
                    *first = first.or(redraw);
                }
                turn(&mut walker);
            }
            let is_anew = |redraw: &Option<Redraw>| redraw.is_some_and(|it| it != Redraw::Added);
            assert!(drawn.iter().all(is_anew), "{fit:?} {before}: {drawn:?}");
        }
    }
}

#[test]
fn casters_that_have_changed_are_drawn_though_their_map_waits() {
    let nothing = CasterChanges::At(Vec::new());
    let mut walker = Walker::new(CascadeFit::Steady);
    walker.config.delay = 8;
    walker.plan(&nothing);
    walker.plan(&nothing);
    let drawn: Vec<_> = (0..12)
        .map(|frame| {
            let changes = if frame == 0 {
                &CasterChanges::Anywhere
            } else {
                &nothing
            };
            reasons(&walker.plan(changes)).iter().flatten().count()
        })
        .collect();
    assert_eq!(drawn[..4], [1; 4]);
    assert_eq!(drawn[4..], [0; 8]);
}

/// What has come to rest is drawn over maps no more: those that it matters to now do not wait, though they do not hold it yet.
#[test]
fn what_comes_to_rest_is_added_at_once() {
    let nothing = CasterChanges::At(Vec::new());
    let mut in_several = 0;
    for fit in [CascadeFit::Steady, CascadeFit::Stable] {
        for step in 0..40 {
            let mut walker = Walker::new(fit.clone());
            walker.config.delay = 6;
            walker.yaw = 0.1 * step as f32;
            walker.plan(&nothing);
            walker.plan(&nothing);
            walker.yaw += 9.0_f32.to_radians();
            // High up, so that it matters to several.
            let aside = 0.4 + 0.1 * (step % 8) as f32;
            let aside = Quat::from_rotation_y(walker.yaw + aside) * Vec3::NEG_Z;
            let bounds = OrientedBox {
                center: walker.eye + 40.0 * aside.as_dvec3(),
                half_axes: DMat3::from_diagonal(DVec3::new(10.0, 30.0, 10.0)),
            };
            let at_once = CasterChanges::AtOnce(Some(vec![bounds]));
            let plans = walker.plan(&at_once);
            let maps = plans.iter().filter_map(|plan| plan.map.as_ref());
            let matters = maps.filter(|map| map.hull_now.intersects_box(&bounds));
            let drawn: Vec<_> = matters.map(|map| map.redraw).collect();
            assert!(
                drawn.iter().all(Option::is_some),
                "{fit:?} {step}: {drawn:?}"
            );
            in_several += usize::from(drawn.len() > 1 && drawn.contains(&Some(Redraw::Added)));
        }
    }
    assert!(in_several > 5, "{in_several}");
}

/// A box of a meter that comes.
fn comes(center: DVec3) -> (OrientedBox, CasterChanges) {
    let bounds = OrientedBox {
        center,
        half_axes: DMat3::from_diagonal(DVec3::splat(0.5)),
    };
    let come = CasterChanges::Come {
        changed: Vec::new(),
        come: vec![bounds],
        is_urgent: false,
    };
    (bounds, come)
}

#[test]
fn what_comes_is_drawn_over_what_maps_hold() {
    let nothing = CasterChanges::At(Vec::new());
    for fit in fits() {
        let mut walker = Walker::new(fit);
        walker.plan(&nothing);
        walker.plan(&nothing);
        let (_, behind) = comes(walker.eye - 200.0 * walker.forward());
        assert!(reasons(&walker.plan(&behind)).iter().all(Option::is_none));
        let (_, near) = comes(walker.eye + 6.0 * walker.forward());
        // Maps that many are added to are drawn anew, and rid of what matters no more.
        for time in 0..40 {
            let why = reasons(&walker.plan(&near));
            let expected = if time % 33 == 32 {
                Redraw::Moved
            } else {
                Redraw::Added
            };
            assert_eq!(why[0], Some(expected), "{time}");
            assert_eq!(why.last(), Some(&None), "{time}");
            assert!(reasons(&walker.plan(&nothing)).iter().all(Option::is_none));
        }
    }
}

/// Where a view looks to and fro, what comes meanwhile is missing nowhere, or no longer than maps may wait.
#[test]
fn what_comes_is_missing_from_no_map() {
    let nothing = CasterChanges::At(Vec::new());
    for (fit, delay) in fits()
        .into_iter()
        .flat_map(|fit| [(fit.clone(), 0), (fit, 5)])
    {
        let mut walker = Walker::new(fit.clone());
        walker.config.delay = delay;
        let mut there: Vec<OrientedBox> = Vec::new();
        // Of each map: which it holds, and for how long others have been missing.
        let mut held: Vec<(Vec<bool>, u32)> = Vec::new();
        let mut additions = 0;
        for frame in 0..400_u32 {
            walker.yaw = 0.9 * (0.05 * frame as f32).sin();
            walker.eye.x = 3.0 * (0.013 * f64::from(frame)).sin();
            let angle = 2.4 * frame as f32;
            let distance = 3.0 + f64::from(frame * 7 % 61);
            let towards = (Quat::from_rotation_y(angle) * Vec3::NEG_Z).as_dvec3();
            let (bounds, come) = comes(walker.eye + distance * towards);
            // Of those that are there one changes now and then, wherever it is.
            let changing = (frame % 7 == 6).then_some(31 * frame as usize % there.len().max(1));
            let changes = match (frame % 3, changing) {
                (2, _) => come,
                (_, Some(index)) => CasterChanges::At(vec![there[index]]),
                _ => nothing.clone(),
            };
            if frame % 3 == 2 {
                there.push(bounds);
            }
            let plans = walker.plan(&changes);
            held.resize(plans.len(), (Vec::new(), 0));
            for (plan, (held, missing)) in plans.iter().zip(&mut held) {
                held.resize(there.len(), false);
                let Some(map) = &plan.map else {
                    continue;
                };
                let holds = |it: &OrientedBox| map.hull.intersects_box(it);
                let is_anew = map.redraw.is_some_and(|why| why != Redraw::Added);
                if let CasterChanges::At(changed) = &changes
                    && let Some(index) = changing
                    && !changed.is_empty()
                    && delay == 0
                {
                    assert!(!held[index] || is_anew, "{fit:?}, frame {frame}");
                }
                match map.redraw {
                    None => {}
                    Some(Redraw::Added) => {
                        additions += 1;
                        for (held, it) in held.iter_mut().zip(&there) {
                            *held |= holds(it);
                        }
                    }
                    Some(_) => *held = there.iter().map(holds).collect(),
                }
                let mut needed = there.iter().zip(&*held);
                let lacks = needed.any(|(it, held)| !held && map.hull_now.intersects_box(it));
                *missing = if lacks { *missing + 1 } else { 0 };
                assert!(*missing <= delay, "{fit:?}, {delay}, frame {frame}");
            }
        }
        assert!(additions > 20, "{fit:?}, {delay}: {additions}");
    }
}

/// Maps that hold more than their hulls tell are not added to.
#[test]
fn without_culling_nothing_is_added() {
    let nothing = CasterChanges::At(Vec::new());
    let mut walker = Walker::new(CascadeFit::Stable);
    walker.config.comparison.culling = CasterCulling::Off;
    for _ in 0..60 {
        let why = reasons(&walker.plan(&nothing));
        assert!(!why.contains(&Some(Redraw::Added)));
        walker.yaw += 1.0_f32.to_radians();
    }
}
