//! Laying a map over a slice: how large, where, and snapped to which grid.

use glam::{DMat4, DVec2, DVec3, DVec4, UVec2};

use super::{
    half_space::HalfSpace,
    hysteresis::{Kept, Slack},
    light_frame::LightFrame,
    slice::Slice,
};

/// An orthographic map: a box in the light's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapBox {
    /// Center in the light's frame (meters).
    pub center: DVec3,
    /// Half the box's extents in the light's frame (meters).
    pub half: DVec3,
    /// Size of a texel along the map's two axes (meters).
    pub texel: DVec2,
}

/// What a surface lookup can reach beyond the surface point itself, apart from the map's fit:
/// filters and bias offsets. Maps keep this much guard and caster hulls this much margin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LookupReach {
    /// In texels of the map.
    pub texels: f64,
}

/// No map is thinner than this (meters): an extent is never divided by raw.
const MIN_EXTENT: f64 = 1e-6;

/// A map that moves in whole texels and changes neither its size nor its orientation as the view
/// moves and turns.
///
/// The slice's bounding sphere, rounded up by `slack` so that zooms change it in steps, fixes the
/// size; the center is rounded to the texel grid of the light's own frame, anchored at its origin.
/// What lookups reach beyond the slice stays inside the map. (NVIDIA 2007; sphere and guard as in
/// Valient 2008.)
pub fn stable(
    slice: &Slice,
    light: &LightFrame,
    map_size: UVec2,
    reach: LookupReach,
    slack: Slack,
) -> MapBox {
    let size = map_size.as_dvec2();
    let radius_ls = slice.radius.max(MIN_EXTENT) * light.spread();
    let rounded_ls = DVec2::new(
        slack.round_up_at_once(radius_ls.x),
        slack.round_up_at_once(radius_ls.y),
    );
    let half_ls = rounded_ls * size / usable(size, 1.0 + 2.0 * reach.texels);
    let texel = 2.0 * half_ls / size;
    let depth = half_ls.max_element() + reach.texels * texel.max_element();
    MapBox {
        // Depth moves in steps too: it is rounded the same from frame to frame.
        center: snapped(
            light.light_from_world(slice.center),
            texel.extend(texel.max_element()),
        ),
        half: half_ls.extend(depth),
        texel,
    }
}

/// The nearest corner of the grid of cells that starts at the origin.
fn snapped(point: DVec3, cell: DVec3) -> DVec3 {
    (point / cell + 0.5).floor() * cell
}

/// The box of an upright cylinder around points in world space, grown by some slack and moved in
/// whole texels.
///
/// A view that turns sees about as much in every direction: the cylinder's radius and height stay
/// much the same, whereas the smallest box would not. No texel is smaller than `finest` (meters), or what
/// is left of a scene at the picture's border would have the map change. `kept` is the box's extent
/// (meters).
pub fn steady(
    points_ws: &[DVec3],
    light: &LightFrame,
    map_size: UVec2,
    reach: LookupReach,
    slack: Slack,
    finest: f64,
    kept: &mut [Kept<f64>; 2],
) -> MapBox {
    let size = map_size.as_dvec2();
    let least_ls = (0.5 * finest * size).max(DVec2::splat(MIN_EXTENT));
    let (circle_ws, radius) = bounding_circle(points_ws);
    let (bottom, top) = points_ws
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), point| {
            (lo.min(point.y), hi.max(point.y))
        });
    let center_ws = DVec3::new(circle_ws.x, 0.5 * (bottom + top), circle_ws.y);
    // Of what may be longer than a unit vector, in frames that stand on the ground.
    let half = |axis_ws: DVec3| {
        radius * axis_ws.x.hypot(axis_ws.z) + 0.5 * (top - bottom) * axis_ws.y.abs()
    };
    let needed_ls = DVec2::new(half(light.x), half(light.y)).max(least_ls);
    let extent_ls = slack.round_up_both(needed_ls, kept);
    let half_ls = extent_ls.extend(half(light.z));
    let center_ls = light.light_from_world(center_ws);
    around(center_ls, half_ls, size, reach, slack)
}

/// The box around a center and half an extent in the light's frame, with a guard for what lookups
/// reach beyond it. With any slack it snaps to the texel grid, and has a guard for the texel that it
/// then moves, and as much depth to spare as it has width.
fn around(center: DVec3, half: DVec3, size: DVec2, reach: LookupReach, slack: Slack) -> MapBox {
    let snaps = slack.0 > 0.0;
    let guard = f64::from(u8::from(snaps)) + 2.0 * reach.texels;
    let across = half.truncate() * size / usable(size, guard);
    let texel = 2.0 * across / size;
    let cell = texel.extend(texel.max_element());
    let depth = half.z
        + if snaps {
            0.5 * across.max_element()
        } else {
            0.0
        };
    MapBox {
        center: if snaps { snapped(center, cell) } else { center },
        half: across.extend(depth + (reach.texels + 0.5) * cell.z),
        texel,
    }
}

/// A circle around points seen from above, nearly the smallest (Bădoiu and Clarkson 2003): its
/// center (x and z) and radius.
fn bounding_circle(points: &[DVec3]) -> (DVec2, f64) {
    const STEPS: u32 = 32;
    let points = || points.iter().map(|point| DVec2::new(point.x, point.z));
    let farthest = |center: DVec2| {
        points().fold((0.0, center), |(most, farthest), point| {
            let distance = center.distance(point);
            if distance > most {
                (distance, point)
            } else {
                (most, farthest)
            }
        })
    };
    let mut center = points().sum::<DVec2>() / points().count().max(1) as f64;
    for step in 1..=STEPS {
        center += (farthest(center).1 - center) / f64::from(step + 1);
    }
    (center, farthest(center).0)
}

/// The smallest box in the light's frame around points in world space, grown by some slack: as long
/// as that lasts, the map moves in whole texels and does not change its size. `kept` is the extent
/// (meters).
pub fn tight(
    points_ws: &[DVec3],
    light: &LightFrame,
    map_size: UVec2,
    reach: LookupReach,
    slack: Slack,
    kept: &mut [Kept<f64>; 2],
) -> MapBox {
    let size = map_size.as_dvec2();
    let (lo_ls, hi_ls) = bounds_ls(points_ws.iter().copied(), light);
    let extent_ls = (hi_ls - lo_ls).max(DVec3::splat(MIN_EXTENT));
    let [across, up] = kept;
    let rounded_ls = DVec2::new(
        slack.round_up(extent_ls.x, across),
        slack.round_up(extent_ls.y, up),
    );
    let half_ls = (0.5 * rounded_ls).extend(0.5 * extent_ls.z);
    around((lo_ls + hi_ls) * 0.5, half_ls, size, reach, slack)
}

/// The least and the greatest coordinates in the light's frame of points in world space.
fn bounds_ls(points_ws: impl Iterator<Item = DVec3>, light: &LightFrame) -> (DVec3, DVec3) {
    let points_ls = points_ws.map(|point_ws| light.light_from_world(point_ws));
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    points_ls.fold(none, |(lo, hi), point_ls| {
        (lo.min(point_ls), hi.max(point_ls))
    })
}

/// Texels left for the slice once the guard is taken off; at least half the map.
pub(super) fn usable(size: DVec2, guard: f64) -> DVec2 {
    (size - guard).max(0.5 * size)
}

impl MapBox {
    /// The same box with its middle at that of some points in world space, as nearly as whole texels allow.
    pub fn about(&self, points_ws: impl Iterator<Item = DVec3>, light: &LightFrame) -> Self {
        let (lo_ls, hi_ls) = bounds_ls(points_ws, light);
        let cell = self.texel.extend(self.texel.max_element());
        let by = 0.5 * (lo_ls + hi_ls) - self.center;
        Self {
            center: self.center + (by / cell).round() * cell,
            ..*self
        }
    }

    /// How far points in world space may still move along the box's axes before lookups at them
    /// leave it (meters); below zero where they do.
    pub fn spare(
        &self,
        points_ws: impl Iterator<Item = DVec3>,
        light: &LightFrame,
        reach: LookupReach,
    ) -> DVec3 {
        let guard_ls = reach.texels * self.texel.extend(self.texel.max_element());
        let spare_ls = points_ws.map(|point_ws| {
            let off_ls = light.light_from_world(point_ws) - self.center;
            self.half - off_ls.abs() - guard_ls
        });
        spare_ls.fold(DVec3::INFINITY, DVec3::min)
    }

    /// What its four sides bound on the way to the light, grown by `margin` meters.
    pub fn sides(&self, light: &LightFrame, margin: f64) -> [HalfSpace; 4] {
        let side = |axis_ws: DVec3, center: f64, half: f64, sign: f64| {
            let per_length = axis_ws.length_recip();
            let along = sign * (center + axis_ws.dot(light.origin)) + half;
            HalfSpace {
                normal: sign * per_length * axis_ws,
                distance: per_length * along + margin,
            }
        };
        let (center, half) = (self.center, self.half);
        [
            side(light.x, center.x, half.x, 1.0),
            side(light.x, center.x, half.x, -1.0),
            side(light.y, center.y, half.y, 1.0),
            side(light.y, center.y, half.y, -1.0),
        ]
    }

    /// The matrix from world space to the map's clip space: NDC x and y in [−1, 1], z in [0, 1]
    /// with 1 at the light's side (reverse z), w = 1.
    pub fn clip_from_world(&self, light: &LightFrame) -> DMat4 {
        let row = |axis_ws: DVec3, center: f64, half: f64| {
            (axis_ws / half).extend(-(center + axis_ws.dot(light.origin)) / half)
        };
        let x = row(light.x, self.center.x, self.half.x);
        let y = row(light.y, self.center.y, self.half.y);
        let z = row(light.z, self.center.z, self.half.z) * 0.5 + DVec4::new(0.0, 0.0, 0.0, 0.5);
        DMat4::from_cols(x, y, z, DVec4::W).transpose()
    }

    /// The matrix to world space from the light's frame with its origin on the near (light-side)
    /// face.
    pub fn world_from_cascade(&self, light: &LightFrame) -> DMat4 {
        let rotation = light.world_from_light();
        let origin_ws = light.origin + rotation * (self.center + DVec3::Z * self.half.z);
        DMat4::from_mat3_translation(rotation, origin_ws)
    }
}
