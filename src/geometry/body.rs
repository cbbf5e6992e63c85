//! Convex bodies, clipped exactly: the part of a slice in which a scene holds anything.

use glam::DVec3;

use super::{
    half_space::HalfSpace,
    slice::{BodyVertex, Slice, ViewVolume},
};

/// A bounded convex body: corners, and faces as rings of their indices.
///
/// Neighboring faces share corners by index, so that every edge is found from both sides.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ConvexBody {
    /// Corners, in world space.
    pub corners: Vec<DVec3>,
    /// Indices of the faces' corners, face by face, and where in them each face ends.
    rings: Vec<usize>,
    ends: Vec<usize>,
}

/// Corner indices of a slice's or a box's six faces, in order round the face.
const FACES: [[usize; 4]; 6] = [
    [0, 1, 2, 3],
    [4, 5, 6, 7],
    [0, 1, 5, 4],
    [1, 2, 6, 5],
    [2, 3, 7, 6],
    [3, 0, 4, 7],
];

/// Corners this close to a plane lie on it (as a share of the body's size).
const ON_PLANE: f64 = 1e-9;

/// And those this close (as a share of the distance from the world's origin): rounding moves them so far.
pub(crate) const ROUNDING: f64 = 8.0 * f64::EPSILON;

impl ConvexBody {
    /// The whole slice.
    pub fn of_slice(slice: &Slice) -> Self {
        Self::of_corners(slice.corners)
    }

    /// A box between two corners, in world space; nothing if they are not in order.
    pub fn of_box(min: DVec3, max: DVec3) -> Self {
        if !(min.cmple(max).all() && min.is_finite() && max.is_finite()) {
            return Self::default();
        }
        let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
        let quad = |z: f64| {
            [
                at(min.x, min.y, z),
                at(max.x, min.y, z),
                at(max.x, max.y, z),
                at(min.x, max.y, z),
            ]
        };
        let [a, b] = [quad(min.z), quad(max.z)];
        Self::of_corners([a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]])
    }

    fn of_corners(corners: [DVec3; 8]) -> Self {
        Self {
            corners: corners.to_vec(),
            rings: FACES.concat(),
            ends: (1..=FACES.len()).map(|face| 4 * face).collect(),
        }
    }

    /// Its corners as a view sees them.
    pub fn vertices(&self, view: &ViewVolume) -> Vec<BodyVertex> {
        let per_depth = view.per_depth();
        let vertex = |corner: &DVec3| BodyVertex {
            position: *corner,
            image_height: view.image_height(per_depth.dot(*corner - view.eye)),
        };
        self.corners.iter().map(vertex).collect()
    }

    /// The faces: indices of their corners, in order round each, in either direction.
    pub fn faces(&self) -> impl ExactSizeIterator<Item = &[usize]> {
        self.ends.iter().enumerate().map(|(face, end)| {
            let start = face.checked_sub(1).map_or(0, |before| self.ends[before]);
            &self.rings[start..*end]
        })
    }

    /// The half-spaces of its faces.
    pub fn planes(&self) -> impl Iterator<Item = HalfSpace> {
        let inside = self.center();
        self.faces().filter_map(move |face| {
            let normal = self.outward_normal(face, inside)?;
            // A face that is small beside the body has a normal of little precision: no corner may be
            // beyond it all the same.
            let distances = self.corners.iter().map(|corner| normal.dot(*corner));
            let distance = distances.fold(f64::NEG_INFINITY, f64::max);
            Some(HalfSpace { normal, distance })
        })
    }

    /// Newell's normal, for rings of any length; `None` for a face without area (the near face of
    /// a slice that starts at the eye).
    pub(super) fn outward_normal(&self, face: &[usize], inside: DVec3) -> Option<DVec3> {
        let corner = |i: usize| self.corners[face[i % face.len()]] - inside;
        let normal = (0..face.len())
            .map(|i| corner(i).cross(corner(i + 1)))
            .sum::<DVec3>()
            .try_normalize()?;
        Some(if normal.dot(corner(0)) < 0.0 {
            -normal
        } else {
            normal
        })
    }

    /// Whether nothing is left.
    pub fn is_empty(&self) -> bool {
        self.corners.is_empty()
    }

    /// The part within all half-spaces.
    pub fn within(mut self, planes: impl IntoIterator<Item = HalfSpace>) -> Self {
        let tolerance = self.tolerance();
        for plane in planes {
            let beyond = |corner: &DVec3| plane.normal.dot(*corner) - plane.distance;
            if self.corners.iter().any(|corner| beyond(corner) > tolerance) {
                self = self.clipped(plane, tolerance);
            }
        }
        self
    }

    /// The part in a half-space: empty, or a body with at least one corner, flat perhaps.
    fn clipped(self, plane: HalfSpace, tolerance: f64) -> Self {
        let beyond: Vec<f64> = self
            .corners
            .iter()
            .map(|corner| plane.normal.dot(*corner) - plane.distance)
            .map(|beyond| {
                if beyond.abs() <= tolerance {
                    0.0
                } else {
                    beyond
                }
            })
            .collect();
        if beyond.iter().all(|beyond| *beyond > 0.0) {
            return Self::default();
        }

        let mut cut = Cut::new(&self.corners, &beyond);
        let mut rings = Vec::with_capacity(self.rings.len() + 8);
        let mut ends = Vec::with_capacity(self.ends.len() + 1);
        for face in self.faces() {
            let start = rings.len();
            cut.face(face, &mut rings);
            if rings.len() > start + 2 {
                ends.push(rings.len());
            } else {
                rings.truncate(start);
            }
        }
        let cap = cut.cap(plane.normal);
        if cap.len() > 2 {
            rings.extend(cap);
            ends.push(rings.len());
        }
        Self {
            corners: cut.corners,
            rings,
            ends,
        }
    }

    /// Mean of the corners, which lies inside.
    pub fn center(&self) -> DVec3 {
        self.corners.iter().sum::<DVec3>() / self.corners.len().max(1) as f64
    }

    /// Center of mass, which moves continuously with the body. Of a flat one, as
    /// [`ConvexBody::center`].
    pub fn centroid(&self) -> DVec3 {
        let center = self.center();
        let mut sum = DVec3::ZERO;
        let mut total = 0.0;
        for face in self.faces() {
            let corner = |i: usize| self.corners[face[i]] - center;
            for i in 1..face.len() - 1 {
                let (a, b, c) = (corner(0), corner(i), corner(i + 1));
                let volume = a.cross(b).dot(c).abs();
                sum += volume * 0.25 * (a + b + c);
                total += volume;
            }
        }
        let offset = sum / total;
        if offset.is_finite() {
            center + offset
        } else {
            center
        }
    }

    /// How close to a plane corners lie on it (meters).
    ///
    /// A small part of its size, as far as rounding allows, however far from the origin it is: what lies within
    /// less of a plane may be lost.
    fn tolerance(&self) -> f64 {
        let (lo, hi) = self.bounds();
        let farthest = lo.abs().max(hi.abs()).max_element();
        ON_PLANE * (hi - lo).max_element() + ROUNDING * farthest
    }

    /// Lower and upper corner of the smallest box around the body, in world space.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        self.corners.iter().fold(
            (DVec3::INFINITY, DVec3::NEG_INFINITY),
            |(lo, hi), corner| (lo.min(*corner), hi.max(*corner)),
        )
    }
}

/// A plane going through a body: corners are kept, and new ones made on edges that it crosses.
struct Cut<'a> {
    old: &'a [DVec3],
    beyond: &'a [f64],
    corners: Vec<DVec3>,
    kept: Vec<Option<usize>>,
    on_edge: Vec<([usize; 2], usize)>,
}

impl<'a> Cut<'a> {
    fn new(old: &'a [DVec3], beyond: &'a [f64]) -> Self {
        let mut corners = Vec::with_capacity(old.len() + 4);
        let kept = old
            .iter()
            .zip(beyond)
            .map(|(corner, beyond)| {
                (*beyond <= 0.0).then(|| {
                    corners.push(*corner);
                    corners.len() - 1
                })
            })
            .collect();
        Self {
            old,
            beyond,
            corners,
            kept,
            on_edge: Vec::new(),
        }
    }

    /// Adds a face's ring, cut.
    fn face(&mut self, ring: &[usize], cut: &mut Vec<usize>) {
        for (position, &a) in ring.iter().enumerate() {
            let b = ring[(position + 1) % ring.len()];
            cut.extend(self.kept[a]);
            if self.beyond[a] * self.beyond[b] < 0.0 {
                cut.push(self.crossing(a.min(b), a.max(b)));
            }
        }
    }

    fn crossing(&mut self, a: usize, b: usize) -> usize {
        let known = self.on_edge.iter().find(|(edge, _)| *edge == [a, b]);
        if let Some((_, corner)) = known {
            return *corner;
        }
        let share = self.beyond[a] / (self.beyond[a] - self.beyond[b]);
        self.corners.push(self.old[a].lerp(self.old[b], share));
        let corner = self.corners.len() - 1;
        self.on_edge.push(([a, b], corner));
        corner
    }

    /// The new face in the plane: everything that lies on it, in order round it.
    fn cap(&self, normal: DVec3) -> Vec<usize> {
        let on_plane = self.kept.iter().zip(self.beyond);
        let on_plane = on_plane.filter(|(_, beyond)| **beyond == 0.0);
        let mut ring: Vec<usize> = on_plane
            .filter_map(|(kept, _)| *kept)
            .chain(self.on_edge.iter().map(|(_, corner)| *corner))
            .collect();
        let center = ring
            .iter()
            .map(|corner| self.corners[*corner])
            .sum::<DVec3>()
            / ring.len().max(1) as f64;
        let (right, up) = normal.any_orthonormal_pair();
        let angle = |corner: &usize| {
            let from = self.corners[*corner] - center;
            up.dot(from).atan2(right.dot(from))
        };
        ring.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
        ring
    }
}
