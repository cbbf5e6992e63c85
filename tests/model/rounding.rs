//! What `f32` leaves of maps far from the origin.

use bevy::math::{DVec2, DVec3, EulerRot, Quat, Vec3};
use bevy_pssm::{
    geometry::{
        fit::LookupReach, light_frame::LightFrame, receivers::Receivers, slice::ViewVolume,
    },
    plan::{CascadeMap, CascadePlan, CasterChanges, PlanHistory, PlanInputs, plan_cascades},
    prelude::*,
};

use crate::{
    fitted::{Thing, receivers_of},
    views::{perspective, volume},
};

fn plan(
    view: &ViewVolume,
    to_light: DVec3,
    receivers: &Receivers,
    fit: CascadeFit,
) -> Vec<CascadePlan> {
    let config = ParallelSplitShadows {
        fit,
        ..Default::default()
    };
    let inputs = PlanInputs {
        view,
        light: &LightFrame::new(to_light).expect("a direction"),
        config: &config,
        reach: LookupReach { texels: 4.0 },
        receivers,
        image_height: 1080.0,
        changes: &CasterChanges::At(Vec::new()),
    };
    plan_cascades(&inputs, &mut PlanHistory::default())
}

/// Points of a cascade, as the GPU has them.
fn points(view: &ViewVolume, cascade: &CascadePlan) -> Vec<Vec3> {
    const STEPS: usize = 12;
    let share = |step: usize| (step as f64 + 0.5) / STEPS as f64;
    let near = cascade.near.max(view.near);
    let places = (0..STEPS * STEPS * STEPS).map(|index| {
        let steps = [index / STEPS / STEPS, index / STEPS % STEPS, index % STEPS];
        let [x, y, z] = steps.map(share);
        let depth = near * (cascade.far / near).powf(z);
        let [lo, hi] = [view.min, view.max].map(|it| it[0] + depth * it[1]);
        let at = lo + (hi - lo) * DVec2::new(x, y);
        view.eye + view.axes * at.extend(-depth)
    });
    let is_within = |point: &DVec3| {
        let mut planes = cascade.wedge.iter().flat_map(|wedge| wedge.planes);
        planes.all(|plane| plane.normal.dot(*point) <= plane.distance)
    };
    places.filter(is_within).map(DVec3::as_vec3).collect()
}

/// By how much a point's place in any of the maps is off, at most, given the size of its texels.
fn worst_error(
    view: &ViewVolume,
    plans: &[CascadePlan],
    texel: impl Fn(&CascadeMap) -> DVec2,
) -> f64 {
    let mut worst = 0.0_f64;
    for cascade in plans {
        let Some(map) = &cascade.map else {
            continue;
        };
        let rounded_map = map.clip_from_world.as_mat4();
        for point in points(view, cascade) {
            let rounded = rounded_map.project_point3(point).as_dvec3();
            let exact = map.clip_from_world.project_point3(point.as_dvec3());
            let error = (rounded - exact).truncate() * 0.5 * cascade.map_size.as_dvec2();
            worst = worst.max((texel(map) * error).abs().max_element());
        }
    }
    worst
}

/// One of a number of views so far from the origin (meters), and the direction to the light there.
fn pose(index: u32, distance: f64) -> (ViewVolume, DVec3) {
    let pose = f64::from(index);
    let turn = Quat::from_euler(
        EulerRot::YXZ,
        (2.4 * pose) as f32,
        (0.5 * pose.sin() - 0.2) as f32,
        0.0,
    );
    let eye = DVec3::new(distance, 2.0, -distance / 3.0).as_vec3();
    let view = volume(&perspective(1.05, 1.333), eye, turn);
    let (y, azimuth) = (0.1 + 0.9 * (0.618 * pose).fract(), 1.7 * pose);
    (view, DVec3::new(azimuth.cos(), y, azimuth.sin()))
}

/// Kilometers from the origin a warp's places are no less sure than a tight map's, or off by about a
/// quarter of a texel.
#[test]
fn warps_are_no_finer_than_rounding() {
    for distance in [1e3, 1e4] {
        for index in 0..24 {
            let (view, to_light) = pose(index, distance);
            let receivers = Receivers::everywhere(&view);
            let error = |fit| {
                let plans = plan(&view, to_light, &receivers, fit);
                worst_error(&view, &plans, |_| DVec2::ONE)
            };
            let most = (3.0 * error(CascadeFit::Tight)).max(0.3);
            for fit in [
                CascadeFit::Faces,
                CascadeFit::Warped(MapWarp::Minimax),
                CascadeFit::Warped(MapWarp::Lispsm),
                CascadeFit::Warped(MapWarp::Strength(1.0)),
            ] {
                let found = error(fit.clone());
                assert!(
                    found <= most,
                    "{fit:?}, {distance} m, {index}: {found} {most}"
                );
            }
        }
    }
}

/// In meters, on average over views: in texels they are off by more only where those are smaller.
#[test]
fn fitted_maps_are_looked_up_as_exactly_as_stable_ones() {
    // Were receivers everywhere, steady maps would be laid as stable ones are.
    let everything = Thing {
        center: DVec3::ZERO,
        half: DVec3::splat(1e6),
    };
    for distance in [1e3, 1e4, 3e4] {
        let error = |fit: CascadeFit| -> f64 {
            let errors = (0..24).map(|index| {
                let (view, to_light) = pose(index, distance);
                let receivers = receivers_of(&view, &[everything]);
                let plans = plan(&view, to_light, &receivers, fit.clone());
                worst_error(&view, &plans, |map| map.texel)
            });
            errors.sum()
        };
        let stable = error(CascadeFit::Stable);
        for fit in [CascadeFit::Steady, CascadeFit::Tight] {
            let times = error(fit.clone()) / stable;
            assert!(
                times > 0.66 && times < 1.5,
                "{fit:?}, {distance} m: {times}"
            );
        }
    }
}

/// Near the origin nothing is held back.
#[test]
fn warps_are_as_strong_as_set_near_the_origin() {
    let view = volume(&perspective(1.05, 1.333), Vec3::Y, Quat::IDENTITY);
    let receivers = Receivers::everywhere(&view);
    let fit = CascadeFit::Warped(MapWarp::Strength(1.0));
    let plans = plan(&view, DVec3::Y, &receivers, fit);
    let first = plans[0].map.as_ref().expect("a map");
    approx::assert_relative_eq!(first.strength, 1.0, max_relative = 1e-6);
}
