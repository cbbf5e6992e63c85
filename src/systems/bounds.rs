//! Bounds of meshes in the world, and of those that a vertex shader moves.

use std::sync::{Mutex, PoisonError};

use bevy::{
    camera::primitives::Aabb,
    ecs::{
        component::Component,
        entity::{Entity, EntityHashSet},
        reflect::ReflectComponent,
        resource::Resource,
    },
    math::{Affine3A, DMat3, DVec3},
    platform::sync::Arc,
    reflect::{Reflect, std_traits::ReflectDefault},
};

use crate::geometry::oriented_box::OrientedBox;

/// How far the vertex shader of a mesh's material may move vertices out of the mesh's bounds (meters).
///
/// Without it, a mesh whose material has a vertex shader of its own is taken to reach out of its bounds
/// by half of its longest side, which costs sharpness where that is much too far.
#[derive(Component, Reflect, Debug, Default, Clone, Copy, PartialEq)]
#[reflect(Component, Default, Debug, Clone, PartialEq)]
pub struct BoundsMargin(pub f32);

/// Entities whose material has a vertex shader of its own, as the renderer last knew.
#[derive(Resource, Debug, Default, Clone)]
pub struct DisplacedMeshes(Arc<Mutex<EntityHashSet>>);

impl DisplacedMeshes {
    /// Replaces the set.
    pub fn set(&self, entities: EntityHashSet) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = entities;
    }

    pub(super) fn get(&self) -> EntityHashSet {
        let entities = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        entities.clone()
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
            Some(BoundsMargin(meters)) if meters.is_finite() => {
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
    let half = aabb.half_extents.as_dvec3();
    let scale = DVec3::new(
        axes.x_axis.length(),
        axes.y_axis.length(),
        axes.z_axis.length(),
    );
    let meters = match margin {
        Margin::None => 0.0,
        Margin::Meters(meters) => meters,
        Margin::OwnSize => (half * scale).max_element(),
    };
    // Of an axis of no length nothing could be taken for a margin along it.
    let half = half + DVec3::splat(meters) / scale.max(DVec3::splat(f64::MIN_POSITIVE));
    OrientedBox {
        center: axes * aabb.center.as_dvec3() + world_from_local.translation.as_dvec3(),
        half_axes: DMat3::from_cols(
            axes.x_axis * half.x,
            axes.y_axis * half.y,
            axes.z_axis * half.z,
        ),
    }
}
