//! A sun that moves: frames that turn no faster than it does, and maps that follow it in steps.

use bevy::math::{DMat3, DQuat, DVec2, DVec3, Quat};
use bevy_pssm::{
    geometry::{
        fit::LookupReach,
        light_frame::{LEVELING, LightFrame, angle_between},
        oriented_box::OrientedBox,
        receivers::Receivers,
    },
    plan::{CascadePlan, CasterChanges, PlanHistory, PlanInputs, Redraw, plan_cascades},
    prelude::*,
};
use proptest::prelude::*;

use crate::views::{perspective, volume};

fn unit() -> impl Strategy<Value = DVec3> {
    [-1.0..1.0, -1.0..1.0, -1.0..1.0_f64]
        .prop_map(DVec3::from)
        .prop_filter("a direction", |it| it.length_squared() > 0.01)
        .prop_map(DVec3::normalize)
}

/// Where a path goes through, if not anywhere.
fn landmark() -> impl Strategy<Value = DVec3> {
    prop_oneof![
        unit(),
        Just(DVec3::Y),
        Just(-DVec3::Y),
        unit().prop_map(|it| (it * DVec3::new(1.0, 0.0, 1.0) + 1e-9 * DVec3::X).normalize()),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10_000))]

    /// Over the zenith and the nadir, along the horizon, in loops.
    #[test]
    fn no_path_of_the_sun_makes_a_frame_jump(
        stations in prop::collection::vec(landmark(), 2..6),
        step in prop_oneof![1e-5..1e-3_f64, 1e-3..0.05_f64],
    ) {
        let mut frame = LightFrame::new(stations[0]).unwrap();
        for pair in stations.windows(2) {
            let [from, to] = [pair[0], pair[1]];
            let whole = angle_between(from, to);
            let axis = from.cross(to).try_normalize().unwrap_or(from.any_orthonormal_vector());
            let steps: f64 = (whole / step).ceil();
            let steps = steps.min(300.0);
            for index in 1..=steps as usize {
                let turned = whole * index as f64 / steps;
                let to_light = DQuat::from_axis_angle(axis, turned) * from;
                let next = frame.following(to_light).unwrap();
                let moved = angle_between(frame.z, next.z);
                let most = (1.0 + LEVELING) * moved + 1e-12;
                prop_assert!(angle_between(frame.x, next.x) <= most);
                prop_assert!(angle_between(frame.y, next.y) <= most);
                let rotation = next.world_from_light();
                let off = rotation * rotation.transpose() - DMat3::IDENTITY;
                prop_assert!(off.to_cols_array().iter().all(|it| it.abs() < 1e-12));
                prop_assert!((rotation.determinant() - 1.0).abs() < 1e-12);
                // The same sun has the same frame, to the bit.
                prop_assert_eq!(next.following(to_light), Some(next));
                frame = next;
            }
        }
    }
}

/// The direction to a sun (degrees).
fn sun_at(azimuth: f64, elevation: f64) -> DVec3 {
    let (sin, cos) = elevation.to_radians().sin_cos();
    let (x, z) = azimuth.to_radians().sin_cos();
    DVec3::new(x * cos, sin, z * cos)
}

/// Below 50° of elevation a sun that goes across the sky has level maps, as one that stands there has.
#[test]
fn frames_of_low_suns_are_level() {
    for elevation in [5.0, 30.0, 49.0] {
        let mut frame = LightFrame::new(sun_at(0.0, elevation)).unwrap();
        for step in 1..720 {
            let to_light = sun_at(0.5 * f64::from(step), elevation);
            frame = frame.following(to_light).unwrap();
            assert_eq!(frame.x.y, 0.0);
        }
        let fresh = LightFrame::new(frame.z).unwrap();
        assert!(frame.x.abs_diff_eq(fresh.x, 1e-12));
    }
}

/// A sun that goes over the zenith and down leaves its frame on its head, and level.
#[test]
fn frames_do_not_turn_half_about() {
    let first = LightFrame::new(sun_at(90.0, 30.0)).unwrap();
    let mut frame = first;
    for elevation in 31..=150 {
        let to_light = sun_at(90.0, f64::from(elevation));
        frame = frame.following(to_light).unwrap();
        assert!(frame.x.abs_diff_eq(first.x, 1e-9), "{elevation}: {frame:?}");
    }
}

/// The higher the light stands, the less a frame turns about it to become level.
#[test]
fn frames_of_high_suns_hardly_turn() {
    for elevation in [20.0, 50.0, 80.0_f64] {
        let level = LightFrame::new(sun_at(0.0, elevation)).unwrap();
        let tilt = DQuat::from_axis_angle(level.z, 1.0);
        let (x, y) = (tilt * level.x, tilt * level.y);
        let frame = LightFrame { x, y, ..level };
        let next = frame.following(sun_at(1.0, elevation)).unwrap();
        let carried = DQuat::from_rotation_arc(frame.z, next.z) * frame.x;
        let share = elevation.to_radians().cos().powi(2);
        let most = LEVELING * share * angle_between(frame.z, next.z);
        let turned = angle_between(carried, next.x);
        approx::assert_relative_eq!(turned, most, max_relative = 1e-6);
    }
}

/// A camera that rests over wide ground, while the sun moves.
struct Day {
    eye: DVec3,
    /// How far the ground reaches (meters).
    reach: f64,
    config: ParallelSplitShadows,
    history: PlanHistory,
}

impl Day {
    fn new(fit: CascadeFit, sun_step: f32, eye: DVec3) -> Self {
        Self {
            eye,
            reach: 900.0,
            config: ParallelSplitShadows {
                fit,
                sun_step,
                ..Default::default()
            },
            history: PlanHistory::default(),
        }
    }

    /// The sun goes from east to west through the zenith (degrees).
    fn to_light(elevation: f64) -> DVec3 {
        let (sin, cos) = elevation.to_radians().sin_cos();
        DVec3::new(cos, sin, 0.1 * cos).normalize()
    }

    fn plan(&mut self, to_light: DVec3) -> Vec<CascadePlan> {
        let view = volume(
            &perspective(0.8, 1.6),
            self.eye.as_vec3(),
            Quat::from_rotation_y(0.3),
        );
        let mut receivers = Receivers::new(&view);
        receivers.add(&OrientedBox {
            center: self.eye * DVec3::new(1.0, 0.0, 1.0),
            half_axes: DMat3::from_diagonal(DVec3::new(self.reach, 0.1, self.reach)),
        });
        let inputs = PlanInputs {
            view: &view,
            light: &LightFrame::new(to_light).unwrap(),
            config: &self.config,
            reach: LookupReach { texels: 3.0 },
            receivers: &receivers,
            image_height: 1080.0,
            changes: &CasterChanges::At(Vec::new()),
        };
        plan_cascades(&inputs, &mut self.history)
    }
}

fn drawn(plans: &[CascadePlan]) -> usize {
    let maps = plans.iter().filter_map(|plan| plan.map.as_ref());
    maps.filter(|map| map.redraw.is_some()).count()
}

/// The direction to the light that a map was laid for.
fn light_of(plan: &CascadePlan) -> DVec3 {
    let map = plan.map.as_ref().expect("a map");
    map.world_from_cascade.z_axis.truncate().normalize()
}

const FITS: [CascadeFit; 3] = [CascadeFit::Stable, CascadeFit::Steady, CascadeFit::Tight];

/// A day of twenty minutes: 0.3 degrees per second.
const PER_FRAME: f64 = 0.3 / 60.0;

/// Steps that coarse maps take instead of one of 0.05°: what moves the shadow of what is 10 m away by a texel, up
/// to four times as large (degrees).
fn step_of(plan: &CascadePlan) -> f64 {
    let texel = plan.map.as_ref().expect("a map").texel.min_element();
    (texel / 10.0).to_degrees().clamp(0.05, 0.2)
}

#[test]
fn maps_follow_the_sun_in_steps_and_in_turn() {
    for fit in FITS {
        let mut day = Day::new(fit, 0.05, DVec3::new(3.0, 1.7, -2.0));
        let mut total = 0;
        let mut expected = 0.0;
        let mut sizes = Vec::new();
        for frame in 0..1200 {
            let to_light = Day::to_light(30.0 + PER_FRAME * f64::from(frame));
            let plans = day.plan(to_light);
            for plan in &plans {
                let error = angle_between(light_of(plan), to_light).to_degrees();
                assert!(error <= 0.65 * step_of(plan), "{error}");
            }
            let now = drawn(&plans);
            if frame == 0 {
                sizes = plans.iter().map(step_of).collect();
                continue;
            }
            // One map after the other.
            assert!(now <= 1, "{now}");
            total += now;
            // It goes from six tenths of a step behind to half a step ahead.
            let steps = plans.iter().map(step_of);
            expected += steps.map(|step| PER_FRAME / (1.1 * step)).sum::<f64>();
        }
        let share = f64::from(u32::try_from(total).unwrap()) / expected;
        assert!((0.9..=1.1).contains(&share), "{total}, not {expected}");
        // There are finer maps and coarser ones.
        assert!(sizes[0] < 0.11 && sizes[3] == 0.2, "{sizes:?}");
    }
}

/// Not even for a frame, when most of what was seen has gone.
#[test]
fn maps_that_become_finer_are_as_close_to_the_sun_as_fine_ones() {
    let mut found = 0;
    for start in 0..40 {
        let mut day = Day::new(CascadeFit::Tight, 0.05, DVec3::new(3.0, 1.7, -2.0));
        let to_light = |frame: u32| Day::to_light(30.0 + PER_FRAME * f64::from(40 + start + frame));
        (0..40 + start).for_each(|frame| {
            day.plan(Day::to_light(30.0 + PER_FRAME * f64::from(frame)));
        });
        day.reach = 15.0;
        for frame in 0..4 {
            for plan in day
                .plan(to_light(frame))
                .iter()
                .filter(|plan| plan.map.is_some())
            {
                let error = angle_between(light_of(plan), to_light(frame)).to_degrees();
                assert!(error <= 1.001 * step_of(plan), "{error} in frame {frame}");
                found += 1;
            }
        }
    }
    assert!(found > 300, "{found}");
}

/// In a day of twenty minutes, however fine maps are.
#[test]
fn nine_of_ten_maps_need_not_be_drawn_for_the_sun() {
    let mut day = Day::new(CascadeFit::Steady, 0.05, DVec3::new(3.0, 1.7, -2.0));
    day.config.far = 30.0;
    day.config.map_size = MapSize::Same(8192);
    let mut frames = (0..1200).map(|frame| {
        let plans = day.plan(Day::to_light(30.0 + PER_FRAME * f64::from(frame)));
        assert!(plans.iter().all(|plan| step_of(plan) == 0.05));
        drawn(&plans)
    });
    assert_eq!(frames.next(), Some(4));
    let drawn: usize = frames.sum();
    assert!(drawn < 1199 * 4 / 10, "{drawn}");
}

#[test]
fn without_steps_maps_are_those_of_the_sun() {
    let mut day = Day::new(CascadeFit::Steady, 0.0, DVec3::new(3.0, 1.7, -2.0));
    for frame in 0..60 {
        let to_light = Day::to_light(30.0 + PER_FRAME * f64::from(frame));
        let plans = day.plan(to_light);
        assert_eq!(drawn(&plans), 4);
        for plan in &plans {
            assert!(angle_between(light_of(plan), to_light) < 1e-12);
            let redraw = plan.map.as_ref().unwrap().redraw;
            let expected = if frame == 0 {
                Redraw::New
            } else {
                Redraw::Light
            };
            assert_eq!(redraw, Some(expected));
        }
    }
}

#[test]
fn a_sun_that_jumps_is_followed_at_once() {
    for to in [33.0, 45.0] {
        let mut day = Day::new(CascadeFit::Steady, 1.0, DVec3::new(3.0, 1.7, -2.0));
        day.plan(Day::to_light(30.0));
        let to_light = Day::to_light(to);
        let plans = day.plan(to_light);
        assert_eq!(drawn(&plans), 4);
        let mut off = plans
            .iter()
            .map(|plan| angle_between(light_of(plan), to_light));
        assert!(off.all(|off| off < 1e-12));
        assert_eq!(drawn(&day.plan(to_light)), 0);
    }
}

/// Its maps are those of one that has always stood there, though the frame that it had has turned.
#[test]
fn a_sun_that_jumps_has_a_frame_of_its_own() {
    let mut day = Day::new(CascadeFit::Stable, 0.0, DVec3::new(3.0, 1.7, -2.0));
    let mut axis_at = |elevation: f64| {
        let to_light = Day::to_light(elevation);
        let map = day.plan(to_light)[0].map.clone().expect("a map");
        let fresh = LightFrame::new(to_light).unwrap();
        map.world_from_cascade.x_axis.truncate().dot(fresh.x)
    };
    // Over the zenith, and on its head.
    let turned = [80.0, 85.0, 90.0, 95.0, 100.0].map(&mut axis_at)[4];
    approx::assert_relative_eq!(turned, -1.0, epsilon = 1e-9);
    approx::assert_relative_eq!(axis_at(145.0), 1.0, epsilon = 1e-9);
}

/// Wherever the sun stops, maps are drawn no more.
#[test]
fn a_sun_that_rests_costs_nothing() {
    for stop in 0..40 {
        let mut day = Day::new(CascadeFit::Steady, 0.05, DVec3::new(3.0, 1.7, -2.0));
        let mut to_light = DVec3::Y;
        for frame in 0..20 + stop {
            to_light = Day::to_light(30.0 + PER_FRAME * f64::from(frame));
            day.plan(to_light);
        }
        let drawn: Vec<_> = (0..20).map(|_| drawn(&day.plan(to_light))).collect();
        assert_eq!(drawn[8..], [0; 12], "{stop}: {drawn:?}");
    }
}

/// Nor, without steps, while a camera moves.
#[test]
fn a_sun_that_rests_has_no_map_drawn_for_a_walk() {
    for start in 0..20 {
        let mut day = Day::new(CascadeFit::Steady, 0.0, DVec3::new(3.0, 1.7, -2.0));
        let mut to_light = DVec3::Y;
        for frame in start..start + 4 {
            to_light = Day::to_light(30.0 + 0.37 * f64::from(frame));
            day.plan(to_light);
        }
        let drawn: usize = (0..60)
            .map(|_| {
                day.eye.x += 0.02;
                drawn(&day.plan(to_light))
            })
            .sum();
        assert!(drawn <= 4, "{start}: {drawn}");
    }
}

/// How far texels move under the middle of what a map is for (texels), at most, from frame to frame in
/// which it keeps its texels' size.
fn texels_move(fit: &CascadeFit, eye: DVec3, from: f64) -> f64 {
    let mut day = Day::new(fit.clone(), 0.0, eye);
    let mut last: Vec<CascadePlan> = Vec::new();
    let mut most = 0.0_f64;
    for frame in 0..120 {
        let plans = day.plan(Day::to_light(from + PER_FRAME * f64::from(frame)));
        for (now, last) in plans.iter().zip(&last) {
            let (Some(now_map), Some(last_map)) = (&now.map, &last.map) else {
                continue;
            };
            if !now_map.texel.abs_diff_eq(last_map.texel, 1e-9) {
                continue;
            }
            let middle = last_map
                .clip_from_world
                .inverse()
                .project_point3(DVec3::new(0.0, 0.0, 0.5));
            let texels = |map: &bevy_pssm::plan::CascadeMap| {
                0.5 * map.clip_from_world.project_point3(middle).truncate()
                    * now.map_size.as_dvec2()
            };
            let moved: DVec2 = texels(now_map) - texels(last_map);
            most = most.max((moved - moved.round()).abs().max_element());
        }
        last = plans;
    }
    most
}

/// How far shadows of what is a meter high reach, along the world's X and Z (meters).
fn tangents(plan: &CascadePlan) -> DVec2 {
    let z = light_of(plan);
    DVec2::new(z.x, z.z) / z.y
}

/// However the sun moves over level ground, down to 6°, texels stay where they are on it.
#[test]
fn texels_that_stand_on_the_ground_stay() {
    for fit in FITS {
        for distance in [0.0, 40e3] {
            let mut day = Day::new(fit.clone(), 0.05, DVec3::new(distance, 1.7, -2.0));
            day.config.grid = TexelGrid::Ground;
            let mut last: Vec<CascadePlan> = Vec::new();
            let mut kept = 0;
            for frame in 0..900 {
                // From 9° over the zenith to 6.3° on the other side.
                let elevation = 9.0 + 0.1825 * f64::from(frame);
                let plans = day.plan(Day::to_light(elevation));
                for (now, last) in plans.iter().zip(&last) {
                    let (Some(map), Some(last_map)) = (&now.map, &last.map) else {
                        continue;
                    };
                    if !map.texel.abs_diff_eq(last_map.texel, 1e-9) {
                        continue;
                    }
                    kept += 1;
                    for offset in [DVec3::ZERO, DVec3::new(7.0, 0.0, -9.0)] {
                        let point = day.eye * DVec3::new(1.0, 0.0, 1.0) + offset;
                        let texels = |map: &bevy_pssm::plan::CascadeMap| {
                            let ndc = map.clip_from_world.project_point3(point).truncate();
                            0.5 * (ndc + 1.0) * now.map_size.as_dvec2()
                        };
                        let moved: DVec2 = texels(map) - texels(last_map);
                        let off = (moved - moved.round()).abs().max_element();
                        // The ground is given as 20 cm thick.
                        let [tangent, last_tangent] = [now, last].map(tangents);
                        let most = 0.11 * (tangent - last_tangent).abs() / map.texel;
                        assert!(
                            off <= most.max_element() + 1e-3,
                            "{fit:?} {elevation}: {off} texels"
                        );
                    }
                }
                last = plans;
            }
            assert!(kept > 3000, "{fit:?}: {kept}");
        }
    }
}

/// Wherever the world's origin is, and through the zenith: grids turn about what is seen.
#[test]
fn texels_turn_about_what_is_seen() {
    for fit in FITS {
        for from in [30.0, 89.7] {
            let near = texels_move(&fit, DVec3::new(3.0, 1.7, -2.0), from);
            for distance in [8e3, 40e3] {
                let far = texels_move(&fit, DVec3::new(distance, 1.7, -0.5 * distance), from);
                assert!(
                    near < 0.2 && far < 1.1 * near + 0.01,
                    "{fit:?} {from}: {near} and {far} texels"
                );
            }
        }
    }
}
