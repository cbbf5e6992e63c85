//! Placing a map over the volume that it must cover.

use glam::{DMat4, DVec2, DVec3, UVec2};

use super::{
    CascadeMap, PlanInputs, Redraw,
    held::Spare,
    layout::is_focused,
    volume::CascadeVolume,
    warp::{warp_direction, warp_frame},
};
use crate::{
    config::{CasterFaces, MapFit},
    geometry::{
        aliasing::Aliasing,
        fit::{self, MapBox},
        hull::CasterHull,
        hysteresis::{Kept, Slack},
        light_frame::LightFrame,
    },
};

/// Pixels across a texel, where they are fewest, that a steady map is content with.
const FINEST: f64 = 0.25;

/// A map over its volume.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PlacedMap {
    pub clip_from_world: DMat4,
    world_from_cascade: DMat4,
    axes_ws: [DVec3; 2],
    pub texel: DVec2,
    pub fit: MapFit,
    strength: f64,
    /// Of maps that are not warped.
    pub map_box: Option<MapBox>,
}

/// `kept` is the extent of a steady or tight map (meters).
pub(super) fn place(
    inputs: &PlanInputs,
    volume: &CascadeVolume,
    fit: MapFit,
    map_size: UVec2,
    slack: Slack,
    kept: &mut [Kept<f64>; 2],
) -> Option<PlacedMap> {
    let PlanInputs {
        view,
        light,
        config,
        reach,
        ..
    } = *inputs;
    let in_light = |map_box: MapBox| PlacedMap::of_box(map_box, light, fit);
    Some(match fit {
        // Where all of the slice counts, its sphere is as steady as can be.
        MapFit::Steady if !is_focused(inputs) => {
            in_light(fit::stable(&volume.slice, light, map_size, reach, slack))
        }
        MapFit::Stable => in_light(fit::stable(&volume.slice, light, map_size, reach, slack)),
        MapFit::Steady => {
            let points = &volume.body.corners;
            // Where the slice begins, whatever is seen of it: that does not change as the view turns.
            let near = view.image_height(inputs.near());
            let pixel = volume.slice.image_height(0).max(near) / inputs.image_height;
            let finest = FINEST * pixel;
            in_light(fit::steady(
                points, light, map_size, reach, slack, finest, kept,
            ))
        }
        MapFit::Tight => {
            let points = &volume.body.corners;
            in_light(fit::tight(points, light, map_size, reach, slack, kept))
        }
        MapFit::Warped(warp) => {
            let direction = match volume.axis {
                Some(axis) => axis,
                None => warp_direction(config.comparison.warp_axis, view, volume.seen())?,
            };
            let (frame, strength) = warp_frame(warp, direction, view, light.z, volume.seen())?;
            let vertices = volume.body.vertices(view);
            let strength = strength.min(frame.most_strength(&vertices, f64::from(map_size.y)));
            let (clip_from_world, texel) = frame.guarded_map(&vertices, strength, map_size, reach);
            PlacedMap {
                clip_from_world,
                world_from_cascade: frame.world_from_frame(),
                axes_ws: [frame.x, frame.y],
                texel,
                fit,
                strength,
                map_box: None,
            }
        }
    })
}

impl PlacedMap {
    pub fn of_box(map_box: MapBox, light: &LightFrame, fit: MapFit) -> Self {
        Self {
            clip_from_world: map_box.clip_from_world(light),
            world_from_cascade: map_box.world_from_cascade(light),
            axes_ws: light.axes(),
            texel: map_box.texel,
            fit,
            strength: 0.0,
            map_box: Some(map_box),
        }
    }

    /// The worst over what is seen of a body.
    pub fn aliasing(&self, inputs: &PlanInputs, volume: &CascadeVolume) -> Option<Aliasing> {
        let vertices = volume.seen().vertices(inputs.view);
        Aliasing::over(&self.clip_from_world, self.axes_ws, &vertices)
    }

    /// Geometric mean over the vertices of what is seen, of a square texel. `None` where the map has no
    /// image of one.
    pub fn mean_aliasing(&self, inputs: &PlanInputs, volume: &CascadeVolume) -> Option<f64> {
        let vertices = volume.seen().vertices(inputs.view);
        let logarithms = vertices.iter().map(|vertex| {
            let vertex = core::slice::from_ref(vertex);
            let aliasing = Aliasing::over(&self.clip_from_world, self.axes_ws, vertex)?;
            Some(0.5 * aliasing.storage().ln())
        });
        let sum: f64 = logarithms.sum::<Option<f64>>()?;
        Some((sum / vertices.len().max(1) as f64).exp())
    }

    /// What the renderer and the culling need of a map that is drawn now, and is to hold casters that
    /// matter so far beyond the volume. `None` if it has no extent.
    pub fn finish(
        &self,
        inputs: &PlanInputs,
        volume: &CascadeVolume,
        spare: Spare,
        redraw: Redraw,
    ) -> Option<CascadeMap> {
        // Mirrored, triangles turn their backs on the rasterizer.
        let mirror = match inputs.config.comparison.caster_faces {
            CasterFaces::Front => DMat4::IDENTITY,
            CasterFaces::Back => DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0)),
        };
        let clip_from_world = mirror * self.clip_from_world;
        let world_from_cascade = self.world_from_cascade;
        let published = [clip_from_world, world_from_cascade];
        if published.iter().any(|matrix| !matrix.as_mat4().is_finite()) {
            return None;
        }
        let hull = self.hull_ahead(inputs, volume, &spare);
        let hull_now = self.hull(inputs, volume);
        Some(CascadeMap {
            clip_from_world,
            clip_from_cascade: clip_from_world * world_from_cascade,
            world_from_cascade,
            texel: self.texel,
            fit: self.fit,
            strength: self.strength,
            hull,
            hull_now,
            aliasing: self.aliasing(inputs, volume),
            redraw: Some(redraw),
        })
    }

    /// Where casters matter to a volume.
    pub fn hull(&self, inputs: &PlanInputs, volume: &CascadeVolume) -> CasterHull {
        CasterHull::new(&volume.body, inputs.light.z, self.margin(inputs))
    }

    /// Where they come to matter to one that moves, as far as the map reaches.
    fn hull_ahead(&self, inputs: &PlanInputs, volume: &CascadeVolume, spare: &Spare) -> CasterHull {
        let margin = self.margin(inputs);
        let hull = CasterHull::new(&volume.body, inputs.light.z, margin + spare.around);
        let hull = hull.extended(&spare.ahead_ws, margin);
        match &self.map_box {
            Some(map_box) if !spare.ahead_ws.is_empty() => {
                hull.within(&map_box.sides(inputs.light, margin))
            }
            _ => hull,
        }
    }

    /// What lookups reach beyond what is shaded (meters): filters are square, and texels have corners.
    pub fn margin(&self, inputs: &PlanInputs) -> f64 {
        (inputs.reach.texels + 1.0) * self.texel.length()
    }
}
