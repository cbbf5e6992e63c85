//! How many texels a pixel gets, by the maps' matrices: as predicted for all that a cascade can
//! show, and for what is seen.

use bevy::{
    light::{CascadeShadowConfig, Cascades, DirectionalLightShadowMap},
    math::{DMat4, DVec2, DVec3, DVec4},
    prelude::*,
};
use bevy_pssm::{
    ShadowPlans, geometry::aliasing::Aliasing, plan::CascadePlan, systems::view_volume,
};

use super::accuracy::Truth;

/// A map and the depths it is for.
pub struct Map {
    /// Which of the light's cascades.
    pub cascade: usize,
    /// World space to its clip space.
    pub clip_from_world: DMat4,
    axes: [DVec3; 2],
    /// Texels.
    pub size: DVec2,
    /// Depth at which it ends (meters).
    pub far: f64,
    /// Worst over the cascade's slice, in texels across a pixel of a picture so many pixels high.
    predicted: Option<f64>,
}

impl Map {
    /// Where a point falls (texels).
    pub fn texel_at(&self, point: DVec3) -> DVec2 {
        let ndc = self.clip_from_world.project_point3(point).truncate();
        (0.5 + 0.5 * ndc) * self.size
    }
}

/// The maps of the last frame, the plugin's or Bevy's. Predictions start at the depth `near`:
/// at the eye no map is large enough.
pub fn maps_of(world: &World, camera: Entity, sun: Entity, near: f64, height: f64) -> Vec<Map> {
    let plans = world
        .get::<ShadowPlans>(sun)
        .and_then(|plans| plans.views.get(&camera))
        .filter(|plans| !plans.is_empty());
    let Some(plans) = plans else {
        return stock_maps(world, camera, sun, near, height).unwrap_or_default();
    };
    let of_plan = |(cascade, plan): (usize, &CascadePlan)| {
        let map = plan.map.as_ref()?;
        let axis = |axis: DVec4| axis.truncate().normalize();
        Some(Map {
            cascade,
            clip_from_world: map.clip_from_world,
            axes: [
                axis(map.world_from_cascade.x_axis),
                axis(map.world_from_cascade.y_axis),
            ],
            size: plan.map_size.as_dvec2(),
            far: plan.far,
            predicted: plan.texels_per_pixel(height),
        })
    };
    plans.iter().enumerate().filter_map(of_plan).collect()
}

fn stock_maps(
    world: &World,
    camera: Entity,
    sun: Entity,
    near: f64,
    height: f64,
) -> Option<Vec<Map>> {
    let config = world.get::<CascadeShadowConfig>(sun)?;
    let cascades = world.get::<Cascades>(sun)?.cascades.get(&camera)?;
    let size = DVec2::splat(world.resource::<DirectionalLightShadowMap>().size as f64);
    let view = view_volume(
        world.get::<GlobalTransform>(camera)?,
        world.get::<Projection>(camera)?,
        world.get::<Camera>(camera)?,
    )?;
    let maps = cascades.iter().enumerate().map(|(index, cascade)| {
        let far = f64::from(config.bounds[index]);
        let near = match index {
            0 => near,
            _ => f64::from((1.0 - config.overlap_proportion) * config.bounds[index - 1]),
        };
        let axis = |axis: Vec4| axis.truncate().as_dvec3().normalize();
        let clip_from_world = cascade.clip_from_world.as_dmat4();
        let axes = [
            axis(cascade.world_from_cascade.x_axis),
            axis(cascade.world_from_cascade.y_axis),
        ];
        let predicted = view
            .slice(near, far)
            .and_then(|slice| Aliasing::over(&clip_from_world, axes, &slice.vertices()))
            .map(|worst| worst.pixels_per_texel(size, height).max_element().recip());
        Map {
            cascade: index,
            clip_from_world,
            axes,
            size,
            far,
            predicted,
        }
    });
    Some(maps.collect())
}

/// Texels across a pixel where they are fewest: predicted for the slices, and seen at pixels
/// that face the sun. Perspective alone, as in Lloyd et al. 2006.
pub fn texels_per_pixel(maps: &[Map], truth: &Truth) -> [f64; 2] {
    let (lens, height) = (&truth.lens, f64::from(truth.lens.size.y));
    let predicted = maps.iter().filter_map(|map| map.predicted);
    let facing = truth.samples.iter().flatten().filter(|s| s.faces_sun);
    let seen = facing.filter_map(|sample| {
        let depth = lens.clip_from_world.row(3).dot(sample.point.extend(1.0));
        let map = maps.iter().find(|map| depth < map.far)?;
        let image_side = lens.pixel_size(sample.point) * height;
        let aliasing = Aliasing::at(&map.clip_from_world, map.axes, sample.point, image_side)?;
        Some(1.0 / aliasing.pixels_per_texel(map.size, height).max_element())
    });
    [
        predicted.fold(f64::INFINITY, f64::min),
        seen.fold(f64::INFINITY, f64::min),
    ]
}
