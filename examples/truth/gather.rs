//! The triangles that the GPU draws, in world space: transforms, skinning, cull modes and alpha
//! masks included. Not included: morph targets, texture transforms, samplers other than the
//! default, vertex colors' alpha, and render layers.

use bevy::{
    light::{NotShadowCaster, NotShadowReceiver},
    mesh::{
        MeshVertexAttribute, VertexAttributeValues,
        skinning::{SkinnedMesh, SkinnedMeshInverseBindposes},
    },
    prelude::*,
    render::render_resource::Face,
};

/// Everything there is to be hit by rays.
#[derive(Default)]
pub struct Geometry {
    /// Corners in world space (meters), counter-clockwise seen from the front.
    pub triangles: Vec<[Vec3; 3]>,
    /// The corners' normals in world space, of any length; none of skinned meshes.
    pub normals: Vec<[Vec3; 3]>,
    /// By triangle: index of its surface.
    pub surface_of: Vec<u32>,
    /// What the triangles are made of.
    pub surfaces: Vec<Surface>,
}

/// One entity's material, as far as visibility goes.
pub struct Surface {
    /// Whether it casts shadows.
    pub casts: bool,
    /// Whether it shows the sun's light and shadows.
    pub receives: bool,
    /// Which side is not drawn.
    pub culled: Option<Face>,
    /// Where it is cut out.
    mask: Option<Mask>,
}

/// A cut-out: where alpha is below the cutoff, nothing is drawn.
struct Mask {
    cutoff: f32,
    alpha: f32,
    texture: Option<Image>,
    first_triangle: u32,
    uvs: Vec<[Vec2; 3]>,
}

impl Mask {
    fn is_solid(&self, triangle: u32, weights: Vec2) -> bool {
        let texel = self.texture.as_ref().map_or(1.0, |image| {
            let Some([a, b, c]) = self.uvs.get((triangle - self.first_triangle) as usize) else {
                return 1.0;
            };
            bilinear_alpha(image, *a + (*b - *a) * weights.x + (*c - *a) * weights.y)
        });
        texel * self.alpha >= self.cutoff
    }
}

/// As the GPU's default sampler: linear, clamped to the edge.
fn bilinear_alpha(image: &Image, uv: Vec2) -> f32 {
    let at = uv * image.size().as_vec2() - 0.5;
    let (low, share) = (at.floor(), at - at.floor());
    let alpha = |x: f32, y: f32| {
        let last = image.size().as_vec2() - 1.0;
        let texel = Vec2::new(x, y).clamp(Vec2::ZERO, last).as_uvec2();
        let color = image.get_color_at(texel.x, texel.y);
        color.map_or(1.0, |color| color.alpha())
    };
    let row = |y: f32| alpha(low.x, y).lerp(alpha(low.x + 1.0, y), share.x);
    row(low.y).lerp(row(low.y + 1.0), share.y)
}

impl Surface {
    /// A solid, one-sided surface that casts and shows shadows.
    pub fn plain() -> Self {
        Self {
            casts: true,
            receives: true,
            culled: Some(Face::Back),
            mask: None,
        }
    }
}

impl Geometry {
    /// Gathers what is in a world. Entities that are hidden are left out; those without a
    /// `StandardMaterial` too.
    pub fn gather(world: &mut World) -> Self {
        let mut geometry = Self::default();
        for entity in Self::entities(world) {
            geometry.push(world, entity);
        }
        geometry
    }

    /// All that may be gathered.
    pub fn entities(world: &mut World) -> Vec<Entity> {
        type Drawn = (With<Mesh3d>, With<MeshMaterial3d<StandardMaterial>>);
        let mut entities = world.query_filtered::<Entity, Drawn>();
        entities.iter(world).collect()
    }

    /// Adds one of them. What has not loaded is left out.
    pub fn push(&mut self, world: &World, entity: Entity) {
        let Ok(entity) = world.get_entity(entity) else {
            return;
        };
        let (Some(mesh), Some(material), Some(transform), Some(visible)) = (
            entity.get::<Mesh3d>(),
            entity.get::<MeshMaterial3d<StandardMaterial>>(),
            entity.get::<GlobalTransform>(),
            entity.get::<InheritedVisibility>(),
        ) else {
            return;
        };
        let (meshes, materials) = (
            world.resource::<Assets<Mesh>>(),
            world.resource::<Assets<StandardMaterial>>(),
        );
        let (Some(mesh), Some(material)) = (meshes.get(&mesh.0), materials.get(&material.0)) else {
            return;
        };
        let positions = float3(mesh, Mesh::ATTRIBUTE_POSITION);
        let (Some(positions), true) = (positions, visible.get()) else {
            return;
        };
        let skin = entity.get::<SkinnedMesh>();
        let joints = skin.and_then(|skin| joint_matrices(world, skin));
        let place = |vertex: usize| match joints.as_ref().and_then(|j| skinned(mesh, j, vertex)) {
            Some(matrix) => matrix.transform_point3(positions[vertex]),
            None => transform.transform_point(positions[vertex]),
        };
        let places: Vec<Vec3> = (0..positions.len()).map(place).collect();
        let normal_matrix = transform.affine().matrix3.inverse().transpose();
        let normals: Vec<Vec3> = match float3(mesh, Mesh::ATTRIBUTE_NORMAL) {
            Some(normals) if joints.is_none() => normals
                .into_iter()
                .map(|normal| normal_matrix * normal)
                .collect(),
            _ => vec![Vec3::ZERO; positions.len()],
        };
        let corners: Vec<usize> = match mesh.indices() {
            Some(indices) => indices.iter().collect(),
            None => (0..positions.len()).collect(),
        };
        let mask = mask_of(material, world.resource()).map(|(cutoff, texture)| Mask {
            cutoff,
            alpha: material.base_color.alpha(),
            texture,
            first_triangle: self.triangles.len() as u32,
            uvs: uvs(mesh, &corners),
        });
        let surface = self.surfaces.len() as u32;
        self.surfaces.push(Surface {
            casts: !entity.contains::<NotShadowCaster>(),
            receives: !entity.contains::<NotShadowReceiver>() && !material.unlit,
            culled: material.cull_mode,
            mask,
        });
        for [a, b, c] in corners.as_chunks().0 {
            self.triangles.push([places[*a], places[*b], places[*c]]);
            self.normals.push([normals[*a], normals[*b], normals[*c]]);
            self.surface_of.push(surface);
        }
    }

    /// A triangle's surface.
    pub fn surface(&self, triangle: u32) -> &Surface {
        &self.surfaces[self.surface_of[triangle as usize] as usize]
    }

    /// Whether the surface is there at a triangle's barycentric point (weights of the second and
    /// third corner).
    pub fn is_solid(&self, triangle: u32, weights: Vec2) -> bool {
        let mask = &self.surface(triangle).mask;
        mask.as_ref()
            .is_none_or(|mask| mask.is_solid(triangle, weights))
    }
}

fn float3(mesh: &Mesh, attribute: MeshVertexAttribute) -> Option<Vec<Vec3>> {
    match mesh.attribute(attribute)? {
        VertexAttributeValues::Float32x3(list) => {
            Some(list.iter().map(|p| Vec3::from_array(*p)).collect())
        }
        _ => None,
    }
}

fn uvs(mesh: &Mesh, corners: &[usize]) -> Vec<[Vec2; 3]> {
    match mesh.attribute(Mesh::ATTRIBUTE_UV_0) {
        Some(VertexAttributeValues::Float32x2(list)) => {
            let triangles = corners.as_chunks::<3>().0.iter();
            triangles
                .map(|triangle| triangle.map(|vertex| Vec2::from_array(list[vertex])))
                .collect()
        }
        _ => Vec::new(),
    }
}

/// Cutoff and texture. Blended surfaces cast and show shadows where they are not next to
/// invisible, as in Bevy's prepass.
fn mask_of(material: &StandardMaterial, images: &Assets<Image>) -> Option<(f32, Option<Image>)> {
    const BLEND_CUTOFF: f32 = 0.05;
    let cutoff = match material.alpha_mode {
        AlphaMode::Mask(cutoff) => cutoff,
        AlphaMode::Opaque => return None,
        _ => BLEND_CUTOFF,
    };
    let texture = material.base_color_texture.as_ref();
    Some((cutoff, texture.and_then(|image| images.get(image)).cloned()))
}

fn joint_matrices(world: &World, skin: &SkinnedMesh) -> Option<Vec<Mat4>> {
    let poses = world
        .resource::<Assets<SkinnedMeshInverseBindposes>>()
        .get(&skin.inverse_bindposes)?;
    let joints = skin.joints.iter().zip(poses.iter());
    joints
        .map(|(joint, pose)| Some(world.get::<GlobalTransform>(*joint)?.to_matrix() * *pose))
        .collect()
}

/// The blend of joints that moves a vertex.
fn skinned(mesh: &Mesh, joints: &[Mat4], vertex: usize) -> Option<Mat4> {
    let VertexAttributeValues::Uint16x4(indices) = mesh.attribute(Mesh::ATTRIBUTE_JOINT_INDEX)?
    else {
        return None;
    };
    let VertexAttributeValues::Float32x4(weights) = mesh.attribute(Mesh::ATTRIBUTE_JOINT_WEIGHT)?
    else {
        return None;
    };
    let influences = indices[vertex].iter().zip(&weights[vertex]);
    Some(
        influences
            .map(|(joint, weight)| joints[usize::from(*joint)] * *weight)
            .fold(Mat4::ZERO, |sum, part| sum + part),
    )
}
