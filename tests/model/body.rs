//! Convex bodies, clipped.

use bevy_pssm::geometry::{body::ConvexBody, half_space::HalfSpace};
use glam::{DQuat, DVec3};
use proptest::prelude::*;

fn unit_box() -> ConvexBody {
    ConvexBody::of_box(DVec3::ZERO, DVec3::ONE)
}

/// By the divergence theorem, face by face from the center.
fn volume(body: &ConvexBody) -> f64 {
    let center = body.corners.iter().sum::<DVec3>() / body.corners.len().max(1) as f64;
    body.faces()
        .map(|face| {
            let at = |i: usize| body.corners[face[i % face.len()]] - center;
            (1..face.len().saturating_sub(1))
                .map(|i| at(0).cross(at(i)).dot(at(i + 1)) / 6.0)
                .sum::<f64>()
                .abs()
        })
        .sum()
}

fn direction() -> impl Strategy<Value = DVec3> {
    (-1.0..1.0_f64, -1.0..1.0_f64, -1.0..1.0_f64)
        .prop_map(|(x, y, z)| DVec3::new(x, y, z))
        .prop_filter("a direction", |v| v.length() > 0.1)
        .prop_map(DVec3::normalize)
}

#[test]
fn a_corner_is_cut_off_a_box() {
    let normal = DVec3::ONE.normalize();
    let cut = unit_box().within([HalfSpace {
        normal,
        distance: normal.dot(DVec3::new(1.0, 1.0, 0.5)),
    }]);
    assert_eq!((cut.faces().len(), cut.corners.len()), (7, 10));
    assert!((volume(&cut) - (1.0 - 0.125 / 6.0)).abs() < 1e-12);
    // The corner is a 48th of the box, with its middle an eighth away from the corner's three sides.
    let rest = (24.0 - 0.875) / 47.0;
    assert!(cut.centroid().abs_diff_eq(DVec3::splat(rest), 1e-12));
}

#[test]
fn planes_through_corners_and_faces_leave_no_slivers() {
    let halves = [DVec3::new(1.0, 1.0, 0.0), DVec3::new(1.0, 0.0, 0.0)].map(|normal| HalfSpace {
        normal: normal.normalize(),
        distance: normal.normalize().dot(DVec3::new(1.0, 0.0, 0.0)),
    });
    let diagonal = unit_box().within([halves[0]]);
    assert_eq!((diagonal.faces().len(), diagonal.corners.len()), (5, 6));
    assert!((volume(&diagonal) - 0.5).abs() < 1e-12);
    assert_eq!(unit_box().within([halves[1]]), unit_box());
}

#[test]
fn nothing_is_left_beyond() {
    let beyond = HalfSpace {
        normal: DVec3::X,
        distance: -0.5,
    };
    assert!(unit_box().within([beyond]).is_empty());
    assert!(ConvexBody::of_box(DVec3::ONE, DVec3::ZERO).is_empty());
    assert!(ConvexBody::of_box(DVec3::ZERO, DVec3::INFINITY).is_empty());
}

proptest! {
    /// The two sides of a plane make up the whole, every edge belongs to two faces, and nothing
    /// sticks out.
    #[test]
    fn what_is_cut_is_not_lost(
        normals in prop::collection::vec((direction(), 0.2..0.8_f64), 1..5),
        turn in (-3.0..3.0_f64, -3.0..3.0_f64),
    ) {
        let turn = DQuat::from_rotation_x(turn.0) * DQuat::from_rotation_y(turn.1);
        let mut body = unit_box();
        for corner in &mut body.corners {
            *corner = turn * *corner;
        }
        for (normal, share) in normals {
            let (lo, hi) = body.corners.iter().map(|corner| normal.dot(*corner)).fold(
                (f64::INFINITY, f64::NEG_INFINITY),
                |(lo, hi), at| (lo.min(at), hi.max(at)),
            );
            let plane = HalfSpace { normal, distance: lo + share * (hi - lo) };
            let other = HalfSpace { normal: -normal, distance: -plane.distance };
            let parts = [body.clone().within([plane]), body.clone().within([other])];
            prop_assert!((volume(&parts[0]) + volume(&parts[1]) - volume(&body)).abs() < 1e-9);
            for corner in &parts[0].corners {
                prop_assert!(plane.normal.dot(*corner) <= plane.distance + 1e-9);
            }
            let mut edges: Vec<[usize; 2]> = parts[0]
                .faces()
                .flat_map(|face| (0..face.len()).map(|i| (face[i], face[(i + 1) % face.len()])))
                .map(|(a, b)| [a.min(b), a.max(b)])
                .collect();
            edges.sort_unstable();
            for pair in edges.chunks(2) {
                prop_assert!(pair.len() == 2 && pair[0] == pair[1], "{:?}", parts[0]);
            }
            body = parts[0].clone();
        }
    }
}
