//! What a camera sees: its volume, and the boxes in it that receive shadows.

use bevy::{
    asset::Assets,
    camera::{
        Camera, Projection,
        primitives::Aabb,
        visibility::{InheritedVisibility, NoAutoAabb, NoFrustumCulling},
    },
    ecs::{
        entity::{Entity, EntityHashSet},
        query::{Has, QueryData, With, Without},
        system::Query,
    },
    light::NotShadowReceiver,
    math::{Affine3A, DAffine3, DMat3, Vec3A},
    mesh::{Mesh, Mesh3d},
    tasks::{ComputeTaskPool, TaskPool},
    transform::components::GlobalTransform,
};

use super::{
    MeshBoxes,
    bounds::{BoundsMargin, Margin, world_bounds},
};
use crate::geometry::{oriented_box::OrientedBox, receivers::Receivers, slice::ViewVolume};

#[derive(QueryData)]
pub struct ReceiverMesh {
    aabb: Option<&'static Aabb>,
    transform: &'static GlobalTransform,
    inherited: &'static InheritedVisibility,
    is_unculled: Has<NoFrustumCulling>,
    has_no_bounds: Has<NoAutoAabb>,
    margin: Option<&'static BoundsMargin>,
    mesh: &'static Mesh3d,
    entity: Entity,
}

/// Visible meshes that are looked up together.
const TOGETHER: usize = 2048;

pub(super) type IsReceiver = (With<Mesh3d>, Without<NotShadowReceiver>);

/// The boxes of what a camera sees, but for what is wholly deeper than `far` (meters).
pub(super) fn receivers(
    view: &ViewVolume,
    far: f64,
    meshes: &Query<ReceiverMesh, IsReceiver>,
    visible: &[Entity],
    assets: Option<&Assets<Mesh>>,
    parts: &mut MeshBoxes,
    displaced: &EntityHashSet,
) -> Receivers {
    let is_there = |mesh: &Mesh3d| assets.is_none_or(|assets| assets.contains(&mesh.0));
    let mut receivers = Receivers::new(view).before(far);
    let range = Range::new(view, far);
    let is_near = |it: &ReceiverMeshItem| it.inherited.get() && !range.ends_before(it);
    let near: Vec<Entity>;
    let visible = if visible.len() <= TOGETHER {
        visible
    } else {
        let pool = ComputeTaskPool::get_or_init(TaskPool::default);
        let is_near = &is_near;
        let found = pool.scope(|scope| {
            for some in visible.chunks(TOGETHER) {
                scope.spawn(async move {
                    let meshes = meshes.iter_many(some).flatten().filter(is_near);
                    meshes.map(|it| it.entity).collect::<Vec<_>>()
                });
            }
        });
        near = found.concat();
        &near
    };
    for it in meshes.iter_many(visible).flatten().filter(is_near) {
        match it.aabb {
            // Still loading, and not drawn.
            None if !it.is_unculled && !it.has_no_bounds && !is_there(it.mesh) => {}
            Some(aabb) if !it.is_unculled && aabb.half_extents.is_finite() => {
                let world_from_local = it.transform.affine();
                let margin = Margin::of(it.entity, it.margin, displaced);
                let bounds = world_bounds(aabb, &world_from_local, margin);
                let has_parts = !it.has_no_bounds && margin != Margin::OwnSize;
                let parts = match assets {
                    Some(assets) if has_parts && is_close(view, &bounds) => {
                        parts.of(it.mesh.0.id(), aabb, assets)
                    }
                    _ => &[],
                };
                for part in parts {
                    receivers.add(&world_bounds(part, &world_from_local, margin));
                }
                if margin == Margin::Meters(f64::INFINITY) {
                    receivers.add_everywhere();
                } else if parts.is_empty() {
                    receivers.add(&bounds);
                }
            }
            _ => receivers.add_everywhere(),
        }
    }
    receivers
}

/// How deep a camera sees shadows, in `f32`: what lies beyond is sooner told than by boxes.
struct Range {
    eye: Vec3A,
    per_meter: Vec3A,
    far: f32,
}

impl Range {
    fn new(view: &ViewVolume, far: f64) -> Self {
        Self {
            eye: view.eye.as_vec3a(),
            per_meter: view.per_depth().as_vec3a(),
            far: far as f32,
        }
    }

    /// Whether a mesh is certainly deeper.
    #[inline]
    fn ends_before(&self, it: &ReceiverMeshItem) -> bool {
        let reaches_far = it.is_unculled || it.margin.is_some();
        it.aabb.is_some_and(|aabb| {
            let is_known = !reaches_far && aabb.half_extents.is_finite();
            is_known && self.ends_before_box(aabb, &it.transform.affine())
        })
    }

    /// The same of one that reaches out of its box by its own size at most.
    #[inline]
    fn ends_before_box(&self, aabb: &Aabb, world_from_local: &Affine3A) -> bool {
        const ROUNDING: f32 = 1e-6;
        let (axes, origin) = (&world_from_local.matrix3, world_from_local.translation);
        let magnitude = (origin.abs() + self.eye.abs()).max_element() + self.far.abs();
        let rounding = 4.0 * ROUNDING * magnitude * self.per_meter.length();
        let depth = self.per_meter.dot(origin - self.eye);
        let beyond = depth - rounding - self.far * (1.0 + ROUNDING);
        // Of four times a sphere around the box, about the mesh's origin.
        let stretch_2 = axes.x_axis.length_squared()
            + axes.y_axis.length_squared()
            + axes.z_axis.length_squared();
        let extent_2 = aabb.center.length_squared() + aabb.half_extents.length_squared();
        let reach_2 = 32.0 * stretch_2 * extent_2 * self.per_meter.length_squared();
        beyond > 0.0 && beyond * beyond > reach_2 * (1.0 + ROUNDING)
    }
}

/// Whether the eye is in a box, or almost: then boxes of the mesh's parts say more.
fn is_close(view: &ViewVolume, bounds: &OrientedBox) -> bool {
    let axes = bounds.half_axes;
    let half_axes = [axes.x_axis, axes.y_axis, axes.z_axis];
    let radius_2: f64 = half_axes.iter().map(|axis| axis.length_squared()).sum();
    bounds.center.distance_squared(view.eye) < radius_2
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
