//! What Bevy's built-in shadows are planned to be.

use bevy::{
    camera::{Camera, OrthographicProjection, PerspectiveProjection, Projection},
    ecs::{system::RunSystemOnce, world::World},
    light::{
        CascadeShadowConfigBuilder, Cascades, DirectionalLight, DirectionalLightShadowMap,
        cascade::{Cascade, build_directional_light_cascades},
    },
    math::{Affine3A, DVec2, Rect, UVec2, Vec2, Vec3},
    transform::components::{GlobalTransform, Transform},
};
use bevy_pssm::{
    geometry::hull::CasterHull,
    plan::{CascadeMap, CascadePlan},
    prelude::*,
};

use super::case::{Lens, Planned};

/// What Bevy's own system makes of the same camera, sun, range and map size, as plans of the plugin's kind.
pub fn built_in(planned: &Planned) -> Vec<CascadePlan> {
    let Planned { view, config, .. } = planned;
    let MapSize::Same(size) = config.map_size else {
        unreachable!("all maps here are of one size");
    };
    // With the first bound where a logarithmic scheme has it, all are.
    let growth = (config.far / config.near).powf(1.0 / config.cascades as f32);
    let bounds = CascadeShadowConfigBuilder {
        num_cascades: config.cascades as usize,
        // From all that is seen on, but for what lies behind the eye, which it does not allow.
        minimum_distance: view.nearest().max(0.0) as f32,
        maximum_distance: config.far,
        first_cascade_far_bound: growth * config.near,
        ..Default::default()
    }
    .build();
    let ends: Vec<f64> = bounds.bounds.iter().map(|end| f64::from(*end)).collect();

    let mut world = World::new();
    let size_of_all = size as usize;
    world.insert_resource(DirectionalLightShadowMap { size: size_of_all });
    let place = Affine3A::from_mat3_translation(view.axes.as_mat3(), view.eye.as_vec3());
    let seen = (
        Camera::default(),
        projection(planned.lens),
        GlobalTransform::from(place),
    );
    let camera = world.spawn(seen).id();
    let aimed = Transform::default().looking_to(-planned.to_light.as_vec3(), Vec3::Y);
    let shining = DirectionalLight {
        shadow_maps_enabled: true,
        ..Default::default()
    };
    let shining = (shining, bounds, GlobalTransform::from(aimed));
    let light = world.spawn(shining).id();
    world
        .run_system_once(build_directional_light_cascades)
        .expect("all that the system asks for is there");
    let cascades = world.get::<Cascades>(light).expect("a light has them");
    let plan = |(index, cascade): (usize, &Cascade)| CascadePlan {
        // Its shader takes the first that has not ended.
        near: index
            .checked_sub(1)
            .map_or(f64::NEG_INFINITY, |before| ends[before]),
        far: ends[index],
        blend_start: ends[index],
        wedge: None,
        map_size: UVec2::splat(size),
        map: Some(CascadeMap {
            clip_from_world: cascade.clip_from_world.as_dmat4(),
            clip_from_cascade: cascade.clip_from_cascade.as_dmat4(),
            world_from_cascade: cascade.world_from_cascade.as_dmat4(),
            texel: DVec2::splat(cascade.texel_size.into()),
            fit: MapFit::Stable,
            strength: 0.0,
            hull: CasterHull::default(),
            hull_now: CasterHull::default(),
            aliasing: None,
            redraw: None,
        }),
    };
    let cascades = cascades.cascades[&camera].iter();
    cascades.enumerate().map(plan).collect()
}

fn projection(lens: Lens) -> Projection {
    match lens {
        Lens::Endless { fov, aspect, near }
        | Lens::Ending {
            fov, aspect, near, ..
        } => Projection::Perspective(PerspectiveProjection {
            fov: fov.to_radians(),
            aspect_ratio: aspect,
            near,
            ..Default::default()
        }),
        Lens::Orthographic {
            height,
            aspect,
            near,
            far,
        } => {
            let half = 0.5 * height * Vec2::new(aspect, 1.0);
            Projection::Orthographic(OrthographicProjection {
                near,
                far,
                area: Rect::from_center_half_size(Vec2::ZERO, half),
                ..OrthographicProjection::default_3d()
            })
        }
    }
}
