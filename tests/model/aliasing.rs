//! The error measure against reference values and closed forms.

use bevy::math::{DMat3, DMat4, DVec2, DVec3};
use bevy_pssm::SplitScheme;
use bevy_pssm::geometry::{
    aliasing::{Aliasing, closed_form},
    face,
    slice::ViewVolume,
    split::split_planes,
    warp::{BodyVertex, WarpFrame, slice_vertices},
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
    slice_vertices(&view(tan).slice(near, far).unwrap())
}

fn storage(frame: &WarpFrame, body: &[BodyVertex], strength: f64) -> f64 {
    frame.worst_aliasing(body, strength).unwrap().storage()
}

/// One map per slice; `strength` is that of the slice between two depths.
fn of_slices(
    planes: &[f64],
    tan: f64,
    light: DVec3,
    strength: impl Fn(&WarpFrame, &[BodyVertex], f64, f64) -> f64,
) -> f64 {
    let frame = WarpFrame::of_view(&view(tan), -light).unwrap();
    planes
        .windows(2)
        .map(|pair| {
            let body = body(tan, pair[0], pair[1]);
            let strength = strength(&frame, &body, pair[0], pair[1]);
            storage(&frame, &body, strength)
        })
        .sum()
}

fn unwarped(planes: &[f64], tan: f64, light: DVec3) -> f64 {
    of_slices(planes, tan, light, |_, _, _, _| 0.0)
}

fn lispsm(planes: &[f64], tan: f64, light: DVec3) -> f64 {
    of_slices(planes, tan, light, |frame, _, near, far| {
        frame.lispsm_strength(near, far)
    })
}

fn minimax(planes: &[f64], tan: f64, light: DVec3) -> f64 {
    of_slices(planes, tan, light, |frame, body, _, _| {
        frame.minimax_strength(body)
    })
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
    let behind_the_centre = AHEAD * -5.0;
    assert_eq!(Aliasing::at(&map, axes, behind_the_centre, 1.0), None);
    assert_eq!(Aliasing::at(&DMat4::ZERO, axes, AHEAD, 1.0), None);
    assert!(Aliasing::at(&map, axes, AHEAD * 4.0, 4.0).is_some());
}
