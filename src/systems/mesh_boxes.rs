//! The parts of large meshes that a camera stands close to.

use bevy::{
    asset::{AssetEvent, AssetId, Assets},
    camera::primitives::Aabb,
    ecs::{message::MessageReader, resource::Resource, system::ResMut},
    math::{Vec3, Vec3A},
    mesh::{Indices, Mesh, PrimitiveTopology},
    platform::collections::HashMap,
    tasks::{AsyncComputeTaskPool, Task, TaskPool, futures::check_ready},
};

use crate::geometry::{hysteresis::SHRINK_DELAY, mesh_boxes::part_boxes};

/// Smaller meshes are known by their own box (triangles).
const MIN_TRIANGLES: usize = 512;

/// Boxes that differ by less than this, as a share of their size, are the same.
const ROUNDING: f32 = 1e-5;

/// Of meshes with more triangles the parts are worked out beside the game, and known some frames later: these take less
/// than a millisecond.
const MOST_AT_ONCE: usize = 1 << 14;

/// The boxes of meshes' parts, worked out when they are first asked for.
#[derive(Resource, Debug, Default)]
pub struct MeshBoxes {
    known: HashMap<AssetId<Mesh>, Known>,
    /// Meshes that have changed lately, and for how many frames more they have no parts: those that
    /// change with every frame would cost too much.
    changing: HashMap<AssetId<Mesh>, u32>,
    /// Whether a mesh that was asked for will have parts later.
    is_working: bool,
}

#[derive(Debug)]
enum Known {
    Working(Task<Option<Boxes>>),
    Done(Option<Boxes>),
}

/// The whole mesh's box and its parts'.
type Boxes = (Aabb, Vec<Aabb>);

impl MeshBoxes {
    /// The boxes of a mesh's parts, in its own space. Empty if the mesh is small, not there, without
    /// indices, changing, moved by joints or targets, if an entity's box is not that of the mesh's
    /// vertices, as something else then moves them, or until the parts are worked out.
    pub fn of(&mut self, id: AssetId<Mesh>, aabb: &Aabb, assets: &Assets<Mesh>) -> &[Aabb] {
        if self.changing.contains_key(&id) {
            self.is_working = true;
            return &[];
        }
        let mesh = || assets.get(id).and_then(Surface::of_mesh);
        let known = self.known.entry(id).or_insert_with(|| Known::of(mesh()));
        if let Known::Working(task) = known {
            match check_ready(task) {
                Some(boxes) => *known = Known::Done(boxes),
                None => self.is_working = true,
            }
        }
        match known {
            Known::Done(Some((whole, parts))) if is_same(whole, aabb) => parts,
            _ => &[],
        }
    }
}

impl MeshBoxes {
    /// Whether no mesh has changed lately.
    pub fn are_settled(&self) -> bool {
        self.changing.is_empty()
    }

    /// Whether all that was asked for since the last call is known.
    pub fn take_is_settled(&mut self) -> bool {
        !core::mem::take(&mut self.is_working)
    }
}

impl Known {
    fn of(surface: Option<Surface>) -> Self {
        let Some(surface) = surface else {
            return Self::Done(None);
        };
        if surface.indices.len() / 3 <= MOST_AT_ONCE {
            return Self::Done(surface.boxes());
        }
        // The renderer may take the mesh's data away, and the game may change it.
        let positions = surface.positions.to_vec();
        let indices = surface.indices.clone();
        let pool = AsyncComputeTaskPool::get_or_init(TaskPool::default);
        Self::Working(pool.spawn(async move {
            let surface = Surface {
                positions: &positions,
                indices: &indices,
            };
            surface.boxes()
        }))
    }
}

/// A mesh that is worth parts: large, in one piece, a list of triangles.
struct Surface<'a> {
    positions: &'a [[f32; 3]],
    indices: &'a Indices,
}

impl<'a> Surface<'a> {
    fn of_mesh(mesh: &'a Mesh) -> Option<Self> {
        let indices = mesh.try_indices().ok()?;
        let moves = [
            mesh.try_contains_attribute(Mesh::ATTRIBUTE_JOINT_INDEX),
            mesh.try_has_morph_targets(),
        ];
        let is_rigid = moves.iter().all(|moves| matches!(moves, Ok(false)));
        let is_list = mesh.primitive_topology() == PrimitiveTopology::TriangleList;
        let vertices = mesh.try_attribute(Mesh::ATTRIBUTE_POSITION).ok()?;
        let positions = vertices.as_float3()?;
        let is_worth_it = is_rigid && is_list && indices.len() / 3 >= MIN_TRIANGLES;
        is_worth_it.then_some(Self { positions, indices })
    }

    fn boxes(&self) -> Option<Boxes> {
        let vertices = self.positions.iter().copied().map(Vec3::from);
        let whole = Aabb::enclosing(vertices)?;
        let parts = part_boxes(|| self.triangles()).into_iter();
        let parts = parts.map(|[lo, hi]| Aabb::from_min_max(lo, hi)).collect();
        Some((whole, parts))
    }

    fn triangles(&self) -> impl Iterator<Item = [Vec3; 3]> {
        let vertex = |index: usize| self.positions.get(index).copied().map(Vec3::from);
        let corner = move |at: usize| match self.indices {
            Indices::U16(indices) => vertex(usize::from(*indices.get(at)?)),
            Indices::U32(indices) => vertex(*indices.get(at)? as usize),
        };
        (0..self.indices.len() / 3).filter_map(move |triangle| {
            let first = 3 * triangle;
            Some([corner(first)?, corner(first + 1)?, corner(first + 2)?])
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
    let MeshBoxes {
        known, changing, ..
    } = &mut *boxes;
    changing.retain(|_, frames| {
        *frames -= 1;
        *frames > 0
    });
    for event in events.read() {
        match event {
            AssetEvent::Modified { id } => {
                // Nothing has been fitted to what was never asked for.
                if known.remove(id).is_some() || changing.contains_key(id) {
                    changing.insert(*id, SHRINK_DELAY);
                }
            }
            AssetEvent::Removed { id } | AssetEvent::Added { id } => {
                known.remove(id);
                changing.remove(id);
            }
            AssetEvent::Unused { .. } | AssetEvent::LoadedWithDependencies { .. } => {}
        }
    }
}
