//! How large maps need be at most, and may be together.

use bevy::{
    camera::visibility::{InheritedVisibility, RenderLayers},
    ecs::{
        reflect::ReflectResource,
        resource::Resource,
        system::{Query, Res, SystemParam},
    },
    light::{CascadeShadowConfig, DirectionalLight, DirectionalLightShadowMap, SpotLight},
    reflect::{Reflect, std_traits::ReflectDefault},
};
use glam::UVec2;

use super::ManagedLight;
use crate::config::{MAX_CASCADES, ParallelSplitShadows};

/// What all maps together may take (bytes): those of managed lights, for each camera, and those of spot lights and
/// other suns, which lie in the same array. Where settings ask for more, as with many cameras, managed lights' maps are
/// halved until all fit or no halving helps, and one warning says so. Default 1 GiB: sixteen cameras at
/// the default size. Copies of what rests, in maps in which something moves, may take as much again.
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

/// What lies in the same array as the maps of managed lights.
#[derive(SystemParam)]
pub struct OtherMaps<'w, 's> {
    size: Option<Res<'w, DirectionalLightShadowMap>>,
    spots: Query<'w, 's, (&'static SpotLight, &'static InheritedVisibility)>,
    suns: Query<
        'w,
        's,
        (
            &'static DirectionalLight,
            &'static CascadeShadowConfig,
            &'static InheritedVisibility,
            Option<&'static RenderLayers>,
            Option<&'static ManagedLight>,
        ),
    >,
}

/// Layers that are not the plugin's, and the side of the maps in them (texels).
#[derive(Debug, Default, Clone, Copy)]
pub(super) struct OtherLayers {
    pub count: u64,
    pub side: u32,
}

impl OtherMaps<'_, '_> {
    /// For cameras of these render layers.
    pub(super) fn layers(&self, cameras: impl Iterator<Item = RenderLayers>) -> OtherLayers {
        let spots = self.spots.iter();
        let spots = spots.filter(|(light, seen)| light.shadow_maps_enabled && seen.get());
        let of_camera = |camera: RenderLayers| -> usize {
            let suns = self
                .suns
                .iter()
                .filter(|(light, _, seen, layers, managed)| {
                    let layers = layers.unwrap_or_default();
                    let is_built_in = managed.is_none_or(|managed| managed.config().is_none());
                    is_built_in
                        && light.shadow_maps_enabled
                        && seen.get()
                        && layers.intersects(&camera)
                });
            suns.map(|(_, config, ..)| config.bounds.len()).sum()
        };
        let count = spots.count() + cameras.map(of_camera).sum::<usize>();
        let side = self.size.as_deref().filter(|_| count > 0);
        OtherLayers {
            count: count as u64,
            side: side.map_or(0, |map| map.size as u32),
        }
    }
}

/// How often all maps are halved, beside what each has been already, before all of them fit.
pub(super) fn halvings_within<'a, Maps: Iterator<Item = (&'a ParallelSplitShadows, u32)>>(
    limit: ShadowMemoryLimit,
    maps: impl Fn() -> Maps,
    others: OtherLayers,
) -> u32 {
    let bytes = |halvings: u32| {
        let layers = maps().map(|(config, own)| layer(config, own + halvings));
        // All layers are as large as the largest.
        let largest = layers.fold(UVec2::splat(others.side), UVec2::max);
        let count: u64 = maps().map(|(config, _)| u64::from(config.cascades)).sum();
        4 * (count + others.count) * u64::from(largest.x) * u64::from(largest.y)
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
