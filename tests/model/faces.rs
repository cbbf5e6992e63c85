//! Faces of the view that have maps of their own: which, and how many slices they leave.

use bevy::math::{DVec3, Quat, Vec3};
use bevy_pssm::{
    geometry::{
        face::Wedge, fit::LookupReach, light_frame::LightFrame, receivers::Receivers,
        slice::ViewVolume,
    },
    plan::{CascadePlan, CasterChanges, PlanHistory, PlanInputs, plan_cascades},
    prelude::*,
};
use proptest::prelude::*;

use crate::views::{any_turn, perspective, volume};

/// A level view: light from straight above is edge-on to its left and right sides.
fn level() -> ViewVolume {
    volume(&perspective(1.05, 1.6), Vec3::ZERO, Quat::IDENTITY)
}

fn plan(to_light: DVec3, history: &mut PlanHistory) -> Vec<CascadePlan> {
    plan_for(Receivers::everywhere, to_light, history)
}

fn plan_for(
    receivers: fn(&ViewVolume) -> Receivers,
    to_light: DVec3,
    history: &mut PlanHistory,
) -> Vec<CascadePlan> {
    let view = level();
    let config = ParallelSplitShadows {
        fit: CascadeFit::Faces,
        ..Default::default()
    };
    let inputs = PlanInputs {
        view: &view,
        light: &LightFrame::new(to_light).expect("a direction"),
        config: &config,
        reach: LookupReach { texels: 4.0 },
        receivers: &receivers(&view),
        image_height: 1080.0,
        changes: &CasterChanges::At(Vec::new()),
    };
    plan_cascades(&inputs, history)
}

fn slices(plans: &[CascadePlan]) -> usize {
    let drawn = plans.iter().filter(|plan| plan.map.is_some());
    let mut ends: Vec<f64> = drawn.map(|plan| plan.far).collect();
    ends.dedup();
    ends.len()
}

#[test]
fn a_side_that_is_nearly_edge_on_gets_no_map() {
    for off in [0.0, 1e-12, 1e-8, 1e-4, 5e-3] {
        for to_light in [DVec3::new(off, 1.0, 0.0), DVec3::new(-off, 1.0, 0.0)] {
            assert_eq!(Wedge::of_view(&level(), to_light).len(), 1, "{to_light}");
            let plans = plan(to_light, &mut PlanHistory::default());
            assert_eq!(slices(&plans), 4, "{to_light}");
        }
    }
    let oblique = DVec3::new(0.1, 1.0, 0.0);
    assert_eq!(Wedge::of_view(&level(), oblique).len(), 2);
}

/// Fog looks its cascade up by depth alone.
#[test]
fn fog_has_no_faces() {
    let faces = |receivers: fn(&ViewVolume) -> Receivers| {
        let plans = plan_for(receivers, DVec3::Y, &mut PlanHistory::default());
        plans.iter().filter(|plan| plan.wedge.is_some()).count()
    };
    assert!(faces(Receivers::everywhere) > 0);
    assert_eq!(faces(Receivers::fog), 0);
}

/// Slices are as few as faces leave, and more once there have been fewer faces for ten seconds.
#[test]
fn slices_come_back_when_faces_are_gone() {
    let (one_face, two_faces) = (DVec3::Y, DVec3::new(0.3, 1.0, 0.0));
    let mut history = PlanHistory::default();
    let mut count = |to_light| slices(&plan(to_light, &mut history));
    assert_eq!(count(one_face), 4);
    assert_eq!(count(two_faces), 2);
    for frame in 0..500 {
        assert_eq!(count(one_face), 2, "{frame}");
    }
    // As soon as there are more again, there is nothing to wait for.
    assert_eq!(count(two_faces), 2);
    let frames = (0..1000).take_while(|_| count(one_face) == 2).count();
    assert!((500..700).contains(&frames), "{frames}");
    assert_eq!(count(one_face), 4);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(5_000))]

    /// Whatever the light is nearly parallel to, a side or an edge: all that is seen has a map.
    #[test]
    fn wedges_make_up_the_view(
        turn in any_turn(),
        fov in 0.1..2.2_f32,
        aspect in 0.4..3.0_f32,
        corner in 0..4_usize,
        along in prop_oneof![Just(0.0), -2.0..3.0_f64],
        off in prop::array::uniform3(-1.0..1.0_f64),
        digits in 1.0..12.0_f64,
        behind in any::<bool>(),
        places in prop::collection::vec(prop::array::uniform2(0.01..0.99_f64), 20),
    ) {
        let view = volume(&perspective(fov, aspect), Vec3::ZERO, turn);
        let corners = view.slice(1.0, 2.0).expect("a slice").corners;
        let in_plane = corners[corner].lerp(corners[(corner + 1) % 4], along);
        let away = in_plane + DVec3::from(off) * 10_f64.powf(-digits);
        let wedges = Wedge::of_view(&view, if behind { -away } else { away });
        for [x, y] in places {
            let below = corners[4].lerp(corners[5], x);
            let point = below.lerp(corners[7].lerp(corners[6], x), y);
            let holds = |wedge: &Wedge| {
                wedge.planes.iter().all(|it| it.normal.dot(point) <= it.distance + 1e-9)
            };
            prop_assert!(wedges.iter().any(holds), "{} {} {:?}", away, point, wedges);
        }
    }
}
