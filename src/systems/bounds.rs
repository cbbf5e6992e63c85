//! Bounds of meshes in the world, and of those that a vertex shader moves.

use std::sync::{Mutex, PoisonError};

use bevy::{
    camera::primitives::Aabb,
    ecs::{
        component::Component,
        entity::{Entity, EntityHashSet},
        lifecycle::RemovedComponents,
        query::With,
        reflect::ReflectComponent,
        resource::Resource,
        system::{Query, Res},
    },
    math::{Affine3A, DMat3},
    mesh::Mesh3d,
    platform::sync::Arc,
    reflect::{Reflect, std_traits::ReflectDefault},
};

use crate::geometry::oriented_box::OrientedBox;

/// How far the vertex shader of a mesh's material may move vertices out of the mesh's bounds (meters
/// in the world, whatever the mesh's scale).
///
/// Without it, a mesh whose material has a vertex shader of its own is taken to reach out of its bounds
/// by half of its longest side, which costs sharpness where that is much too far. Of casters that have
/// never been seen, nor thrown a shadow, that is not known: where such a mesh is moved far, it wants a
/// margin. Infinite ones are allowed.
#[derive(Component, Reflect, Debug, Default, Clone, Copy, PartialEq)]
#[reflect(Component, Default, Debug, Clone, PartialEq)]
pub struct BoundsMargin(pub f32);

/// Entities whose material has a vertex shader of its own, as far as the renderer has seen them.
#[derive(Resource, Debug, Default, Clone)]
pub struct DisplacedMeshes(Arc<Mutex<Arc<EntityHashSet>>>);

impl DisplacedMeshes {
    /// Changes the set.
    pub fn update(&self, change: impl FnOnce(&mut EntityHashSet)) {
        let mut entities = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        change(Arc::make_mut(&mut entities));
    }

    pub(super) fn get(&self) -> Arc<EntityHashSet> {
        let entities = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        entities.clone()
    }
}

/// Forgets meshes that have gone, but for those that have come back since.
pub(super) fn forget_removed(
    mut removed: RemovedComponents<Mesh3d>,
    meshes: Query<(), With<Mesh3d>>,
    displaced: Res<DisplacedMeshes>,
) {
    let gone = removed.read().filter(|entity| !meshes.contains(*entity));
    let gone: Vec<Entity> = gone.collect();
    if !gone.is_empty() && !displaced.get().is_empty() {
        displaced.update(|known| {
            for entity in gone {
                known.remove(&entity);
            }
        });
    }
}

/// By how much a mesh may reach out of its box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Margin {
    None,
    /// In world space.
    Meters(f64),
    /// Half of its longest side.
    OwnSize,
}

impl Margin {
    pub fn of(entity: Entity, margin: Option<&BoundsMargin>, displaced: &EntityHashSet) -> Self {
        match margin {
            Some(BoundsMargin(meters)) if !meters.is_nan() => {
                Self::Meters(f64::from(meters.max(0.0)))
            }
            _ if displaced.contains(&entity) => Self::OwnSize,
            _ => Self::None,
        }
    }
}

/// A local box in world space, with a margin around it.
pub(super) fn world_bounds(
    aabb: &Aabb,
    world_from_local: &Affine3A,
    margin: Margin,
) -> OrientedBox {
    let matrix = &world_from_local.matrix3;
    let axes = DMat3::from_cols(
        matrix.x_axis.as_dvec3(),
        matrix.y_axis.as_dvec3(),
        matrix.z_axis.as_dvec3(),
    );
    let local_half = aabb.half_extents.as_dvec3();
    let [x_ws, y_ws, z_ws] = [
        axes.x_axis * local_half.x,
        axes.y_axis * local_half.y,
        axes.z_axis * local_half.z,
    ];
    let bounds = OrientedBox {
        center: axes * aabb.center.as_dvec3() + world_from_local.translation.as_dvec3(),
        half_axes: DMat3::from_cols(x_ws, y_ws, z_ws),
    };
    let meters = match margin {
        Margin::None => return bounds,
        Margin::Meters(meters) => meters,
        Margin::OwnSize => x_ws.length().max(y_ws.length()).max(z_ws.length()),
    };
    // Along the world's axes, or flat and sheared boxes would have none on some sides.
    let half_ws = x_ws.abs() + y_ws.abs() + z_ws.abs();
    OrientedBox {
        half_axes: DMat3::from_diagonal(half_ws + meters),
        ..bounds
    }
}
