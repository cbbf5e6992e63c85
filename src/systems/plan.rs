//! Runs [`plan_cascades`](crate::plan::plan_cascades) for every managed light and 3D camera.

use bevy::{
    camera::{Camera, Camera3d, Projection, primitives::CascadesFrusta},
    ecs::{
        component::Component,
        entity::{Entity, EntityHashMap},
        query::With,
        system::{Local, Query},
    },
    light::{Cascades, DirectionalLight, cascade::Cascade},
    log::warn,
    math::{DAffine3, DMat3, Mat4, Vec3},
    transform::components::GlobalTransform,
};

use super::ManagedLight;
use crate::{
    geometry::{light_frame::LightFrame, slice::ViewVolume},
    plan::{CascadePlan, plan_cascades},
};

/// The plans of a managed light, one list of cascades for each active 3D camera.
#[derive(Component, Debug, Default, Clone)]
pub struct ShadowPlans {
    /// By camera.
    pub views: EntityHashMap<Vec<CascadePlan>>,
}

/// Plans the cascades of every managed light for every active 3D camera. Runs in
/// [`PssmSystems::PlanCascades`](super::PssmSystems::PlanCascades).
pub fn plan_shadows(
    cameras: Query<(Entity, &GlobalTransform, &Projection, &Camera), With<Camera3d>>,
    mut lights: Query<(
        Entity,
        &GlobalTransform,
        &DirectionalLight,
        &ManagedLight,
        &mut ShadowPlans,
        &mut Cascades,
        &mut CascadesFrusta,
    )>,
    mut warned: Local<bool>,
) {
    if lights.is_empty() {
        return;
    }
    let views: Vec<_> = cameras
        .iter()
        .filter(|(.., camera)| camera.is_active)
        .map(|(entity, transform, projection, camera)| {
            (entity, view_volume(transform, projection, camera))
        })
        .collect();

    for (light, transform, directional, managed, mut plans, mut cascades, mut frusta) in &mut lights
    {
        let Some(config) = managed.config() else {
            plans.views.clear();
            continue;
        };
        // With nothing to cull for, Bevy does not.
        cascades.cascades.clear();
        frusta.frusta.clear();

        let frame = LightFrame::new(transform.rotation().as_dquat() * glam::DVec3::Z);
        let reach = config.lookup_reach(directional);
        let mut degenerate = frame.is_none();
        plans.views.clear();
        plans.views.extend(views.iter().map(|(view, volume)| {
            degenerate |= volume.is_none();
            let planned = match (volume, &frame) {
                (Some(volume), Some(frame)) => plan_cascades(volume, frame, config, reach),
                _ => Vec::new(),
            };
            (*view, planned)
        }));
        if degenerate && !*warned {
            *warned = true;
            warn!(
                "Light {light} or a camera has a degenerate transform or projection: no shadows there"
            );
        }
    }
}

/// What a camera sees. `None` if its transform or projection is degenerate.
pub fn view_volume(
    transform: &GlobalTransform,
    projection: &Projection,
    camera: &Camera,
) -> Option<ViewVolume> {
    let affine = transform.affine();
    let world_from_view = DAffine3 {
        matrix3: DMat3::from_cols(
            affine.matrix3.x_axis.as_dvec3(),
            affine.matrix3.y_axis.as_dvec3(),
            affine.matrix3.z_axis.as_dvec3(),
        ),
        translation: affine.translation.as_dvec3(),
    };
    let clip_from_view = match &camera.sub_camera_view {
        Some(sub) => projection.get_clip_from_view_for_sub(sub),
        None => projection.get_clip_from_view(),
    };
    ViewVolume::new(world_from_view, &clip_from_view)
}

/// A plan in the terms of Bevy's component.
pub(super) fn published_cascade(plan: &CascadePlan) -> Cascade {
    plan.map
        .as_ref()
        .map_or_else(parked_cascade, |map| Cascade {
            world_from_cascade: map.world_from_cascade.as_mat4(),
            clip_from_cascade: map.clip_from_cascade.as_mat4(),
            clip_from_world: map.clip_from_world.as_mat4(),
            texel_size: map.texel.max_element() as f32,
        })
}

/// A cascade that covers nothing anyone will see, with matrices that can still be inverted.
pub fn parked_cascade() -> Cascade {
    const FAR_OUT: f32 = 1e9;
    let clip_from_world = Mat4::from_translation(Vec3::splat(FAR_OUT));
    Cascade {
        world_from_cascade: Mat4::from_translation(Vec3::splat(-FAR_OUT)),
        clip_from_cascade: Mat4::IDENTITY,
        clip_from_world,
        texel_size: 1.0,
    }
}
