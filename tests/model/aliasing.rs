//! The error measure against reference values and closed forms.

use bevy::math::{DMat4, DVec3, DVec4};
use bevy_pssm::SplitScheme;
use bevy_pssm::geometry::{
    aliasing::{Aliasing, closed_form},
    split::split_planes,
};

const REFERENCE: &str = include_str!("../reference/lloyd_storage.csv");

/// The camera of the reference: at the origin, square picture.
const VIEW: DVec3 = DVec3::NEG_Z;
const UP: DVec3 = DVec3::Y;

/// The plane that a map lies in: `y` is the warp's direction, the light comes from `z`.
#[derive(Clone, Copy)]
struct Frame {
    x: DVec3,
    y: DVec3,
}

impl Frame {
    fn new(light: DVec3, y: DVec3) -> Self {
        Self {
            x: y.cross(-light),
            y,
        }
    }

    /// Along the view direction, or along the camera's up where light and view are parallel.
    fn of_view(light: DVec3) -> Self {
        let across = |v: DVec3| v - v.dot(light) * light;
        let y = across(VIEW).try_normalize();
        let y = y.filter(|_| light.cross(VIEW).length() > 1e-6);
        Self::new(light, y.unwrap_or_else(|| across(UP).normalize()))
    }

    /// A map over the points, warped by `1 / epsilon` metres behind the nearest of them.
    fn map(self, points: &[DVec3], epsilon: f64) -> DMat4 {
        let range = |values: &mut dyn Iterator<Item = f64>| {
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), value| {
                (lo.min(value), hi.max(value))
            })
        };
        let (q0, q1) = range(&mut points.iter().map(|p| self.y.dot(*p)));
        let d = q1 - q0;
        let (u, q) = (self.x.extend(0.0), self.y.extend(-q0));
        let w = epsilon * q + DVec4::W;
        let at = |row: DVec4, p: &DVec3| row.dot(p.extend(1.0));
        let (s0, s1) = range(&mut points.iter().map(|p| at(u, p) / at(w, p)));
        let x = (2.0 * u - (s0 + s1) * w) / (s1 - s0);
        let y = 2.0 * (1.0 + epsilon * d) / d * q - w;
        DMat4::from_cols(x, y, 0.5 * w, w).transpose()
    }

    fn storage(self, points: &[DVec3], epsilon: f64, tan: f64) -> f64 {
        let map = self.map(points, epsilon);
        points
            .iter()
            .map(|p| {
                let width = 2.0 * tan * p.dot(VIEW);
                Aliasing::at(&map, [self.x, self.y], *p, width).expect("inside the map")
            })
            .reduce(Aliasing::max)
            .expect("there are points")
            .storage()
    }

    fn extent(self, axis: DVec3, points: &[DVec3]) -> f64 {
        let along = || points.iter().map(|p| axis.dot(*p));
        along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
    }
}

/// The corners of the cross-section at a depth, round the view direction.
fn corners(depth: f64, tan: f64) -> [DVec3; 4] {
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .map(|(x, y)| depth * (VIEW + tan * (x * DVec3::X + y * UP)))
}

fn slice(a: f64, b: f64, tan: f64) -> Vec<DVec3> {
    [corners(a, tan), corners(b, tan)].concat()
}

/// One map per slice.
fn of_slices(planes: &[f64], tan: f64, light: DVec3, warped: bool) -> f64 {
    let sine = light.cross(VIEW).length();
    let of_slice = |pair: &[f64]| {
        let (a, b) = (pair[0], pair[1]);
        let warps = warped && sine > 1e-6;
        let epsilon = if warps {
            sine / (a + (a * b).sqrt())
        } else {
            0.0
        };
        Frame::of_view(light).storage(&slice(a, b, tan), epsilon, tan)
    };
    planes.windows(2).map(of_slice).sum()
}

/// A map per slice of each side face that faces the light (or turns from it, if it comes from
/// the front), and one for the near face: storage and number of maps.
fn of_faces(planes: &[f64], tan: f64, light: DVec3) -> (f64, usize) {
    let behind = VIEW.dot(light) >= 0.0;
    let (mut storage, mut maps) = (0.0, 0);
    let near = corners(planes[0], tan);
    for side in 0..4 {
        let edges = [near[side], near[(side + 1) % 4]];
        let normal = edges[1].cross(edges[0]).normalize();
        let normal = normal
            * normal
                .dot(edges[0] + edges[1] - 2.0 * planes[0] * VIEW)
                .signum();
        let facing = normal.dot(-light);
        if facing.abs() < 1e-9 || (facing > 0.0) != behind {
            continue;
        }
        let across = |e: DVec3| {
            let e = e.normalize();
            (e - e.dot(light) * light).normalize()
        };
        let frame = Frame::new(light, (across(edges[0]) + across(edges[1])).normalize());
        for pair in planes.windows(2) {
            let quad = [edges[0], edges[1]].map(|e| e / planes[0]);
            let quad: Vec<DVec3> = pair.iter().flat_map(|z| quad.map(|e| e * *z)).collect();
            let d = frame.extent(frame.y, &quad);
            let epsilon = ((pair[1] / pair[0]).sqrt() - 1.0) / d;
            storage += frame.storage(&quad, epsilon, tan);
            maps += 1;
        }
    }
    if VIEW.dot(light) != 0.0 {
        let frame = Frame::new(light, (UP - UP.dot(light) * light).normalize());
        let area = frame.extent(frame.x, &near) * frame.extent(frame.y, &near);
        storage += area / (2.0 * planes[0] * tan).powi(2);
        maps += 1;
    }
    (storage, maps)
}

#[test]
fn storage_factors_equal_the_reference() {
    let mut rows = 0;
    for line in REFERENCE.lines().skip(1) {
        let columns: Vec<&str> = line.split(',').collect();
        let number = |index: usize| columns[index].parse::<f64>().unwrap();
        let (near, far, tan) = (number(1), number(2), number(3).to_radians().tan());
        let partitions = number(4) as usize;
        let light = DVec3::new(number(5), number(6), number(7)).normalize();
        let planes = split_planes(&SplitScheme::Logarithmic, near, far, partitions);
        let (found, maps) = if columns[9] == "1" {
            of_faces(&planes, tan, light)
        } else {
            (
                of_slices(&planes, tan, light, columns[8] == "1"),
                partitions,
            )
        };
        let expected = number(11);
        let error = ((found - expected) / expected).abs();
        assert!(error <= 1e-9, "{line}: found {found}, off by {error:e}");
        assert_eq!(maps, number(10) as usize, "{line}");
        rows += 1;
    }
    assert_eq!(rows, 60);
}

#[test]
fn storage_factors_equal_the_closed_forms() {
    let near = 0.7;
    for (ratio, tan) in [(1000.0, 30_f64.to_radians().tan()), (12.0, 1.0), (5e4, 0.4)] {
        for partitions in 1..=8_u32 {
            let planes = split_planes(
                &SplitScheme::Logarithmic,
                near,
                near * ratio,
                partitions as usize,
            );
            let pairs = [
                (
                    of_slices(&planes, tan, DVec3::NEG_Y, false),
                    closed_form::overhead(ratio, tan, partitions),
                ),
                (
                    of_slices(&planes, tan, DVec3::NEG_Y, true),
                    closed_form::overhead_warped(ratio, tan, partitions),
                ),
                (
                    of_slices(&planes, tan, VIEW, true),
                    closed_form::behind(ratio, partitions),
                ),
                (
                    of_faces(&planes, tan, VIEW).0,
                    closed_form::behind_faces(ratio, partitions),
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
    let frame = Frame::of_view(DVec3::NEG_Y);
    let points = slice(1.0, 9.0, 0.5);
    let map = frame.map(&points, 0.5);
    let axes = [frame.x, frame.y];
    let behind_the_centre = VIEW * -5.0;
    assert_eq!(Aliasing::at(&map, axes, behind_the_centre, 1.0), None);
    assert_eq!(Aliasing::at(&DMat4::ZERO, axes, VIEW, 1.0), None);
    assert!(Aliasing::at(&map, axes, VIEW * 4.0, 4.0).is_some());
}
