//! Which casters can matter to a body: the body swept towards the light.

use glam::DVec3;

use super::{body::ConvexBody, half_space::HalfSpace, oriented_box::OrientedBox};

/// A sphere on its way to the light, from where it stands: what is far from all of that throws no shadow into it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sweep {
    pub(super) center: DVec3,
    pub(super) radius: f64,
    pub(super) to_light: DVec3,
}

impl Sweep {
    const EVERYWHERE: Self = Self {
        center: DVec3::ZERO,
        radius: f64::INFINITY,
        to_light: DVec3::ZERO,
    };

    /// One that holds both. `None` if they go different ways.
    pub fn and(self, other: Self) -> Option<Self> {
        let apart = self.center.distance(other.center);
        (self.to_light == other.to_light).then_some(Self {
            radius: self.radius.max(apart + other.radius),
            ..self
        })
    }

    /// Whether a sphere lies beyond it, wherever that is on its way to the light. Not if either is no number.
    pub fn is_far(&self, center: DVec3, radius: f64) -> bool {
        const ROUNDING: f64 = 1e-12;
        // `f64::max` would drop what is no number.
        let at_least_0 = |length: f64| if length < 0.0 { 0.0 } else { length };
        let offset = center - self.center;
        let along = at_least_0(offset.dot(self.to_light));
        let reach = at_least_0(self.radius + radius);
        offset.length_squared() * (1.0 - ROUNDING) - along * along > reach * reach
    }
}

/// Every place from which a caster can throw a shadow into a convex body.
///
/// Faces that look away from the light bound the volume as they are; faces that look towards it
/// are dropped; every edge between the two kinds gives a plane parallel to the light.
#[derive(Debug, Clone, PartialEq)]
pub struct CasterHull {
    /// The bounding planes.
    pub planes: Vec<HalfSpace>,
    /// A sphere that holds the body, grown by the margin.
    pub sweep: Sweep,
}

impl Default for CasterHull {
    /// Everywhere.
    fn default() -> Self {
        Self {
            planes: Vec::new(),
            sweep: Sweep::EVERYWHERE,
        }
    }
}

impl CasterHull {
    /// Sweeps `body` towards the light, grown by `margin` meters on every side: what filters
    /// and offsets reach beyond a surface point. `to_light` is a unit vector in world space.
    pub fn new(body: &ConvexBody, to_light: DVec3, margin: f64) -> Self {
        let inside = body.center();
        let faces: Vec<Option<DVec3>> = body
            .faces()
            .map(|face| body.outward_normal(face, inside))
            .collect();
        let mut planes = Vec::with_capacity(12);
        let mut push = |normal: DVec3| {
            // Taking the furthest corner keeps the hull conservative whatever rounding did.
            let distance = body
                .corners
                .iter()
                .map(|c| normal.dot(*c))
                .fold(f64::NEG_INFINITY, f64::max);
            planes.push(HalfSpace {
                normal,
                distance: distance + margin,
            });
        };

        let is_kept = |normal: &DVec3| normal.dot(to_light) <= 0.0;
        faces
            .iter()
            .flatten()
            .copied()
            .filter(is_kept)
            .for_each(&mut push);
        for (i, j, [a, b]) in shared_edges(body) {
            let (Some(one), Some(other)) = (&faces[i], &faces[j]) else {
                continue;
            };
            if is_kept(one) == is_kept(other) {
                continue;
            }
            let edge = body.corners[b] - body.corners[a];
            let Some(normal) = edge.try_normalize().and_then(|e| {
                let n = e.cross(to_light);
                (n.length_squared() > 1e-12).then(|| n.normalize())
            }) else {
                continue;
            };
            let middle = (body.corners[a] + body.corners[b]) * 0.5;
            push(if normal.dot(middle - inside) < 0.0 {
                -normal
            } else {
                normal
            });
        }
        let corners = body.corners.iter();
        let radius = corners.fold(0.0, |radius, corner| inside.distance(*corner).max(radius));
        let sweep = Sweep {
            center: inside,
            radius: radius + margin,
            to_light,
        };
        Self { planes, sweep }
    }

    /// The hull of more points, each with the margin about it (meters): conservative, as it keeps the planes.
    pub fn extended(mut self, points: &[DVec3], margin: f64) -> Self {
        for plane in &mut self.planes {
            let along = points.iter().map(|point| plane.normal.dot(*point) + margin);
            plane.distance = along.fold(plane.distance, f64::max);
        }
        let sweep = &mut self.sweep;
        for point in points {
            sweep.radius = sweep.radius.max(sweep.center.distance(*point) + margin);
        }
        self
    }

    /// What of it lies within some more planes, all parallel to the light.
    pub fn within(mut self, sides: &[HalfSpace]) -> Self {
        self.planes.extend_from_slice(sides);
        self
    }

    /// Whether all of a body, grown by `margin` meters, lies within.
    pub fn contains(&self, body: &ConvexBody, margin: f64) -> bool {
        let farthest = |plane: &HalfSpace| {
            let along = body.corners.iter().map(|corner| plane.normal.dot(*corner));
            along.fold(f64::NEG_INFINITY, f64::max)
        };
        self.planes
            .iter()
            .all(|plane| farthest(plane) + margin <= plane.distance)
            && body
                .corners
                .iter()
                .all(|corner| !self.sweep.is_far(*corner, -margin))
    }

    /// Whether an oriented box can reach the hull. Conservative: never false for one that does.
    pub fn intersects_box(&self, bounds: &OrientedBox) -> bool {
        // A box that is not a number is outside of no plane.
        !self.sweep.is_far(bounds.center, bounds.radius())
            && !self.planes.iter().any(|plane| {
                plane.normal.dot(bounds.center) - bounds.reach(plane.normal) > plane.distance
            })
    }

    /// As [`CasterHull::intersects_box`], for a sphere in world space.
    pub fn intersects_sphere(&self, center: DVec3, radius: f64) -> bool {
        !self.sweep.is_far(center, radius)
            && !self
                .planes
                .iter()
                .any(|plane| plane.normal.dot(center) - radius > plane.distance)
    }
}

/// Pairs of faces with the edge that they share.
fn shared_edges(body: &ConvexBody) -> Vec<(usize, usize, [usize; 2])> {
    let mut edges: Vec<([usize; 2], usize)> = Vec::with_capacity(32);
    for (index, face) in body.faces().enumerate() {
        for (position, &a) in face.iter().enumerate() {
            let b = face[(position + 1) % face.len()];
            edges.push(([a.min(b), a.max(b)], index));
        }
    }
    edges.sort_unstable();
    edges
        .windows(2)
        .filter(|pair| pair[0].0 == pair[1].0)
        .map(|pair| (pair[0].1, pair[1].1, pair[0].0))
        .collect()
}
