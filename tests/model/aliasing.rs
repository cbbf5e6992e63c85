//! The error measure against reference values and closed forms.

use bevy::math::{DMat3, DMat4, DVec2, DVec3};
use bevy_pssm::{
    CascadeFit, MapWarp, ParallelSplitShadows, SplitScheme,
    geometry::{
        aliasing::{Aliasing, closed_form},
        body::ConvexBody,
        face,
        fit::LookupReach,
        light_frame::LightFrame,
        receivers::Receivers,
        slice::{BodyVertex, ViewVolume},
        warp::WarpFrame,
    },
    plan::{CasterChanges, PlanHistory, PlanInputs, plan_cascades, split_planes, warp_frame},
};

const REFERENCE: &str = include_str!("../reference/lloyd_storage.csv");

/// Directions in which light travels: from above, and from behind the camera.
const DOWN: DVec3 = DVec3::NEG_Y;
const AHEAD: DVec3 = DVec3::NEG_Z;

/// The camera of the reference: at the origin, square picture.
fn view(tan: f64) -> ViewVolume {
    ViewVolume {
        eye: DVec3::ZERO,
        axes: DMat3::IDENTITY,
        min: [DVec2::ZERO, DVec2::splat(-tan)],
        max: [DVec2::ZERO, DVec2::splat(tan)],
        near: 0.0,
        far: f64::INFINITY,
    }
}

fn body(tan: f64, near: f64, far: f64) -> [BodyVertex; 8] {
    view(tan).slice(near, far).unwrap().vertices()
}

fn storage(frame: &WarpFrame, body: &[BodyVertex], strength: f64) -> f64 {
    frame.worst_aliasing(body, strength).unwrap().storage()
}

/// One map per slice, warped as the plugin warps it.
fn warped(warp: MapWarp, planes: &[f64], tan: f64, light: DVec3) -> f64 {
    let view = view(tan);
    planes
        .windows(2)
        .map(|pair| {
            let slice = view.slice(pair[0], pair[1]).unwrap();
            let body = ConvexBody::of_slice(&slice);
            let (frame, strength) = warp_frame(warp, DVec3::NEG_Z, &view, -light, &body).unwrap();
            storage(&frame, &body.vertices(&view), strength)
        })
        .sum()
}

fn unwarped(planes: &[f64], tan: f64, light: DVec3) -> f64 {
    warped(MapWarp::Strength(0.0), planes, tan, light)
}

fn lispsm(planes: &[f64], tan: f64, light: DVec3) -> f64 {
    warped(MapWarp::Lispsm, planes, tan, light)
}

fn minimax(planes: &[f64], tan: f64, light: DVec3) -> f64 {
    warped(MapWarp::Minimax, planes, tan, light)
}

/// A map for each selected side of each slice, and one for the near face: storage and number
/// of maps.
fn of_faces(planes: &[f64], tan: f64, light: DVec3) -> (f64, usize) {
    let view = view(tan);
    let slices = planes
        .windows(2)
        .map(|pair| view.slice(pair[0], pair[1]).unwrap());
    let near = face::near(&view, &slices.clone().next().unwrap(), -light);
    let faces: Vec<_> = slices
        .flat_map(|slice| face::sides(&view, &slice, -light))
        .chain(near)
        .collect();
    let storage = |face: &face::Face| face.worst_aliasing().unwrap().storage();
    (faces.iter().map(storage).sum(), faces.len())
}

struct Case {
    line: &'static str,
    planes: Vec<f64>,
    tan: f64,
    light: DVec3,
    warped: bool,
    faces: bool,
    maps: usize,
    /// `S`, `S_minimax` and `S_best`.
    storage: [Option<f64>; 3],
}

fn reference() -> impl Iterator<Item = Case> {
    REFERENCE.lines().skip(1).map(|line| {
        let columns: Vec<&str> = line.split(',').collect();
        let number = |index: usize| columns[index].parse::<f64>();
        let [near, far, theta, partitions] = [1, 2, 3, 4].map(|index| number(index).unwrap());
        Case {
            line,
            planes: split_planes(&SplitScheme::Logarithmic, near, far, partitions as usize),
            tan: theta.to_radians().tan(),
            light: DVec3::from_array([5, 6, 7].map(|index| number(index).unwrap())).normalize(),
            warped: columns[8] == "1",
            faces: columns[9] == "1",
            maps: columns[10].parse().unwrap(),
            storage: [11, 12, 13].map(|index| number(index).ok()),
        }
    })
}

#[test]
fn storage_factors_equal_the_reference() {
    assert_eq!(reference().count(), 60);
    for case in reference() {
        let (planes, tan, light) = (&case.planes, case.tan, case.light);
        let (found, maps) = match (case.faces, case.warped) {
            (true, _) => of_faces(planes, tan, light),
            (false, true) => (lispsm(planes, tan, light), planes.len() - 1),
            (false, false) => (unwarped(planes, tan, light), planes.len() - 1),
        };
        let expected = case.storage[0].unwrap();
        let error = ((found - expected) / expected).abs();
        let line = case.line;
        assert!(error <= 1e-9, "{line}: found {found}, off by {error:e}");
        assert_eq!(maps, case.maps, "{line}");
    }
}

#[test]
fn minimax_storage_equals_the_reference_and_is_close_to_the_best() {
    let mut rows = 0;
    for case in reference() {
        let [Some(_), Some(expected), Some(best)] = case.storage else {
            continue;
        };
        let (planes, tan, light) = (&case.planes, case.tan, case.light);
        let found = minimax(planes, tan, light);
        let error = ((found - expected) / expected).abs();
        let line = case.line;
        assert!(error <= 1e-6, "{line}: found {found}, off by {error:e}");
        assert!(found <= 1.19 * best, "{line}: found {found}");
        for any in [
            found,
            lispsm(planes, tan, light),
            unwarped(planes, tan, light),
        ] {
            assert!(any >= best * (1.0 - 1e-6), "{line}: found {any}");
        }
        rows += 1;
    }
    assert_eq!(rows, 20);
}

/// What the plugin plans for a light has those storage factors, map by map.
#[test]
fn planned_cascades_have_the_reference_storage() {
    let mut rows = 0;
    for case in reference().filter(|case| !case.faces && case.planes.len() <= 5) {
        let cascades = case.planes.len() - 1;
        // As settings hold them.
        let [near, far] = [case.planes[0] as f32, case.planes[cascades] as f32];
        let planes = split_planes(
            &SplitScheme::Logarithmic,
            f64::from(near),
            f64::from(far),
            cascades,
        );
        let view = ViewVolume {
            near: planes[0],
            ..view(case.tan)
        };
        let planned = |warp| -> f64 {
            let config = ParallelSplitShadows {
                cascades: cascades as u32,
                near,
                far,
                splits: SplitScheme::Logarithmic,
                blend: 0.0,
                fit: CascadeFit::Warped(warp),
                ..Default::default()
            };
            let inputs = PlanInputs {
                view: &view,
                light: &LightFrame::new(-case.light).unwrap(),
                config: &config,
                reach: LookupReach { texels: 0.0 },
                receivers: &Receivers::everywhere(&view),
                image_height: 1080.0,
                changes: &CasterChanges::Anywhere,
            };
            let plans = plan_cascades(&inputs, &mut PlanHistory::default());
            let storage = |plan: &bevy_pssm::plan::CascadePlan| {
                plan.map.as_ref().unwrap().aliasing.unwrap().storage()
            };
            plans.iter().map(storage).sum()
        };
        let [_, minimax, best] = case.storage;
        let as_printed = if case.warped {
            MapWarp::Lispsm
        } else {
            MapWarp::Strength(0.0)
        };
        let line = case.line;
        let found = planned(as_printed);
        // That equals the reference where planes are exact (`storage_factors_equal_the_reference`).
        let expected = warped(as_printed, &planes, case.tan, case.light);
        let error = (found / expected - 1.0).abs();
        assert!(error <= 1e-9, "{line}: found {found}");
        if let (Some(minimax), Some(best)) = (minimax, best) {
            let found = planned(MapWarp::Minimax);
            assert!((found / minimax - 1.0).abs() <= 1e-6, "{line}: {found}");
            assert!(found <= 1.19 * best, "{line}: {found}");
        }
        rows += 1;
    }
    assert!(rows >= 10, "{rows}");
}

#[test]
fn storage_factors_equal_the_closed_forms() {
    let near = 0.7;
    for (ratio, tan) in [(1000.0, 30_f64.to_radians().tan()), (12.0, 1.0), (5e4, 0.4)] {
        for k in 1..=8_u32 {
            let planes = split_planes(&SplitScheme::Logarithmic, near, near * ratio, k as usize);
            let pairs = [
                (
                    unwarped(&planes, tan, DOWN),
                    closed_form::overhead(ratio, tan, k),
                ),
                (
                    lispsm(&planes, tan, DOWN),
                    closed_form::overhead_warped(ratio, tan, k),
                ),
                (
                    minimax(&planes, tan, DOWN),
                    closed_form::overhead_warped(ratio, tan, k),
                ),
                (
                    of_faces(&planes, tan, DOWN).0,
                    closed_form::overhead_warped(ratio, tan, k),
                ),
                (lispsm(&planes, tan, AHEAD), closed_form::behind(ratio, k)),
                (minimax(&planes, tan, AHEAD), closed_form::behind(ratio, k)),
                (
                    of_faces(&planes, tan, AHEAD).0,
                    closed_form::behind_faces(ratio, k),
                ),
            ];
            for (found, expected) in pairs {
                approx::assert_relative_eq!(found, expected, max_relative = 1e-9);
            }
        }
    }
}

#[test]
fn resolutions_follow_from_the_worst_aliasing() {
    let worst = Aliasing { x: 3.0, z: 12.0 };
    let critical = worst.critical_resolution(800.0);
    assert_eq!(critical.to_array(), [2400.0, 9600.0]);
    let balanced = worst.balanced_resolution(4e6);
    approx::assert_relative_eq!(balanced.x * balanced.y, 4e6, max_relative = 1e-12);
    approx::assert_relative_eq!(balanced.y / balanced.x, 4.0, max_relative = 1e-12);
}

#[test]
fn places_without_an_image_have_no_aliasing() {
    let frame = WarpFrame::of_view(&view(0.5), DVec3::Y).unwrap();
    let map = frame.clip_from_world(&body(0.5, 1.0, 9.0), 0.5);
    let axes = [frame.x, frame.y];
    let behind_the_center = AHEAD * -5.0;
    assert_eq!(Aliasing::at(&map, axes, behind_the_center, 1.0), None);
    assert_eq!(Aliasing::at(&DMat4::ZERO, axes, AHEAD, 1.0), None);
    assert!(Aliasing::at(&map, axes, AHEAD * 4.0, 4.0).is_some());
}
