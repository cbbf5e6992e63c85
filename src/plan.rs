//! From a view, a light and a configuration to the cascades that will be drawn: one pure
//! function, no ECS, that calls [`geometry`](crate::geometry) in order.

use glam::{DMat4, DVec2, DVec3};

use crate::{
    config::{CasterFaces, MAX_CASCADES, MapFit, ParallelSplitShadows, ShadowFocus, SplitScheme},
    geometry::{
        aliasing::Aliasing,
        body::{ConvexBody, HalfSpace},
        fit::{self, LookupReach, MapBox},
        hull::CasterHull,
        light_frame::LightFrame,
        receivers::{Bounds, Receivers},
        slice::{Slice, ViewVolume},
        split::split_planes,
        steady::Slack,
        warp,
    },
};

/// One cascade of one light for one view.
#[derive(Debug, Clone, PartialEq)]
pub struct CascadePlan {
    /// Depth at which the cascade takes over, blend band included (metres from the eye).
    pub near: f64,
    /// Depth at which it ends (metres from the eye).
    pub far: f64,
    /// Depth at which blending into the next cascade, or for the last one into light, begins.
    pub blend_start: f64,
    /// Texels per side.
    pub map_size: u32,
    /// The map's extent; `None` if the camera sees nothing in this interval that receives shadows:
    /// no map at all.
    pub map: Option<CascadeMap>,
}

/// The extent of a cascade's map and which casters matter to it.
#[derive(Debug, Clone, PartialEq)]
pub struct CascadeMap {
    /// World space to the map's clip space: NDC z in [0, 1], greater towards the light; `w` is 1
    /// unless the map is warped, and above 0 wherever light can reach the body.
    pub clip_from_world: DMat4,
    /// The cascade's own frame (x, y along the map, z to the light, origin on the near face) to
    /// clip space.
    pub clip_from_cascade: DMat4,
    /// The cascade's own frame to world space.
    pub world_from_cascade: DMat4,
    /// Size of a texel along the map's axes, where it is largest (metres).
    pub texel: DVec2,
    /// How strongly the map is warped (1/metres; the reciprocal of the distance from the centre of
    /// projection to the body); 0 if it is not.
    pub strength: f64,
    /// Where casters can stand that matter to what receives shadows in the slice.
    pub hull: CasterHull,
    /// The worst aliasing over what receives shadows, for a map of one texel and an image one pixel high
    /// (Lloyd et al. 2006, Eq. 1, perspective part). For the first cascade, from the
    /// configuration's `near` on: at the eye no map is large enough. `None` where the map has no
    /// image of a corner.
    pub aliasing: Option<Aliasing>,
}

impl CascadePlan {
    /// Texels across a pixel where they are fewest, in an image `image_height` pixels high:
    /// below one, texels show. `None` without a map.
    pub fn texels_per_pixel(&self, image_height: f64) -> Option<f64> {
        let aliasing = self.map.as_ref()?.aliasing?;
        let pixels_per_texel = aliasing.pixels_per_texel(f64::from(self.map_size), image_height);
        Some(pixels_per_texel.max_element().recip())
    }
}

/// What a plan is made from.
#[derive(Debug, Clone, Copy)]
pub struct PlanInputs<'a> {
    /// What the camera sees.
    pub view: &'a ViewVolume,
    /// The light's frame.
    pub light: &'a LightFrame,
    /// Must have passed [`ParallelSplitShadows::validate`].
    pub config: &'a ParallelSplitShadows,
    /// What lookups reach ([`ParallelSplitShadows::lookup_reach`]).
    pub reach: LookupReach,
    /// What receives shadows before the camera.
    pub receivers: &'a Receivers,
}

/// What fitted maps hold on to from frame to frame; one for each view of a light.
#[derive(Debug, Default, Clone, PartialEq)]
pub struct PlanHistory {
    /// What it was made with: another configuration starts anew.
    config: Option<ParallelSplitShadows>,
    /// Depths between which splits are spread.
    range: [Option<f64>; 2],
    cascades: [CascadeHistory; MAX_CASCADES],
}

#[derive(Debug, Default, Clone, Copy, PartialEq)]
struct CascadeHistory {
    bounds: Option<Bounds>,
    extent: Option<DVec2>,
}

/// Plans all cascades of a light for a view.
pub fn plan_cascades(inputs: &PlanInputs, history: &mut PlanHistory) -> Vec<CascadePlan> {
    let config = inputs.config;
    if history.config.as_ref() != Some(config) {
        *history = PlanHistory {
            config: Some(config.clone()),
            ..PlanHistory::default()
        };
    }
    let count = config.cascades as usize;
    let [range_near, range_far] = split_range(inputs, &mut history.range);
    let planes = split_planes(&config.splits, range_near, range_far, count);
    let blend_start = |index: usize| {
        let far = planes[index + 1];
        let share = if far >= config.far {
            // Where the last planes fall together, the first to reach them is the last to be seen.
            config.fade
        } else if far >= range_far {
            // Nothing is farther.
            0.0
        } else {
            config.blend
        };
        far - share * (far - planes[index])
    };
    let interval = |index: usize| {
        let near = if index == 0 {
            f64::NEG_INFINITY
        } else {
            blend_start(index - 1)
        };
        (near, planes[index + 1])
    };
    let intervals: Vec<_> = (0..count).map(interval).collect();
    let bounds = inputs.receivers.bounds_between(&intervals);
    (0..count)
        .map(|index| {
            let (near, far) = intervals[index];
            let map_size = config.map_size.of_cascade(index);
            let history = &mut history.cascades[index];
            // Where planes fall together the cascade before already reaches this far.
            let map = (planes[index] < far)
                .then(|| {
                    let body = Body::new(inputs, (near, far), bounds[index], history)?;
                    let fit = config.fit.of_cascade(index);
                    lay_map(inputs, &body, fit, map_size, &mut history.extent)
                })
                .flatten();
            CascadePlan {
                near,
                far,
                blend_start: blend_start(index),
                map_size,
                map,
            }
        })
        .collect()
}

/// Whether maps are fitted to what receives shadows.
fn is_focused(inputs: &PlanInputs) -> bool {
    inputs.config.focus == ShadowFocus::Receivers && !inputs.receivers.are_everywhere()
}

/// The depths between which splits are spread: those at which anything receives shadows.
fn split_range(inputs: &PlanInputs, held: &mut [Option<f64>; 2]) -> [f64; 2] {
    let PlanInputs { view, config, .. } = inputs;
    let whole = [config.near, config.far];
    let is_fixed = config.fit.any(|fit| fit == MapFit::Stable)
        || matches!(config.splits, SplitScheme::Manual(_));
    if is_fixed || !is_focused(inputs) {
        return whole;
    }
    let Some(slice) = view.slice(config.near, config.far) else {
        return whole;
    };
    let [bounds] = inputs
        .receivers
        .bounds_between(&[(config.near, config.far)])[..]
    else {
        return whole;
    };
    let body = ConvexBody::of_slice(&slice).within(ConvexBody::planes_of_box(bounds));
    let [mut near, mut far] = inputs.receivers.depths();
    let depths = body.corners.iter().map(|corner| view.depth_of(*corner));
    let nearest = depths.clone().fold(f64::INFINITY, f64::min);
    near = near.max(nearest).max(config.near);
    far = depths
        .fold(f64::NEG_INFINITY, f64::max)
        .min(far)
        .min(config.far);
    if near >= far {
        return whole;
    }
    let slack = Slack(config.slack);
    *held = [
        Some(slack.shorter(near, held[0])),
        Some(slack.length(far, held[1])),
    ];
    let [near, far] = held.map(Option::unwrap_or_default);
    [near.max(config.near), far.min(config.far)]
}

/// The part of a slice that a map must cover.
struct Body {
    slice: Slice,
    /// What of the slice can receive shadows.
    whole: ConvexBody,
    /// From the configuration's near on: at the eye no map is large enough.
    seen: ConvexBody,
}

impl Body {
    /// `None` if there is nothing in it.
    fn new(
        inputs: &PlanInputs,
        (near, far): (f64, f64),
        bounds: Bounds,
        history: &mut CascadeHistory,
    ) -> Option<Self> {
        let PlanInputs { view, config, .. } = inputs;
        let slice = view.slice(near, far)?;
        let mut whole = ConvexBody::of_slice(&slice);
        if is_focused(inputs) {
            let bounds = steady_bounds(bounds, config.slack, slice.radius, history);
            whole = whole.within(ConvexBody::planes_of_box(bounds));
        }
        if whole.is_empty() {
            return None;
        }
        let per_depth = view.per_depth();
        let normal = -per_depth.normalize();
        let seen = whole.clone().within([HalfSpace {
            normal,
            distance: normal.dot(view.eye) - config.near / per_depth.length(),
        }]);
        let seen = if seen.is_empty() { whole.clone() } else { seen };
        Some(Self { slice, whole, seen })
    }
}

/// Bodies are at least this thick, as a share of the slice's radius: flat ones have no faces.
const LEAST_THICKNESS: f64 = 1e-4;

fn steady_bounds(
    [lo, hi]: Bounds,
    slack: f64,
    radius: f64,
    history: &mut CascadeHistory,
) -> Bounds {
    if !(lo.is_finite() && hi.is_finite()) {
        return [lo, hi];
    }
    let pad = DVec3::splat(LEAST_THICKNESS * radius);
    let needed = [lo - pad, hi + pad];
    let held = history.bounds;
    let axis = |axis: usize| {
        let of = |[lo, hi]: Bounds| [lo[axis], hi[axis]];
        Slack(slack).interval(of(needed), radius, held.map(of))
    };
    let [x, y, z] = [0, 1, 2].map(axis);
    let bounds = [DVec3::new(x[0], y[0], z[0]), DVec3::new(x[1], y[1], z[1])];
    history.bounds = Some(bounds);
    bounds
}

fn lay_map(
    inputs: &PlanInputs,
    body: &Body,
    fit: MapFit,
    map_size: u32,
    held: &mut Option<DVec2>,
) -> Option<CascadeMap> {
    let PlanInputs {
        view,
        light,
        config,
        reach,
        ..
    } = *inputs;
    let slack = Slack(config.slack);
    let in_light = |map: MapBox| Laid {
        clip_from_world: map.clip_from_world(light),
        world_from_cascade: map.world_from_cascade(light),
        axes: [light.x, light.y],
        texel: map.texel,
        strength: 0.0,
    };
    let laid = match fit {
        MapFit::Stable => in_light(fit::stable(&body.slice, light, map_size, reach)),
        MapFit::Tight => {
            let points = &body.whole.corners;
            in_light(fit::tight(points, light, map_size, reach, slack, held))
        }
        MapFit::Warped(warp) => {
            let (frame, strength) = warp::lay(warp, config.warp_axis, view, light.z, &body.seen)?;
            let vertices = warp::body_vertices(view, &body.whole);
            let (clip_from_world, texel) = frame.guarded_map(&vertices, strength, map_size, reach);
            Laid {
                clip_from_world,
                world_from_cascade: frame.world_from_frame(),
                axes: [frame.x, frame.y],
                texel,
                strength,
            }
        }
    };

    // Mirrored, triangles turn their backs on the rasteriser.
    let turned = match config.caster_faces {
        CasterFaces::Front => DMat4::IDENTITY,
        CasterFaces::Back => DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0)),
    };
    let clip_from_world = turned * laid.clip_from_world;
    let world_from_cascade = laid.world_from_cascade;
    let published = [clip_from_world, world_from_cascade];
    if published.iter().any(|matrix| !matrix.as_mat4().is_finite()) {
        return None;
    }
    let margin = reach.texels * laid.texel.max_element();
    Some(CascadeMap {
        clip_from_world,
        clip_from_cascade: clip_from_world * world_from_cascade,
        world_from_cascade,
        texel: laid.texel,
        strength: laid.strength,
        hull: CasterHull::new(&body.whole, light.z, margin),
        aliasing: Aliasing::over(
            &clip_from_world,
            laid.axes,
            &warp::body_vertices(view, &body.seen),
        ),
    })
}

/// A map over its body.
struct Laid {
    clip_from_world: DMat4,
    world_from_cascade: DMat4,
    axes: [DVec3; 2],
    texel: DVec2,
    strength: f64,
}
