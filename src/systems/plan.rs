//! Runs [`plan_cascades`](crate::plan::plan_cascades) for every managed light and 3D camera, over what
//! the camera sees.

use core::any::TypeId;

use bevy::{
    asset::Assets,
    camera::{
        Camera, Camera3d, Projection,
        primitives::{Aabb, CascadesFrusta},
        visibility::{
            InheritedVisibility, NoAutoAabb, NoCpuCulling, NoFrustumCulling, VisibleEntities,
        },
    },
    ecs::{
        component::Component,
        entity::{Entity, EntityHashMap},
        query::{Has, With, Without},
        system::{Local, Query, Res, ResMut},
    },
    light::{
        Cascades, DirectionalLight, NotShadowReceiver, VolumetricFog, VolumetricLight,
        cascade::Cascade,
    },
    log::warn,
    math::{DAffine3, DMat3, DVec3, Mat4, Vec3},
    mesh::{Mesh as MeshAsset, Mesh3d},
    transform::components::GlobalTransform,
};

use super::{ManagedLight, MeshParts, cull::world_bounds};
use crate::{
    config::ShadowFocus,
    geometry::{light_frame::LightFrame, receivers::Receivers, slice::ViewVolume},
    plan::{CascadePlan, PlanHistory, PlanInputs, plan_cascades},
};

/// The plans of a managed light, one list of cascades for each active 3D camera.
#[derive(Component, Debug, Default, Clone)]
pub struct ShadowPlans {
    /// By camera.
    pub views: EntityHashMap<Vec<CascadePlan>>,
    history: EntityHashMap<PlanHistory>,
}

type View<'a> = (
    Entity,
    &'a GlobalTransform,
    &'a Projection,
    &'a Camera,
    &'a VisibleEntities,
    Has<VolumetricFog>,
);

type Mesh<'a> = (
    Option<&'a Aabb>,
    &'a GlobalTransform,
    &'a InheritedVisibility,
    Has<NoFrustumCulling>,
    Has<NoAutoAabb>,
    &'a Mesh3d,
);

type IsReceiver = (With<Mesh3d>, Without<NotShadowReceiver>);

/// Plans the cascades of every managed light for every active 3D camera. Runs in
/// [`PssmSystems::PlanCascades`](super::PssmSystems::PlanCascades).
pub fn plan_shadows(
    cameras: Query<View, With<Camera3d>>,
    meshes: Query<Mesh, IsReceiver>,
    unculled: Query<Entity, (With<NoCpuCulling>, IsReceiver)>,
    mut lights: Query<(
        Entity,
        &GlobalTransform,
        &DirectionalLight,
        &ManagedLight,
        Has<VolumetricLight>,
        &mut ShadowPlans,
        &mut Cascades,
        &mut CascadesFrusta,
    )>,
    assets: Option<Res<Assets<MeshAsset>>>,
    mut parts: ResMut<MeshParts>,
    mut warned: Local<bool>,
) {
    let is_focused = |managed: &ManagedLight| {
        let config = managed.config();
        config.is_some_and(|config| config.focus == ShadowFocus::Receivers)
    };
    if lights.is_empty() {
        return;
    }
    let gathers = lights
        .iter()
        .any(|(.., managed, _, _, _, _)| is_focused(managed));
    let views: Vec<_> = cameras
        .iter()
        .filter(|(_, _, _, camera, ..)| camera.is_active)
        .map(
            |(entity, transform, projection, camera, visible, has_fog)| {
                let height = camera.physical_viewport_size().map_or(0, |size| size.y);
                let seen = view_volume(transform, projection, camera).map(|volume| {
                    let receivers = if gathers {
                        let visible = visible.get(TypeId::of::<Mesh3d>()).iter().copied();
                        let visible = visible.chain(&unculled);
                        receivers(&volume, &meshes, visible, assets.as_deref(), &mut parts)
                    } else {
                        Receivers::everywhere(&volume)
                    };
                    (volume, receivers, has_fog, height)
                });
                (entity, seen)
            },
        )
        .collect();

    for (light, transform, directional, managed, in_fog, mut plans, mut cascades, mut frusta) in
        &mut lights
    {
        let Some(config) = managed.config() else {
            *plans = ShadowPlans::default();
            continue;
        };
        // With nothing to cull for, Bevy does not.
        cascades.cascades.clear();
        frusta.frusta.clear();

        let frame = LightFrame::new(transform.rotation().as_dquat() * DVec3::Z);
        let mut degenerate = frame.is_none();
        let ShadowPlans {
            views: planned,
            history,
        } = &mut *plans;
        planned.clear();
        history.retain(|view, _| views.iter().any(|(active, _)| active == view));
        for (view, seen) in &views {
            degenerate |= seen.is_none();
            let plan = match (seen, &frame) {
                (Some((volume, receivers, has_fog, height)), Some(frame)) => {
                    let fog = Receivers::fog(volume);
                    let inputs = PlanInputs {
                        view: volume,
                        light: frame,
                        config,
                        reach: config.lookup_reach(directional),
                        receivers: if in_fog && *has_fog { &fog } else { receivers },
                        image_height: f64::from((*height).max(1)),
                    };
                    plan_cascades(&inputs, history.entry(*view).or_default())
                }
                _ => Vec::new(),
            };
            planned.insert(*view, plan);
        }
        if degenerate && !*warned {
            *warned = true;
            warn!(
                "Light {light} or a camera has a degenerate transform or projection: no shadows there"
            );
        }
    }
}

/// The boxes of what a camera sees.
fn receivers(
    view: &ViewVolume,
    meshes: &Query<Mesh, IsReceiver>,
    visible: impl Iterator<Item = Entity>,
    assets: Option<&Assets<MeshAsset>>,
    parts: &mut MeshParts,
) -> Receivers {
    let is_there = |mesh: &Mesh3d| assets.is_none_or(|assets| assets.contains(&mesh.0));
    let mut receivers = Receivers::new(view);
    for (aabb, transform, inherited, no_culling, no_bounds, mesh) in
        meshes.iter_many(visible).flatten()
    {
        match aabb {
            _ if !inherited.get() => {}
            // Still loading, and not drawn.
            None if !no_culling && !no_bounds && !is_there(mesh) => {}
            Some(aabb) if !no_culling => {
                let world_from_local = transform.affine();
                let (center, half_axes) = world_bounds(aabb, &world_from_local);
                let parts = match assets {
                    Some(assets) if !no_bounds && is_close(view, center, &half_axes) => {
                        parts.of(mesh.0.id(), aabb, assets)
                    }
                    _ => &[],
                };
                for part in parts {
                    let (center, half_axes) = world_bounds(part, &world_from_local);
                    receivers.add(center, &half_axes);
                }
                if parts.is_empty() {
                    receivers.add(center, &half_axes);
                }
            }
            _ => receivers.add_everywhere(),
        }
    }
    receivers
}

/// Whether the eye is in a box, or almost, so that its parts should be told apart.
fn is_close(view: &ViewVolume, center: DVec3, half_axes: &DMat3) -> bool {
    let half_axes = [half_axes.x_axis, half_axes.y_axis, half_axes.z_axis];
    let radius_2: f64 = half_axes.iter().map(|axis| axis.length_squared()).sum();
    center.distance_squared(view.eye) < radius_2
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
