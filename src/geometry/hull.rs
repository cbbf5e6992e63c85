//! Which casters can matter to a slice: its convex hull swept towards the light.

use glam::{DMat3, DVec3};

use super::slice::Slice;

/// A half-space `normal · p <= distance` with an outward unit normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfSpace {
    /// Outward unit normal, in world space.
    pub normal: DVec3,
    /// Signed distance of the plane from the world's origin along the normal (metres).
    pub distance: f64,
}

/// Every place from which a caster can throw a shadow into a slice.
///
/// Faces that look away from the light bound the volume as they are; faces that look towards it
/// are dropped; every edge between the two kinds gives a plane parallel to the light.
/// At most six faces and six silhouette edges.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CasterHull {
    /// The bounding planes.
    pub planes: Vec<HalfSpace>,
}

/// Corner indices of a slice's six faces, in order round the face.
const FACES: [[usize; 4]; 6] = [
    [0, 1, 2, 3],
    [4, 5, 6, 7],
    [0, 1, 5, 4],
    [1, 2, 6, 5],
    [2, 3, 7, 6],
    [3, 0, 4, 7],
];

impl CasterHull {
    /// Sweeps `slice` towards the light, grown by `margin` metres on every side: what filters
    /// and offsets reach beyond a surface point. `to_light` is a unit vector.
    pub fn new(slice: &Slice, to_light: DVec3, margin: f64) -> Self {
        let inside = slice.corners.iter().sum::<DVec3>() / 8.0;
        let faces = FACES.map(|face| outward_normal(slice, face, inside));
        let mut planes = Vec::with_capacity(12);
        let mut push = |normal: DVec3| {
            // Taking the furthest corner keeps the hull conservative whatever rounding did.
            let distance = slice
                .corners
                .iter()
                .map(|c| normal.dot(*c))
                .fold(f64::NEG_INFINITY, f64::max);
            planes.push(HalfSpace {
                normal,
                distance: distance + margin,
            });
        };

        let kept = faces.map(|normal| normal.is_some_and(|n| n.dot(to_light) <= 0.0));
        for (normal, kept) in faces.iter().zip(kept) {
            if let (Some(normal), true) = (normal, kept) {
                push(*normal);
            }
        }
        for (i, j, [a, b]) in shared_edges() {
            if faces[i].is_none() || faces[j].is_none() || kept[i] == kept[j] {
                continue;
            }
            let edge = slice.corners[b] - slice.corners[a];
            let Some(normal) = edge.try_normalize().and_then(|e| {
                let n = e.cross(to_light);
                (n.length_squared() > 1e-12).then(|| n.normalize())
            }) else {
                continue;
            };
            let middle = (slice.corners[a] + slice.corners[b]) * 0.5;
            push(if normal.dot(middle - inside) < 0.0 {
                -normal
            } else {
                normal
            });
        }
        Self { planes }
    }

    /// Whether an oriented box can reach the hull. Conservative: never false for one that does.
    ///
    /// `half_axes` are the box's half-extents as three vectors in world space.
    pub fn intersects_box(&self, centre: DVec3, half_axes: &DMat3) -> bool {
        // A box that is not a number is outside of no plane.
        !self.planes.iter().any(|plane| {
            let reach = (half_axes.transpose() * plane.normal).abs().element_sum();
            plane.normal.dot(centre) - reach > plane.distance
        })
    }
}

/// `None` for a face without area (the near face of a slice that starts at the eye).
fn outward_normal(slice: &Slice, face: [usize; 4], inside: DVec3) -> Option<DVec3> {
    let [a, b, c, d] = face.map(|corner| slice.corners[corner]);
    let normal = (c - a).cross(d - b).try_normalize()?;
    Some(if normal.dot((a + c) * 0.5 - inside) < 0.0 {
        -normal
    } else {
        normal
    })
}

/// Pairs of faces with the edge that they share.
fn shared_edges() -> impl Iterator<Item = (usize, usize, [usize; 2])> {
    (0..6).flat_map(|i| {
        (i + 1..6).filter_map(move |j| {
            let mut shared = FACES[i]
                .into_iter()
                .filter(|corner| FACES[j].contains(corner));
            Some((i, j, [shared.next()?, shared.next()?]))
        })
    })
}
