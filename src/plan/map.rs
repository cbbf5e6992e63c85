//! Laying a map over its body.

use glam::{DMat4, DVec2, DVec3, UVec2};

use super::{CascadeMap, PlanInputs, body::Body};
use crate::{
    config::{CasterFaces, MapFit},
    geometry::{
        aliasing::Aliasing,
        fit::{self, MapBox},
        hull::CasterHull,
        steady::{Held, Slack},
        warp,
    },
};

/// A map over its body.
pub(super) struct Laid {
    clip_from_world: DMat4,
    world_from_cascade: DMat4,
    axes: [DVec3; 2],
    texel: DVec2,
    fit: MapFit,
    strength: f64,
}

/// `held` is the extent of a tight map (meters).
pub(super) fn lay(
    inputs: &PlanInputs,
    body: &Body,
    fit: MapFit,
    map_size: UVec2,
    slack: Slack,
    held: &mut [Held<f64>; 2],
) -> Option<Laid> {
    let PlanInputs {
        view,
        light,
        config,
        reach,
        ..
    } = *inputs;
    let in_light = |map: MapBox| Laid {
        clip_from_world: map.clip_from_world(light),
        world_from_cascade: map.world_from_cascade(light),
        axes: [light.x, light.y],
        texel: map.texel,
        fit,
        strength: 0.0,
    };
    Some(match fit {
        MapFit::Stable => in_light(fit::stable(&body.slice, light, map_size, reach)),
        MapFit::Tight => {
            let points = &body.whole.corners;
            in_light(fit::tight(points, light, map_size, reach, slack, held))
        }
        MapFit::Warped(warp) => {
            let away = match body.axis {
                Some(axis) => axis,
                None => warp::away(config.warp_axis, view, body.seen())?,
            };
            let (frame, strength) = warp::lay(warp, away, view, light.z, body.seen())?;
            let vertices = warp::body_vertices(view, &body.whole);
            let (clip_from_world, texel) = frame.guarded_map(&vertices, strength, map_size, reach);
            Laid {
                clip_from_world,
                world_from_cascade: frame.world_from_frame(),
                axes: [frame.x, frame.y],
                texel,
                fit,
                strength,
            }
        }
    })
}

impl Laid {
    /// The worst over what is seen of a body.
    pub fn aliasing(&self, inputs: &PlanInputs, body: &Body) -> Option<Aliasing> {
        let vertices = warp::body_vertices(inputs.view, body.seen());
        Aliasing::over(&self.clip_from_world, self.axes, &vertices)
    }
}

/// What the renderer and the culling need of a map. `None` if it has no extent.
pub(super) fn finish(inputs: &PlanInputs, body: &Body, laid: Laid) -> Option<CascadeMap> {
    // Mirrored, triangles turn their backs on the rasterizer.
    let turned = match inputs.config.caster_faces {
        CasterFaces::Front => DMat4::IDENTITY,
        CasterFaces::Back => DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0)),
    };
    let clip_from_world = turned * laid.clip_from_world;
    let world_from_cascade = laid.world_from_cascade;
    let published = [clip_from_world, world_from_cascade];
    if published.iter().any(|matrix| !matrix.as_mat4().is_finite()) {
        return None;
    }
    let margin = inputs.reach.texels * laid.texel.max_element();
    Some(CascadeMap {
        clip_from_world,
        clip_from_cascade: clip_from_world * world_from_cascade,
        world_from_cascade,
        texel: laid.texel,
        fit: laid.fit,
        strength: laid.strength,
        hull: CasterHull::new(&body.whole, inputs.light.z, margin),
        aliasing: laid.aliasing(inputs, body),
    })
}
