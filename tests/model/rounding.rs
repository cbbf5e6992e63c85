//! What `f32` leaves of maps far from the origin.

use bevy::math::{DVec2, DVec3, EulerRot, Quat, Vec3};
use bevy_pssm::{
    geometry::{
        fit::LookupReach, light_frame::LightFrame, receivers::Receivers, slice::ViewVolume,
    },
    plan::{CascadePlan, CasterChanges, PlanHistory, PlanInputs, plan_cascades},
    prelude::*,
};

use crate::views::{perspective, volume};

fn plan(view: &ViewVolume, to_light: DVec3, fit: CascadeFit) -> Vec<CascadePlan> {
    let config = ParallelSplitShadows {
        fit,
        ..Default::default()
    };
    let inputs = PlanInputs {
        view,
        light: &LightFrame::new(to_light).expect("a direction"),
        config: &config,
        reach: LookupReach { texels: 4.0 },
        receivers: &Receivers::everywhere(view),
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

/// By how much a point's place in any of the maps is off, at most (texels).
fn worst_error(view: &ViewVolume, plans: &[CascadePlan]) -> f64 {
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
            worst = worst.max(error.abs().max_element());
        }
    }
    worst
}

/// Kilometers from the origin a warp's places are no less sure than a tight map's, or off by about a
/// quarter of a texel.
#[test]
fn warps_are_no_finer_than_rounding() {
    for distance in [1e3, 1e4] {
        for pose in 0..24 {
            let pose = f64::from(pose);
            let turn = Quat::from_euler(
                EulerRot::YXZ,
                (2.4 * pose) as f32,
                (0.5 * pose.sin() - 0.2) as f32,
                0.0,
            );
            let eye = DVec3::new(distance, 2.0, -distance / 3.0).as_vec3();
            let view = volume(&perspective(1.05, 1.333), eye, turn);
            let (y, azimuth) = (0.1 + 0.9 * (0.618 * pose).fract(), 1.7 * pose);
            let to_light = DVec3::new(azimuth.cos(), y, azimuth.sin());
            let error = |fit| worst_error(&view, &plan(&view, to_light, fit));
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
                    "{fit:?}, {distance} m, {pose}: {found} {most}"
                );
            }
        }
    }
}

/// Near the origin nothing is held back.
#[test]
fn warps_are_as_strong_as_set_near_the_origin() {
    let view = volume(&perspective(1.05, 1.333), Vec3::Y, Quat::IDENTITY);
    let plans = plan(&view, DVec3::Y, CascadeFit::Warped(MapWarp::Strength(1.0)));
    let first = plans[0].map.as_ref().expect("a map");
    approx::assert_relative_eq!(first.strength, 1.0, max_relative = 1e-6);
}
