//! The parts of large meshes that a camera stands close to.

use bevy::{
    asset::{AssetEvent, AssetId, Assets, RenderAssetUsages},
    camera::primitives::Aabb,
    ecs::{message::MessageReader, resource::Resource, system::ResMut},
    math::{Vec3, Vec3A},
    mesh::{Indices, Mesh, PrimitiveTopology},
    platform::collections::HashMap,
};

use crate::geometry::{hysteresis::SHRINK_DELAY, mesh_boxes::PartBoxes};

/// Smaller meshes are known by their own box (triangles).
const MIN_TRIANGLES: usize = 512;

/// Boxes that differ by less than this, as a share of their size, are the same.
const ROUNDING: f32 = 1e-5;

/// Triangles of larger meshes that are worked through in a frame, a few milliseconds' worth: their parts
/// are known some frames later.
const TRIANGLES_PER_FRAME: usize = 1 << 16;

/// The boxes of meshes' parts, worked out when they are first asked for.
#[derive(Resource, Debug, Default)]
pub struct MeshBoxes {
    known: HashMap<AssetId<Mesh>, Known>,
    /// Meshes that have changed lately, and for how many frames more they have no parts: those that
    /// change with every frame would cost too much.
    changing: HashMap<AssetId<Mesh>, u32>,
    /// Triangles of larger meshes that have been worked through in this frame.
    spent: usize,
    /// Whether a mesh that was asked for will have parts later.
    is_working: bool,
}

#[derive(Debug)]
enum Known {
    /// Of so many triangles, all measured and then all sorted in, at a step.
    Working {
        boxes: PartBoxes,
        of: usize,
        next: usize,
        /// Of what the renderer takes away before it is worked through.
        copy: Option<MeshCopy>,
    },
    /// The whole mesh's box and its parts', or none.
    Done(Option<(Aabb, Vec<Aabb>)>),
}

impl Default for Known {
    fn default() -> Self {
        Self::Working {
            boxes: PartBoxes::default(),
            of: 0,
            next: 0,
            copy: None,
        }
    }
}

impl MeshBoxes {
    /// The boxes of a mesh's parts, in its own space. Empty if the mesh is small, not there, without
    /// indices, changing, moved by joints or targets, if an entity's box is not that of the mesh's
    /// vertices, as something else then moves them, or until the parts are worked out.
    pub fn of(&mut self, id: AssetId<Mesh>, aabb: &Aabb, assets: &Assets<Mesh>) -> &[Aabb] {
        if self.changing.contains_key(&id) {
            self.is_working = true;
            return &[];
        }
        let known = self.known.entry(id).or_default();
        if matches!(known, Known::Working { .. }) {
            let mesh = assets.get(id).and_then(PartedMesh::new);
            known.work(mesh, &mut self.spent);
        }
        self.is_working |= matches!(known, Known::Working { .. });
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
    /// Goes on as far as the frame allows.
    fn work(&mut self, mesh: Option<PartedMesh>, spent: &mut usize) {
        let Self::Working {
            boxes,
            of,
            next,
            copy,
        } = &mut *self
        else {
            return;
        };
        let leaving = mesh.as_ref().filter(|it| it.is_leaving && it.is_large());
        if let (None, Some(mesh)) = (&copy, leaving) {
            *copy = Some(mesh.copy());
        }
        let Some(mesh) = copy.as_ref().map(MeshCopy::parted).or(mesh) else {
            *self = Self::Done(None);
            return;
        };
        let all = mesh.triangles();
        if *of != all {
            // Another mesh by now.
            (*boxes, *of, *next) = (PartBoxes::default(), all, 0);
        }
        // What fits into a frame is never spread over several.
        let steps = if mesh.is_large() {
            let left = TRIANGLES_PER_FRAME.saturating_sub(*spent);
            *spent += left;
            left
        } else {
            2 * all
        };
        let end = (*next + steps).min(2 * all);
        for step in *next..end {
            if step == all {
                boxes.lay_grid();
            }
            match mesh.triangle(step % all) {
                Some(triangle) if step < all => boxes.measure(triangle),
                Some(triangle) => boxes.sort_in(triangle),
                None => {}
            }
        }
        *next = end;
        if end == 2 * all {
            let parts = core::mem::take(boxes).finish().into_iter();
            let parts = parts.map(|[lo, hi]| Aabb::from_min_max(lo, hi)).collect();
            let vertices = mesh.positions.iter().copied().map(Vec3::from);
            *self = Self::Done(Aabb::enclosing(vertices).map(|whole| (whole, parts)));
        }
    }
}

#[derive(Debug)]
struct MeshCopy {
    positions: Vec<[f32; 3]>,
    indices: Indices,
}

impl MeshCopy {
    fn parted(&self) -> PartedMesh<'_> {
        PartedMesh {
            positions: &self.positions,
            indices: &self.indices,
            is_leaving: true,
        }
    }
}

/// A mesh that is worth parts: large, in one piece, a list of triangles.
struct PartedMesh<'a> {
    positions: &'a [[f32; 3]],
    indices: &'a Indices,
    /// Whether the renderer takes its data away.
    is_leaving: bool,
}

impl<'a> PartedMesh<'a> {
    fn new(mesh: &'a Mesh) -> Option<Self> {
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
        is_worth_it.then_some(Self {
            positions,
            indices,
            is_leaving: mesh.asset_usage == RenderAssetUsages::RENDER_WORLD,
        })
    }

    fn copy(&self) -> MeshCopy {
        MeshCopy {
            positions: self.positions.to_vec(),
            indices: self.indices.clone(),
        }
    }

    fn is_large(&self) -> bool {
        self.triangles() > TRIANGLES_PER_FRAME
    }

    fn triangles(&self) -> usize {
        self.indices.len() / 3
    }

    fn triangle(&self, index: usize) -> Option<[Vec3; 3]> {
        let vertex = |corner: usize| {
            let corner = 3 * index + corner;
            let vertex = match self.indices {
                Indices::U16(indices) => usize::from(*indices.get(corner)?),
                Indices::U32(indices) => *indices.get(corner)? as usize,
            };
            self.positions.get(vertex).copied().map(Vec3::from)
        };
        Some([vertex(0)?, vertex(1)?, vertex(2)?])
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
        known,
        changing,
        spent,
        ..
    } = &mut *boxes;
    *spent = 0;
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
