//! How many texels a pixel gets, by the maps' matrices: as predicted for all that a cascade can
//! show, and for what is seen.

use bevy::{
    light::{CascadeShadowConfig, Cascades, DirectionalLightShadowMap},
    math::{DAffine3, DMat3, DMat4, DVec3, DVec4},
    prelude::*,
};
use bevy_pssm::{
    ShadowPlans,
    geometry::{aliasing::Aliasing, slice::ViewVolume},
};

use super::trace::{Lens, Sample};

/// A map and the depths it is for.
pub struct Map {
    clip_from_world: DMat4,
    axes: [DVec3; 2],
    size: f64,
    far: f64,
    /// Worst over the cascade's slice, in texels across a pixel of a picture so many pixels high.
    predicted: Option<f64>,
}

/// The maps of the last frame.
pub fn maps_of(world: &World, camera: Entity, sun: Entity, ours: bool, height: f64) -> Vec<Map> {
    if ours {
        let plans = world
            .get::<ShadowPlans>(sun)
            .and_then(|p| p.views.get(&camera));
        let plans = plans.into_iter().flatten();
        return plans
            .filter_map(|plan| {
                let map = plan.map.as_ref()?;
                let axis = |axis: DVec4| axis.truncate().normalize();
                Some(Map {
                    clip_from_world: map.clip_from_world,
                    axes: [
                        axis(map.world_from_cascade.x_axis),
                        axis(map.world_from_cascade.y_axis),
                    ],
                    size: f64::from(plan.map_size),
                    far: plan.far,
                    predicted: plan.texels_per_pixel(height),
                })
            })
            .collect();
    }
    stock_maps(world, camera, sun, height).unwrap_or_default()
}

fn stock_maps(world: &World, camera: Entity, sun: Entity, height: f64) -> Option<Vec<Map>> {
    let config = world.get::<CascadeShadowConfig>(sun)?;
    let cascades = world.get::<Cascades>(sun)?.cascades.get(&camera)?;
    let size = world.resource::<DirectionalLightShadowMap>().size as f64;
    let affine = world.get::<GlobalTransform>(camera)?.affine();
    let world_from_view = DAffine3 {
        matrix3: DMat3::from_cols(
            affine.matrix3.x_axis.as_dvec3(),
            affine.matrix3.y_axis.as_dvec3(),
            affine.matrix3.z_axis.as_dvec3(),
        ),
        translation: affine.translation.as_dvec3(),
    };
    let projection = world.get::<Projection>(camera)?;
    let view = ViewVolume::new(world_from_view, &projection.get_clip_from_view())?;
    let maps = cascades.iter().enumerate().map(|(index, cascade)| {
        let far = f64::from(config.bounds[index]);
        let near = match index {
            0 => f64::from(config.minimum_distance),
            _ => f64::from((1.0 - config.overlap_proportion) * config.bounds[index - 1]),
        };
        let axis = |axis: Vec4| axis.truncate().as_dvec3().normalize();
        let clip_from_world = cascade.clip_from_world.as_dmat4();
        let axes = [
            axis(cascade.world_from_cascade.x_axis),
            axis(cascade.world_from_cascade.y_axis),
        ];
        let slice = view.slice(near, far);
        Map {
            clip_from_world,
            axes,
            size,
            far,
            predicted: slice
                .and_then(|slice| Aliasing::over_slice(&clip_from_world, axes, &slice))
                .map(|worst| 1.0 / worst.pixels_per_texel(size, height).max_element()),
        }
    });
    Some(maps.collect())
}

/// Texels across a pixel where they are fewest: predicted for the slices, and seen at samples
/// that face the sun. Perspective alone, as in Lloyd et al. 2006.
pub fn texels_per_pixel(
    maps: &[Map],
    lens: &Lens,
    samples: impl Iterator<Item = Sample>,
) -> [f64; 2] {
    let height = f64::from(lens.size.y);
    let predicted = maps.iter().filter_map(|map| map.predicted);
    let seen = samples.filter_map(|sample| {
        let depth = lens.clip_from_world.row(3).dot(sample.point.extend(1.0));
        let map = maps.iter().find(|map| depth < map.far)?;
        let image_height = lens.pixel_size(sample.point) * height;
        let aliasing = Aliasing::at(&map.clip_from_world, map.axes, sample.point, image_height)?;
        Some(1.0 / aliasing.pixels_per_texel(map.size, height).max_element())
    });
    [
        predicted.fold(f64::INFINITY, f64::min),
        seen.fold(f64::INFINITY, f64::min),
    ]
}
