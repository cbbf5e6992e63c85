//! From a view, a light and a configuration to the cascades that will be drawn: one pure
//! function, no ECS, that calls [`geometry`](crate::geometry) in order.

use glam::{DMat4, DVec2, DVec3};

use crate::{
    config::{CascadeFit, CasterFaces, ParallelSplitShadows},
    geometry::{
        aliasing::Aliasing,
        fit::{self, LookupReach},
        hull::CasterHull,
        light_frame::LightFrame,
        slice::ViewVolume,
        split::split_planes,
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
    /// The map's extent; `None` if the camera sees nothing of this interval: no map at all.
    pub map: Option<CascadeMap>,
}

/// The extent of a cascade's map and which casters matter to it.
#[derive(Debug, Clone, PartialEq)]
pub struct CascadeMap {
    /// World space to the map's clip space: orthographic, NDC z in [0, 1] with 1 at the light. A
    /// system of your own may put a perspective in its place, if
    /// [`ShaderParts::warps`](crate::ShaderParts) is set; otherwise `texel` must be kept true.
    pub clip_from_world: DMat4,
    /// The cascade's own frame (x, y along the map, z to the light, origin on the near face) to
    /// clip space.
    pub clip_from_cascade: DMat4,
    /// The cascade's own frame to world space.
    pub world_from_cascade: DMat4,
    /// Size of a texel along the map's axes (metres).
    pub texel: DVec2,
    /// Where casters can stand that matter to the slice.
    pub hull: CasterHull,
    /// The worst aliasing over the slice, for a map of one texel and an image one pixel high
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

/// Plans all cascades of a light for a view.
///
/// `config` must have passed [`ParallelSplitShadows::validate`].
pub fn plan_cascades(
    view: &ViewVolume,
    light: &LightFrame,
    config: &ParallelSplitShadows,
    reach: LookupReach,
) -> Vec<CascadePlan> {
    let count = config.cascades as usize;
    let planes = split_planes(&config.splits, config.near, config.far, count);
    let blend_start = |index: usize| {
        // Where the last planes fall together, the first to reach them is the last to be seen.
        let share = if planes[index + 1] >= config.far {
            config.fade
        } else {
            config.blend
        };
        planes[index + 1] - share * (planes[index + 1] - planes[index])
    };
    (0..count)
        .map(|index| {
            let far = planes[index + 1];
            let near = if index == 0 {
                f64::NEG_INFINITY
            } else {
                blend_start(index - 1)
            };
            let map_size = config.map_size.of_cascade(index);
            CascadePlan {
                near,
                far,
                blend_start: blend_start(index),
                map_size,
                // Where planes fall together the cascade before already reaches this far.
                map: (planes[index] < far)
                    .then(|| plan_map(view, light, config, (near, far), map_size, reach))
                    .flatten(),
            }
        })
        .collect()
}

fn plan_map(
    view: &ViewVolume,
    light: &LightFrame,
    config: &ParallelSplitShadows,
    (near, far): (f64, f64),
    map_size: u32,
    reach: LookupReach,
) -> Option<CascadeMap> {
    let slice = view.slice(near, far)?;
    let map = match config.fit {
        CascadeFit::Stable => fit::stable(&slice, light, map_size, reach),
        CascadeFit::Tight => fit::tight(&slice, light, map_size, reach),
    };
    // Mirrored, triangles turn their backs on the rasteriser.
    let turned = match config.caster_faces {
        CasterFaces::Front => DMat4::IDENTITY,
        CasterFaces::Back => DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0)),
    };
    let [clip_from_world, clip_from_cascade, world_from_cascade] = [
        turned * map.clip_from_world(light),
        turned * map.clip_from_cascade(),
        map.world_from_cascade(light),
    ];
    let published = [clip_from_world, clip_from_cascade, world_from_cascade];
    if published.iter().any(|matrix| !matrix.as_mat4().is_finite()) {
        return None;
    }
    let seen = view.slice(near.max(config.near), far);
    let aliasing = Aliasing::over_slice(
        &clip_from_world,
        [light.x, light.y],
        seen.as_ref().unwrap_or(&slice),
    );
    let margin = reach.texels * map.texel.max_element();
    Some(CascadeMap {
        clip_from_world,
        clip_from_cascade,
        world_from_cascade,
        texel: map.texel,
        hull: CasterHull::new(&slice, light.z, margin),
        aliasing,
    })
}
