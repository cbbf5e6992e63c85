//! Meshes in the making: positions, normals and colors, joined from simple shapes.

use bevy::{
    asset::RenderAssetUsages,
    mesh::{Indices, PrimitiveTopology},
    platform::collections::HashMap,
    prelude::*,
};

/// A mesh in the making.
#[derive(Default, Clone)]
pub struct Body {
    pub(super) positions: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) colors: Vec<[f32; 4]>,
    pub(super) indices: Vec<u32>,
}

/// sRGB to what meshes hold.
pub fn linear(color: [f32; 3]) -> [f32; 4] {
    Color::srgb_from_array(color).to_linear().to_f32_array()
}

/// A color, lighter (above 1) or darker.
pub fn shade(color: [f32; 3], factor: f32) -> [f32; 3] {
    color.map(|channel| (channel * factor).clamp(0.0, 1.0))
}

impl Body {
    /// How many triangles there are.
    pub fn triangles(&self) -> usize {
        self.indices.len() / 3
    }

    /// How many vertices there are.
    pub fn vertices(&self) -> u32 {
        self.positions.len() as u32
    }

    /// Adds a vertex in a linear color and tells its index.
    pub fn push_vertex(&mut self, position: Vec3, normal: Vec3, color: [f32; 4]) -> u32 {
        self.positions.push(position);
        self.normals.push(normal);
        self.colors.push(color);
        self.positions.len() as u32 - 1
    }

    /// Adds a quad, counter-clockwise seen from outside.
    pub fn push_quad(&mut self, a: u32, b: u32, c: u32, d: u32) {
        self.indices.extend([a, b, c, a, c, d]);
    }

    /// Adds a triangle, counter-clockwise seen from outside.
    pub fn push_triangle(&mut self, a: u32, b: u32, c: u32) {
        self.indices.extend([a, b, c]);
    }

    /// Adds another body, moved.
    pub fn add(&mut self, other: &Self, at: Transform) -> &mut Self {
        let base = self.positions.len() as u32;
        let normal_matrix = Mat3::from_quat(at.rotation) * Mat3::from_diagonal(at.scale.recip());
        self.positions
            .extend(other.positions.iter().map(|p| at.transform_point(*p)));
        self.normals.extend(
            other
                .normals
                .iter()
                .map(|n| (normal_matrix * *n).normalize_or_zero()),
        );
        self.colors.extend(&other.colors);
        self.indices.extend(other.indices.iter().map(|i| i + base));
        self
    }

    /// The same with every point moved by `bend` and normals worked out anew, smoothly.
    pub fn bent(mut self, bend: impl Fn(Vec3) -> Vec3) -> Self {
        for position in &mut self.positions {
            *position = bend(*position);
        }
        // By place, not by vertex: seams have two vertices in one place.
        let place = |p: Vec3| (p * 1e4).round().as_ivec3();
        let mut sums: HashMap<IVec3, Vec3> = HashMap::default();
        for t in self.indices.chunks_exact(3) {
            let [a, b, c] = [t[0], t[1], t[2]].map(|i| self.positions[i as usize]);
            for corner in [a, b, c] {
                *sums.entry(place(corner)).or_default() += (b - a).cross(c - a);
            }
        }
        let normal = |p: &Vec3| sums.get(&place(*p)).and_then(|n| n.try_normalize());
        self.normals = self
            .positions
            .iter()
            .map(|p| normal(p).unwrap_or(Vec3::Y))
            .collect();
        self
    }

    /// The same with every point moved by `carve`, keeping its edges sharp where it has any.
    pub fn carved(mut self, carve: impl Fn(Vec3) -> Vec3) -> Self {
        for position in &mut self.positions {
            *position = carve(*position);
        }
        let mut sums = vec![Vec3::ZERO; self.positions.len()];
        for t in self.indices.chunks_exact(3) {
            let [a, b, c] = [t[0], t[1], t[2]].map(|i| self.positions[i as usize]);
            for i in t {
                sums[*i as usize] += (b - a).cross(c - a);
            }
        }
        self.normals = sums.iter().map(|n| n.normalize_or(Vec3::Y)).collect();
        self
    }

    /// The same elsewhere.
    pub fn moved(mut self, by: Vec3) -> Self {
        for position in &mut self.positions {
            *position += by;
        }
        self
    }

    /// The same in colors by place (sRGB).
    pub fn tinted(mut self, tint: impl Fn(Vec3) -> [f32; 3]) -> Self {
        self.colors = self.positions.iter().map(|p| linear(tint(*p))).collect();
        self
    }

    /// The same, darker on the sides that see less of the sky.
    pub fn sheltered(mut self) -> Self {
        for (color, normal) in self.colors.iter_mut().zip(&self.normals) {
            let open = 0.84 + 0.16 * normal.y;
            for channel in &mut color[..3] {
                *channel *= open;
            }
        }
        self
    }

    /// A ground's mesh: as [`Body::build`], with a texture laid on from above, `tile` meters wide.
    pub fn build_ground(self, tile: f32) -> Mesh {
        let uvs: Vec<[f32; 2]> = self
            .positions
            .iter()
            .map(|p| [p.x / tile, p.z / tile])
            .collect();
        self.build()
            .with_inserted_attribute(Mesh::ATTRIBUTE_UV_0, uvs)
    }

    /// The mesh.
    pub fn build(self) -> Mesh {
        Mesh::new(
            PrimitiveTopology::TriangleList,
            RenderAssetUsages::default(),
        )
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, self.positions)
        .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, self.normals)
        .with_inserted_attribute(Mesh::ATTRIBUTE_COLOR, self.colors)
        .with_inserted_indices(Indices::U32(self.indices))
    }
}
