//! The parts of large meshes that a camera stands close to.

use bevy::{
    asset::{AssetEvent, AssetId, Assets},
    camera::primitives::Aabb,
    ecs::{message::MessageReader, resource::Resource, system::ResMut},
    math::{Vec3, Vec3A},
    mesh::Mesh,
    platform::collections::HashMap,
};

use crate::geometry::{hysteresis::SHRINK_DELAY, mesh_boxes::part_boxes};

/// Smaller meshes are known by their own box (triangles).
const MIN_TRIANGLES: usize = 512;

/// Boxes that differ by less than this, as a share of their size, are the same.
const ROUNDING: f32 = 1e-5;

/// The boxes of meshes' parts, worked out when they are first asked for.
#[derive(Resource, Debug, Default)]
pub struct MeshBoxes {
    known: HashMap<AssetId<Mesh>, Known>,
    /// Meshes that have changed lately, and for how many frames more they have no parts: those that
    /// change with every frame would cost too much.
    changing: HashMap<AssetId<Mesh>, u32>,
}

#[derive(Debug, Default)]
struct Known {
    whole: Aabb,
    parts: Vec<Aabb>,
}

impl MeshBoxes {
    /// The boxes of a mesh's parts, in its own space. Empty if the mesh is small, not there, without
    /// indices, changing, moved by joints or targets, or if an entity's box is not that of the mesh's
    /// vertices: then something else moves them.
    pub fn of(&mut self, id: AssetId<Mesh>, aabb: &Aabb, assets: &Assets<Mesh>) -> &[Aabb] {
        if self.changing.contains_key(&id) {
            return &[];
        }
        let known = || assets.get(id).and_then(Known::new).unwrap_or_default();
        let known = self.known.entry(id).or_insert_with(known);
        if is_same(&known.whole, aabb) {
            &known.parts
        } else {
            &[]
        }
    }
}

impl Known {
    fn new(mesh: &Mesh) -> Option<Self> {
        let triangles = mesh.try_indices().ok()?.len() / 3;
        let moves = [
            mesh.try_contains_attribute(Mesh::ATTRIBUTE_JOINT_INDEX),
            mesh.try_has_morph_targets(),
        ];
        let is_rigid = moves.iter().all(|moves| matches!(moves, Ok(false)));
        if triangles < MIN_TRIANGLES || !is_rigid {
            return None;
        }
        let vertices = mesh.try_attribute(Mesh::ATTRIBUTE_POSITION).ok()?;
        let vertices = vertices.as_float3()?.iter().copied().map(Vec3::from);
        let triangles = || {
            let triangles = mesh.triangles().into_iter().flatten();
            triangles.map(|triangle| triangle.vertices)
        };
        let boxes = part_boxes(triangles).into_iter();
        Some(Self {
            whole: Aabb::enclosing(vertices)?,
            parts: boxes.map(|[lo, hi]| Aabb::from_min_max(lo, hi)).collect(),
        })
    }
}

fn is_same(a: &Aabb, b: &Aabb) -> bool {
    let off = |a: Vec3A, b: Vec3A| (a - b).abs().max_element();
    let off = off(a.min(), b.min()).max(off(a.max(), b.max()));
    off <= ROUNDING * a.half_extents.max_element()
}

/// Forgets the parts of meshes that have changed or gone.
pub fn forget_changed(mut events: MessageReader<AssetEvent<Mesh>>, mut boxes: ResMut<MeshBoxes>) {
    let MeshBoxes { known, changing } = &mut *boxes;
    changing.retain(|_, frames| {
        *frames -= 1;
        *frames > 0
    });
    for event in events.read() {
        match event {
            AssetEvent::Modified { id } => {
                known.remove(id);
                changing.insert(*id, SHRINK_DELAY);
            }
            AssetEvent::Removed { id } | AssetEvent::Added { id } => {
                known.remove(id);
                changing.remove(id);
            }
            AssetEvent::Unused { .. } | AssetEvent::LoadedWithDependencies { .. } => {}
        }
    }
}
