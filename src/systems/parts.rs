//! The parts of large meshes that a camera stands close to.

use bevy::{
    asset::{AssetEvent, AssetId, Assets},
    camera::primitives::{Aabb, MeshAabb},
    ecs::{message::MessageReader, resource::Resource, system::ResMut},
    mesh::Mesh,
    platform::collections::HashMap,
};

use crate::geometry::parts::parts;

/// What has fewer is no terrain (triangles).
const LEAST_TRIANGLES: usize = 512;

/// The boxes of meshes' parts, worked out when they are first asked for.
#[derive(Resource, Debug, Default)]
pub struct MeshParts(HashMap<AssetId<Mesh>, Known>);

#[derive(Debug)]
struct Known {
    whole: Aabb,
    parts: Vec<Aabb>,
}

impl MeshParts {
    /// The boxes of a mesh's parts, in its own space. None if the mesh is small, not there, moved by
    /// joints or targets, or if an entity's box is not the mesh's: then something else moves it.
    pub fn of(&mut self, id: AssetId<Mesh>, aabb: &Aabb, assets: &Assets<Mesh>) -> &[Aabb] {
        let known = self
            .0
            .entry(id)
            .or_insert_with(|| Known::new(assets.get(id)));
        if known.whole == *aabb {
            &known.parts
        } else {
            &[]
        }
    }
}

impl Known {
    fn new(mesh: Option<&Mesh>) -> Self {
        let whole = mesh.and_then(MeshAabb::get_aabb).unwrap_or_default();
        let parts = mesh.filter(|mesh| is_large_and_rigid(mesh)).map(parts_of);
        Self {
            whole,
            parts: parts.unwrap_or_default(),
        }
    }
}

fn is_large_and_rigid(mesh: &Mesh) -> bool {
    let triangles = mesh.try_indices().map_or(0, |indices| indices.len() / 3);
    let moves = [
        mesh.try_contains_attribute(Mesh::ATTRIBUTE_JOINT_INDEX),
        mesh.try_has_morph_targets(),
    ];
    triangles >= LEAST_TRIANGLES && moves.iter().all(|moves| matches!(moves, Ok(false)))
}

fn parts_of(mesh: &Mesh) -> Vec<Aabb> {
    let triangles = || {
        let triangles = mesh.triangles().into_iter().flatten();
        triangles.map(|triangle| triangle.vertices)
    };
    let boxes = parts(triangles).into_iter();
    boxes.map(|[lo, hi]| Aabb::from_min_max(lo, hi)).collect()
}

/// Forgets the parts of meshes that have changed or gone.
pub fn forget_parts(mut events: MessageReader<AssetEvent<Mesh>>, mut known: ResMut<MeshParts>) {
    for event in events.read() {
        match event {
            AssetEvent::Modified { id } | AssetEvent::Removed { id } | AssetEvent::Added { id } => {
                known.0.remove(id);
            }
            AssetEvent::Unused { .. } | AssetEvent::LoadedWithDependencies { .. } => {}
        }
    }
}
