//! What is published in Bevy's components, for whatever reads those.

use bevy::{
    light::{CascadeShadowConfig, cascade::Cascade},
    math::{Mat4, Vec3},
};

use crate::{
    config::ParallelSplitShadows,
    plan::{CascadePlan, split_planes},
};

/// A plan in the terms of Bevy's component.
pub(super) fn published_cascade(plan: &CascadePlan) -> Cascade {
    plan.map.as_ref().map_or_else(empty_cascade, |map| Cascade {
        world_from_cascade: map.world_from_cascade.as_mat4(),
        clip_from_cascade: map.clip_from_cascade.as_mat4(),
        clip_from_world: map.clip_from_world.as_mat4(),
        texel_size: map.texel.max_element() as f32,
    })
}

/// A cascade that covers nothing anyone will see, with matrices that can still be inverted.
pub(crate) fn empty_cascade() -> Cascade {
    const FAR_OUT: f32 = 1e9;
    let clip_from_world = Mat4::from_translation(Vec3::splat(FAR_OUT));
    Cascade {
        world_from_cascade: Mat4::from_translation(Vec3::splat(-FAR_OUT)),
        clip_from_cascade: Mat4::IDENTITY,
        clip_from_world,
        texel_size: 1.0,
    }
}

/// The configuration in the terms of Bevy's component.
pub(super) fn published_config(config: &ParallelSplitShadows) -> CascadeShadowConfig {
    let (near, far) = (f64::from(config.near), f64::from(config.far));
    let planes = split_planes(&config.splits, near, far, config.cascades as usize);
    // Bevy has one proportion of the far bound for all cascades: the least of the slices'.
    let overlap = planes
        .windows(2)
        .map(|slice| f64::from(config.blend) * (slice[1] - slice[0]) / slice[1])
        .fold(f64::INFINITY, f64::min);
    CascadeShadowConfig {
        bounds: planes[1..].iter().map(|plane| *plane as f32).collect(),
        overlap_proportion: overlap as f32,
        minimum_distance: config.near,
    }
}
