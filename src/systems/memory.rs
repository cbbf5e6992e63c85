//! How large maps need be at most, and may be together.

use bevy::{
    ecs::{reflect::ReflectResource, resource::Resource},
    reflect::{Reflect, std_traits::ReflectDefault},
};
use glam::UVec2;

use crate::config::{MAX_CASCADES, ParallelSplitShadows};

/// What the maps of all managed lights and cameras together may take (bytes). Where settings ask for more,
/// as with many cameras, all maps are halved until they fit or are as small as can be, and one warning says so.
/// Default 1 GiB: sixteen cameras at the default size. What moves may take as much again, and maps of
/// spot lights and other suns, whose size is Bevy's, are not counted; layers are as large as theirs at least.
#[derive(Resource, Reflect, Debug, Clone, Copy, PartialEq, Eq)]
#[reflect(Resource, Default, Debug, Clone, PartialEq)]
pub struct ShadowMemoryLimit(pub u64);

impl Default for ShadowMemoryLimit {
    fn default() -> Self {
        Self(1 << 30)
    }
}

/// Maps that have so many times as many texels along a side as the picture is high could as well be half as large.
const MOST_PER_PIXEL: f64 = 8.0;

/// How often maps are halved before they are no larger than a picture of some height (pixels) can show.
pub(super) fn halvings_for(config: &ParallelSplitShadows, image_height: f64) -> u32 {
    // A camera's picture has no size before there is one.
    if image_height <= 1.0 {
        return 0;
    }
    let side = f64::from(layer(config, 0).max_element());
    let spare = side / (MOST_PER_PIXEL * image_height);
    spare.max(1.0).log2() as u32
}

/// How often all maps are halved, beside what each has been already, before all of them fit.
pub(super) fn halvings_within(
    limit: ShadowMemoryLimit,
    maps: &[(&ParallelSplitShadows, u32)],
) -> u32 {
    let bytes = |halvings: u32| {
        let layers = maps
            .iter()
            .map(|(config, own)| layer(config, own + halvings));
        // All layers are as large as the largest.
        let largest = layers.reduce(UVec2::max).unwrap_or_default();
        let count: u64 = maps
            .iter()
            .map(|(config, _)| u64::from(config.cascades))
            .sum();
        4 * count * u64::from(largest.x) * u64::from(largest.y)
    };
    (0..u32::BITS)
        .find(|halvings| bytes(*halvings) <= limit.0 || bytes(*halvings) == bytes(halvings + 1))
        .unwrap_or(0)
}

/// The largest of a light's maps.
fn layer(config: &ParallelSplitShadows, halvings: u32) -> UVec2 {
    let size = config.map_size.halved(halvings, config.cascades);
    let sizes = (0..MAX_CASCADES).filter_map(|index| size.of_cascade(index));
    sizes
        .reduce(UVec2::max)
        .unwrap_or_else(|| UVec2::splat(size.largest_of_budget(config.cascades)))
}
