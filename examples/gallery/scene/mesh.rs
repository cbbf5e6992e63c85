//! Building blocks: closed bodies with colours, joined into one mesh.

use bevy::{
    asset::RenderAssetUsages,
    mesh::{Indices, PrimitiveTopology},
    platform::collections::HashMap,
    prelude::*,
};

/// A mesh in the making.
#[derive(Default, Clone)]
pub struct Body {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    colors: Vec<[f32; 4]>,
    indices: Vec<u32>,
}

/// sRGB to what meshes hold.
pub fn linear(color: [f32; 3]) -> [f32; 4] {
    Color::srgb_from_array(color).to_linear().to_f32_array()
}

/// A colour, lighter (above 1) or darker.
pub fn shade(color: [f32; 3], factor: f32) -> [f32; 3] {
    color.map(|channel| (channel * factor).clamp(0.0, 1.0))
}

impl Body {
    pub fn triangles(&self) -> usize {
        self.indices.len() / 3
    }

    pub fn push_vertex(&mut self, position: Vec3, normal: Vec3, color: [f32; 4]) -> u32 {
        self.positions.push(position);
        self.normals.push(normal);
        self.colors.push(color);
        self.positions.len() as u32 - 1
    }

    pub fn push_quad(&mut self, a: u32, b: u32, c: u32, d: u32) {
        self.indices.extend([a, b, c, a, c, d]);
    }

    pub fn push_triangle(&mut self, a: u32, b: u32, c: u32) {
        self.indices.extend([a, b, c]);
    }

    /// Adds another body, moved.
    pub fn add(&mut self, other: &Self, at: Transform) -> &mut Self {
        let base = self.positions.len() as u32;
        let normal_matrix = Mat3::from_quat(at.rotation)
            * Mat3::from_diagonal(at.scale.recip());
        self.positions.extend(other.positions.iter().map(|p| at.transform_point(*p)));
        self.normals
            .extend(other.normals.iter().map(|n| (normal_matrix * *n).normalize_or_zero()));
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
        self.normals = self.positions.iter().map(|p| normal(p).unwrap_or(Vec3::Y)).collect();
        self
    }

    /// The same in colours by place (sRGB).
    pub fn tinted(mut self, tint: impl Fn(Vec3) -> [f32; 3]) -> Self {
        self.colors = self.positions.iter().map(|p| linear(tint(*p))).collect();
        self
    }

    pub fn build(self) -> Mesh {
        Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default())
            .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, self.positions)
            .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, self.normals)
            .with_inserted_attribute(Mesh::ATTRIBUTE_COLOR, self.colors)
            .with_inserted_indices(Indices::U32(self.indices))
    }
}

/// A body of revolution about y. `profile` runs upwards as (radius, height); a point given
/// twice is a sharp edge. Ends with a radius are closed by discs.
pub fn lathe(profile: &[(f32, f32)], segments: u32, color: [f32; 3]) -> Body {
    let color = linear(color);
    let segments = segments.max(3);
    let mut body = Body::default();
    let ring = |body: &mut Body, (r, y): (f32, f32), slope: Vec2| -> u32 {
        let first = body.positions.len() as u32;
        for i in 0..=segments {
            let (sin, cos) = (core::f32::consts::TAU * i as f32 / segments as f32).sin_cos();
            let normal = Vec3::new(cos * slope.x, slope.y, sin * slope.x);
            body.push_vertex(Vec3::new(r * cos, y, r * sin), normal, color);
        }
        first
    };
    let slope_of = |a: (f32, f32), b: (f32, f32)| {
        Vec2::new(b.1 - a.1, a.0 - b.0).try_normalize()
    };
    let slopes: Vec<Option<Vec2>> = profile.windows(2).map(|p| slope_of(p[0], p[1])).collect();
    let mut previous: Option<u32> = None;
    for (i, point) in profile.iter().enumerate() {
        let before = i.checked_sub(1).and_then(|i| slopes[i]);
        let after = slopes.get(i).copied().flatten();
        let slope = (before.unwrap_or_default() + after.unwrap_or_default())
            .try_normalize()
            .unwrap_or(Vec2::X);
        let current = ring(&mut body, *point, slope);
        if let (Some(previous), Some(_)) = (previous, before) {
            for s in 0..segments {
                let (a, b) = (previous + s, current + s);
                if profile[i - 1].0 > 0.0 {
                    body.push_triangle(a, b + 1, a + 1);
                }
                if point.0 > 0.0 {
                    body.push_triangle(a, b, b + 1);
                }
            }
        }
        previous = Some(current);
    }
    for (end, up) in [(profile.first(), false), (profile.last(), true)] {
        let Some(&(r, y)) = end else {
            continue;
        };
        if r <= 0.0 {
            continue;
        }
        let normal = if up { Vec3::Y } else { Vec3::NEG_Y };
        let rim = ring(&mut body, (r, y), Vec2::new(0.0, normal.y));
        let centre = body.push_vertex(Vec3::Y * y, normal, color);
        for s in 0..segments {
            let (a, b) = (rim + s, rim + s + 1);
            if up {
                body.push_triangle(centre, b, a);
            } else {
                body.push_triangle(centre, a, b);
            }
        }
    }
    body
}

/// A ball of radius one.
pub fn ball(segments: u32, color: [f32; 3]) -> Body {
    let rings = (segments / 2).max(3);
    let profile: Vec<(f32, f32)> = (0..=rings)
        .map(|i| {
            let angle = core::f32::consts::PI * (i as f32 / rings as f32 - 0.5);
            let end = i == 0 || i == rings;
            (if end { 0.0 } else { angle.cos() }, angle.sin())
        })
        .collect();
    lathe(&profile, segments, color)
}

/// A box with bevelled edges: 44 triangles.
pub fn block(size: Vec3, bevel: f32, color: [f32; 3]) -> Body {
    let (h, color) = (size * 0.5, linear(color));
    let inner = h - Vec3::splat(bevel.min(h.min_element() * 0.9));
    let mut body = Body::default();
    let corners: Vec<Vec3> = (0..8)
        .map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 2.0 - 1.0)
        .collect();
    let on_face = |corner: Vec3, axis: usize| {
        let mut p = corner * inner;
        p[axis] = corner[axis] * h[axis];
        p
    };
    let mut face = |points: &[Vec3]| {
        let mut centre: Vec3 = points.iter().sum();
        centre /= points.len() as f32;
        let mut normal = (points[1] - points[0]).cross(points[2] - points[0]).normalize_or_zero();
        let flipped = normal.dot(centre) < 0.0;
        if flipped {
            normal = -normal;
        }
        let v: Vec<u32> = points.iter().map(|p| body.push_vertex(*p, normal, color)).collect();
        for i in 1..v.len() - 1 {
            if flipped {
                body.push_triangle(v[0], v[i + 1], v[i]);
            } else {
                body.push_triangle(v[0], v[i], v[i + 1]);
            }
        }
    };
    for axis in 0..3 {
        let (u, w) = ((axis + 1) % 3, (axis + 2) % 3);
        for side in [-1.0, 1.0] {
            let at = |a: f32, b: f32| {
                let mut c = Vec3::splat(side);
                c[u] = a;
                c[w] = b;
                c
            };
            let quad = [at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)];
            face(&quad.map(|c| on_face(c, axis)));
            // The bevels of the edges along `axis`, at all four corners of (u, w).
            for other in [-1.0, 1.0] {
                let mut a = Vec3::NEG_ONE;
                a[u] = side;
                a[w] = other;
                let mut b = a;
                b[axis] = 1.0;
                face(&[on_face(a, u), on_face(b, u), on_face(b, w), on_face(a, w)]);
            }
        }
    }
    for corner in corners {
        face(&[on_face(corner, 0), on_face(corner, 1), on_face(corner, 2)]);
    }
    body
}

/// A round rod from `a` to `b`, tapered, with rounded ends.
pub fn rod(a: Vec3, b: Vec3, radii: [f32; 2], segments: u32, color: [f32; 3]) -> Body {
    let length = a.distance(b).max(1e-4);
    let [r0, r1] = radii;
    let round = 0.5_f32.min(length / (r0 + r1).max(1e-4) * 0.5);
    let profile = [
        (0.0, -r0 * round),
        (r0 * 0.7, -r0 * round * 0.7),
        (r0, 0.0),
        (r0 + (r1 - r0) * 0.33, length * 0.33),
        (r0 + (r1 - r0) * 0.67, length * 0.67),
        (r1, length),
        (r1 * 0.7, length + r1 * round * 0.7),
        (0.0, length + r1 * round),
    ];
    let mut body = Body::default();
    let turn = Quat::from_rotation_arc(Vec3::Y, (b - a) / length);
    body.add(
        &lathe(&profile, segments, color),
        Transform::from_translation(a).with_rotation(turn),
    );
    body
}
