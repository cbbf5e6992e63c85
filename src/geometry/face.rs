//! Face partitioning (Lloyd et al. 2006, §5.1): a map of its own for every face of the view
//! volume at which rays of light have their smallest depth.
//!
//! Planes through the volume's edges and the light cut it into pieces, each of which casts its
//! footprint on one face: to cover the face is to cover the piece.

use glam::{DVec2, DVec3};

use super::{
    aliasing::Aliasing,
    half_space::HalfSpace,
    slice::{BodyVertex, Slice, ViewVolume},
    warp::WarpFrame,
};

/// A face of a slice and how its map is warped.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Face {
    /// Which side: 0 below, then right, above and left; 4 is the near face.
    pub side: usize,
    /// The frame of its map.
    pub frame: WarpFrame,
    /// Its corners.
    pub vertices: [BodyVertex; 4],
    /// Strength of the warp (1/meters).
    pub strength: f64,
}

/// The piece of a perspective view that casts its footprint on one of its sides: everything
/// between two planes through the eye and the light, or next to a [`SLIVER`] a direction near it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wedge {
    /// Which side: 0 below, then right, above and left.
    pub side: usize,
    /// The bounding planes, in the order of the side's edges.
    pub planes: [HalfSpace; 2],
    /// Unit vector along which its map is warped: between the side's edges as the light sees them.
    pub axis: DVec3,
}

impl Wedge {
    /// The wedges of all sides that get a map: those that face the light if it comes from behind
    /// the camera, those that face away from it otherwise, unless they are nearly edge-on
    /// ([`SLIVER`]). With the sides stretched to the eye they make up the view. None if the view is not in
    /// perspective or `to_light`, in world space, has no direction.
    pub fn of_view(view: &ViewVolume, to_light: DVec3) -> Vec<Self> {
        let at_eye = [view.min[0], view.max[0]] == [DVec2::ZERO; 2];
        let is_cone = at_eye && view.max[1] != view.min[1];
        let near = view.near.max(1.0);
        let (Some(slice), Some(to_light), true) = (
            view.slice(near, 2.0 * near),
            to_light.try_normalize(),
            is_cone,
        ) else {
            return Vec::new();
        };
        let to_light = beside_slivers(view, &slice, to_light);
        sides(view, &slice, to_light)
            .into_iter()
            .filter_map(|face| {
                let plane = |edge: DVec3, other: DVec3| {
                    let normal = edge.cross(to_light).try_normalize()?;
                    // Outward: the other edge lies inside.
                    let normal = normal * -normal.dot(other).signum();
                    Some(HalfSpace {
                        normal,
                        distance: normal.dot(view.eye),
                    })
                };
                let [a, b] = [0, 1].map(|edge| face.vertices[edge].position - view.eye);
                Some(Self {
                    side: face.side,
                    planes: [plane(a, b)?, plane(b, a)?],
                    axis: face.frame.y,
                })
            })
            .collect()
    }
}

/// Faces seen at a smaller sine than this are edge-on, and have no area to map.
const EDGE_ON: f64 = 1e-9;

/// Sides that the light sees at a smaller sine than this, as a share of the sine at which the eye sees the
/// picture's farthest corner from them, get no map: their wedge is no wider a share of the picture, and in
/// its neighbor's map it costs a few percent of the texels, not half the slices.
pub const SLIVER: f64 = 1.0 / 64.0;

/// The direction along which the view is cut up: the light's, moved into the planes of sides that are slivers.
///
/// Those are exactly edge-on then, and what is left to the other sides still makes up the view.
fn beside_slivers(view: &ViewVolume, slice: &Slice, to_light: DVec3) -> DVec3 {
    let normals: Vec<DVec3> = (0..4).filter_map(|side| outward(slice, side)).collect();
    let is_sliver = |normal: DVec3, light: DVec3| {
        let rays = slice.corners.iter().map(|corner| *corner - view.eye);
        let sines = rays.map(|ray| ray.dot(normal).abs() / ray.length());
        light.dot(normal).abs() < SLIVER * sines.fold(0.0, f64::max)
    };
    let sliver = |light: DVec3, but: Option<DVec3>| {
        let mut others = normals.iter().copied();
        others.find(|normal| Some(*normal) != but && is_sliver(*normal, light))
    };
    let Some(first) = sliver(to_light, None) else {
        return to_light;
    };
    let within_first = to_light.reject_from_normalized(first).normalize();
    // Two planes have but one direction in common.
    sliver(within_first, Some(first))
        .and_then(|second| first.cross(second).try_normalize())
        .map_or(within_first, |along| along * along.dot(to_light).signum())
}

/// Corners of a side of a slice: two near ones, then those behind them.
fn corners_of(side: usize) -> [usize; 4] {
    let next = (side + 1) % 4;
    [side, next, side + 4, next + 4]
}

/// The outward unit normal of a side of a slice. `None` if it has no area.
fn outward(slice: &Slice, side: usize) -> Option<DVec3> {
    let [a, b, c, d] = corners_of(side).map(|corner| slice.corners[corner]);
    let normal = (c - a).cross(d - b).try_normalize()?;
    Some(normal * normal.dot(a - slice.center).signum())
}

impl Face {
    /// The worst aliasing of the face's map, for an image one pixel high.
    pub fn worst_aliasing(&self) -> Option<Aliasing> {
        self.frame.worst_aliasing(&self.vertices, self.strength)
    }
}

/// The sides of a slice of a perspective view that get a map: those that face the light if it
/// comes from behind the camera, those that face away from it otherwise. None if `to_light`,
/// in world space, has no direction.
///
/// The warp runs along the bisector of the side's two edges as the light sees them, and is as
/// strong as makes errors along it equal at both ends.
pub fn sides(view: &ViewVolume, slice: &Slice, to_light: DVec3) -> Vec<Face> {
    let vertices = slice.vertices();
    (0..4)
        .filter_map(|side| {
            let quad = corners_of(side).map(|corner| vertices[corner]);
            let [a, b, c, d] = quad.map(|vertex| vertex.position);
            let edges = [c - a, d - b];

            let facing = outward(slice, side)?.dot(to_light.try_normalize()?);
            let from_behind = view.forward()?.dot(to_light) <= 0.0;
            if facing.abs() < EDGE_ON || (facing > 0.0) != from_behind {
                return None;
            }

            let [left, right] = edges.map(|edge| edge.reject_from(to_light).normalize_or_zero());
            let frame = WarpFrame::new(view.eye, left + right, to_light)?;
            let (near_line, far_line) = frame.lines(&quad);
            let ratio = quad[2].image_height / quad[0].image_height;
            Some(Face {
                side,
                frame,
                vertices: quad,
                strength: (ratio.sqrt() - 1.0) / (far_line - near_line),
            })
        })
        .collect()
}

/// The near face of a slice, whose map needs no warp: the image is equally wide all over it.
/// `to_light` is in world space. `None` if the light sees it edge-on.
pub fn near(view: &ViewVolume, slice: &Slice, to_light: DVec3) -> Option<Face> {
    let facing = view.forward()?.dot(to_light.try_normalize()?);
    if facing.abs() < EDGE_ON {
        return None;
    }
    let [a, b, c, d, ..] = slice.vertices();
    Some(Face {
        side: 4,
        frame: WarpFrame::new(view.eye, view.axes.y_axis, to_light)?,
        vertices: [a, b, c, d],
        strength: 0.0,
    })
}
