//! What is planned and culled for a side's cascades.

use bevy::{
    camera::visibility::CascadesVisibleEntities,
    ecs::query::QueryData,
    light::{CascadeShadowConfig, Cascades},
    prelude::*,
};
use bevy_pssm::{CasterCascades, ShadowPlans, plan::CascadePlan, systems::view_volume};

use super::super::sides::{Side, SideCamera, SideSun};
use super::{CascadeFigures, MapState};

/// A side's sun.
#[derive(QueryData)]
pub(super) struct Sun {
    side: &'static SideSun,
    light: &'static DirectionalLight,
    plans: Option<&'static ShadowPlans>,
    casters: Option<&'static CasterCascades>,
    config: &'static CascadeShadowConfig,
    cascades: &'static Cascades,
    lists: &'static CascadesVisibleEntities,
}

/// A side's camera.
#[derive(QueryData)]
pub(super) struct Eye {
    entity: Entity,
    side: &'static SideCamera,
    camera: &'static Camera,
    transform: &'static GlobalTransform,
    projection: &'static Projection,
}

/// None while the side is not shown or has no shadows.
pub(super) fn cascades_of(side: Side, suns: &Query<Sun>, eyes: &Query<Eye>) -> Vec<CascadeFigures> {
    let sun = suns.iter().find(|it| it.side.0 == side);
    let mut active = eyes.iter().filter(|it| it.camera.is_active);
    let (Some(sun), Some(eye)) = (sun, active.find(|it| it.side.0 == side)) else {
        return Vec::new();
    };
    let plans = sun.plans.and_then(|plans| plans.views.get(&eye.entity));
    let mut cascades = match plans {
        Some(plans) if !plans.is_empty() => planned(plans, image_height(&eye)),
        _ if sun.light.shadow_maps_enabled => built_in(&sun, &eye),
        _ => Vec::new(),
    };
    let lists = sun.lists.entities.get(&eye.entity);
    let moving = sun.casters.and_then(|it| it.moving.get(&eye.entity));
    for (index, cascade) in cascades.iter_mut().enumerate() {
        let list = lists.and_then(|lists| lists.get(index));
        cascade.casters = list.map_or(0, |list| list.entities.len());
        cascade.moving = moving.map_or(0, |moving| {
            moving.iter().filter(|(_, set)| set.contains(index)).count()
        });
    }
    cascades
}

/// Pixels.
fn image_height(eye: &EyeItem) -> f64 {
    let size = eye.camera.physical_viewport_size();
    f64::from(size.map_or(1, |size| size.y.max(1)))
}

fn planned(plans: &[CascadePlan], image_height: f64) -> Vec<CascadeFigures> {
    let state = |plan: &CascadePlan| match &plan.map {
        None => MapState::Missing,
        Some(map) => map.redraw.map_or(MapState::Held, MapState::Drawn),
    };
    let figures = |plan: &CascadePlan| CascadeFigures {
        far: plan.far,
        map: state(plan),
        texels_per_pixel: plan.texels_per_pixel(image_height),
        texel: plan.map.as_ref().map(|map| map.texel.max_element()),
        ..default()
    };
    plans.iter().map(figures).collect()
}

/// Bevy's cascades, whose texels are fewest to a pixel where each begins.
fn built_in(sun: &SunItem, eye: &EyeItem) -> Vec<CascadeFigures> {
    let view = view_volume(eye.transform, eye.projection, eye.camera);
    let config = sun.config;
    let begins = config
        .bounds
        .iter()
        .map(|bound| bound * (1.0 - config.overlap_proportion));
    let begins = [config.minimum_distance].into_iter().chain(begins);
    let known = sun.cascades.cascades.get(&eye.entity).into_iter().flatten();
    let all = config.bounds.iter().zip(begins).zip(known);
    all.map(|((far, begin), cascade)| {
        let texel = f64::from(cascade.texel_size);
        let pixel = view.map(|view| {
            let depth = f64::from(begin).max(view.nearest());
            view.image_height(depth) / image_height(eye)
        });
        CascadeFigures {
            far: f64::from(*far),
            map: MapState::BuiltIn,
            texels_per_pixel: pixel.map(|pixel| pixel / texel),
            texel: Some(texel),
            ..default()
        }
    })
    .collect()
}
