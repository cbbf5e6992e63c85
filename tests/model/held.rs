//! Maps that stay as they are while they serve.

use bevy::math::{DMat3, DVec3, Quat, Vec3};
use bevy_pssm::{
    geometry::{
        fit::LookupReach, light_frame::LightFrame, oriented_box::OrientedBox, receivers::Receivers,
        slice::ViewVolume,
    },
    plan::{CascadePlan, CasterChanges, PlanHistory, PlanInputs, Redraw, plan_cascades},
    prelude::*,
};

use crate::views::{perspective, volume};

/// A camera over wide ground, and what it has been planned for.
struct Walker {
    eye: DVec3,
    yaw: f32,
    config: ParallelSplitShadows,
    to_light: DVec3,
    history: PlanHistory,
}

impl Walker {
    fn new(fit: CascadeFit) -> Self {
        Self {
            eye: DVec3::new(3.0, 1.7, -2.0),
            yaw: 0.3,
            config: ParallelSplitShadows {
                fit,
                ..Default::default()
            },
            to_light: DVec3::new(0.3, 0.7, -0.45),
            history: PlanHistory::default(),
        }
    }

    fn view(&self) -> ViewVolume {
        let turn = Quat::from_rotation_y(self.yaw);
        volume(&perspective(0.8, 1.6), self.eye.as_vec3(), turn)
    }

    fn plan(&mut self, changes: &CasterChanges) -> Vec<CascadePlan> {
        let view = self.view();
        let mut receivers = Receivers::new(&view);
        receivers.add(&OrientedBox {
            center: DVec3::ZERO,
            half_axes: DMat3::from_diagonal(DVec3::new(900.0, 0.1, 900.0)),
        });
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

    /// Maps drawn per frame, of those that there are, on a path.
    fn share_drawn(&mut self, frames: u32, step: impl Fn(&mut Self)) -> f64 {
        let nothing = CasterChanges::At(Vec::new());
        self.plan(&nothing);
        let [mut drawn, mut all] = [0; 2];
        for _ in 0..frames {
            step(self);
            let plans = self.plan(&nothing);
            let maps = plans.iter().filter_map(|plan| plan.map.as_ref());
            for map in maps {
                all += 1;
                drawn += usize::from(map.redraw.is_some());
            }
        }
        drawn as f64 / all as f64
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

#[test]
fn while_a_camera_moves_few_maps_are_drawn() {
    for (fit, most) in fits().into_iter().zip([
        [0.0, 0.01, 0.15, 0.06],
        [0.0, 0.01, 0.13, 0.08],
        // Fitted closely, it has little to spare.
        [0.0, 0.3, 0.5, 0.4],
    ]) {
        let share = |step: &dyn Fn(&mut Walker)| Walker::new(fit.clone()).share_drawn(600, step);
        let found = [
            share(&|_| ()),
            share(&|it| it.eye += it.forward() * (6.0 / 60.0)),
            share(&|it| it.yaw += (90.0_f32 / 60.0).to_radians()),
            share(&|it| it.eye += it.forward() * (50.0 / 60.0)),
        ];
        let is_few = found.iter().zip(&most).all(|(found, most)| found <= most);
        assert!(
            is_few,
            "{fit:?} draws {found:?} of its maps, {most:?} at most"
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
            if map.redraw.is_none() {
                continue;
            }
            drawn += 1;
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
    assert!(share < 0.11, "{share} of all maps drawn");
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
