//! Simple shapes, closed and facing outwards.

use bevy::prelude::*;

use super::mesh::{Body, linear};

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
    let slope_of = |a: (f32, f32), b: (f32, f32)| Vec2::new(b.1 - a.1, a.0 - b.0).try_normalize();
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
        let center = body.push_vertex(Vec3::Y * y, normal, color);
        for s in 0..segments {
            let (a, b) = (rim + s, rim + s + 1);
            if up {
                body.push_triangle(center, b, a);
            } else {
                body.push_triangle(center, a, b);
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
        let mut center: Vec3 = points.iter().sum();
        center /= points.len() as f32;
        let mut normal = (points[1] - points[0])
            .cross(points[2] - points[0])
            .normalize_or_zero();
        let flipped = normal.dot(center) < 0.0;
        if flipped {
            normal = -normal;
        }
        let v: Vec<u32> = points
            .iter()
            .map(|p| body.push_vertex(*p, normal, color))
            .collect();
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

/// A plain box: 12 triangles.
pub fn crate_box(size: Vec3, color: [f32; 3]) -> Body {
    let (h, color) = (size * 0.5, linear(color));
    let mut body = Body::default();
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let mut normal = Vec3::ZERO;
            normal[axis] = side;
            let (u, w) = ((axis + 1) % 3, (axis + 2) % 3);
            let v = [(-1.0, -1.0), (side, -side), (1.0, 1.0), (-side, side)].map(|(a, b)| {
                let mut p = normal * h;
                p[u] = a * h[u];
                p[w] = b * h[w];
                body.push_vertex(p, normal, color)
            });
            body.push_quad(v[0], v[1], v[2], v[3]);
        }
    }
    body
}

/// A straight tapered bar from `a` to `b` with flat ends.
pub fn strut(a: Vec3, b: Vec3, radii: [f32; 2], segments: u32, color: [f32; 3]) -> Body {
    let length = a.distance(b).max(1e-4);
    let mut body = Body::default();
    let turn = Quat::from_rotation_arc(Vec3::Y, (b - a) / length);
    body.add(
        &lathe(&[(radii[0], 0.0), (radii[1], length)], segments, color),
        Transform::from_translation(a).with_rotation(turn),
    );
    body
}

/// A bent bar through `points` (place, half widths across and along `side`), with flat ends.
pub fn tube(points: &[(Vec3, Vec2)], side: Vec3, segments: u32, color: [f32; 3]) -> Body {
    let color = linear(color);
    let segments = segments.max(3);
    let mut body = Body::default();
    let last = points.len().saturating_sub(1);
    let mut rings: Vec<u32> = Vec::new();
    for (i, (center, half)) in points.iter().enumerate() {
        let along = points[(i + 1).min(last)].0 - points[i.saturating_sub(1)].0;
        let along = along.normalize_or(Vec3::Y);
        let across = side.cross(along).normalize_or(Vec3::X);
        let side = along.cross(across);
        rings.push(body.positions.len() as u32);
        for s in 0..=segments {
            let (sin, cos) = (core::f32::consts::TAU * s as f32 / segments as f32).sin_cos();
            let normal = across * cos / half.x.max(1e-5) + side * sin / half.y.max(1e-5);
            let place = *center + across * cos * half.x + side * sin * half.y;
            body.push_vertex(place, normal.normalize_or_zero(), color);
        }
    }
    for pair in rings.windows(2) {
        for s in 0..segments {
            let (a, b) = (pair[0] + s, pair[1] + s);
            body.push_quad(a, a + 1, b + 1, b);
        }
    }
    for (ring, end) in [(rings.first(), 0), (rings.last(), last)] {
        let Some(&ring) = ring else {
            continue;
        };
        let out = if end == 0 {
            points[0].0 - points[1.min(last)].0
        } else {
            points[end].0 - points[end - 1].0
        };
        let out = out.normalize_or_zero();
        let center = body.push_vertex(points[end].0, out, color);
        let first = body.positions.len() as u32;
        for s in 0..=segments {
            let place = body.positions[(ring + s) as usize];
            body.push_vertex(place, out, color);
        }
        for s in 0..segments {
            let (a, b) = (first + s, first + s + 1);
            if end == 0 {
                body.push_triangle(center, b, a);
            } else {
                body.push_triangle(center, a, b);
            }
        }
    }
    body
}

/// A sheet of cloth: `shape(u, v)` with both from 0 to 1, closed at its edges, as thick as given.
pub fn sheet(
    cells: [u32; 2],
    thickness: f32,
    color: [f32; 3],
    shape: impl Fn(f32, f32) -> Vec3,
) -> Body {
    let color = linear(color);
    let mut body = Body::default();
    let [nu, nv] = cells.map(|n| n.max(1));
    let row = nu + 1;
    for face in [1.0, -1.0] {
        for j in 0..=nv {
            for i in 0..=nu {
                let (u, v) = (i as f32 / nu as f32, j as f32 / nv as f32);
                let e = 1e-3;
                let du = shape(u + e, v) - shape(u - e, v);
                let dv = shape(u, v + e) - shape(u, v - e);
                let normal = du.cross(dv).normalize_or(Vec3::Y) * face;
                body.push_vertex(shape(u, v) + normal * 0.5 * thickness, normal, color);
            }
        }
    }
    let back = row * (nv + 1);
    for j in 0..nv {
        for i in 0..nu {
            let a = j * row + i;
            body.push_quad(a, a + 1, a + row + 1, a + row);
            body.push_quad(back + a, back + a + row, back + a + row + 1, back + a + 1);
        }
    }
    let mut edge = |a: u32, b: u32| body.indices.extend([a, back + a, back + b, a, back + b, b]);
    for i in 0..nu {
        edge(i, i + 1);
        edge(nv * row + i + 1, nv * row + i);
    }
    for j in 0..nv {
        edge((j + 1) * row, j * row);
        edge(j * row + nu, (j + 1) * row + nu);
    }
    body
}

/// A ball of radius one in near-equal triangles: 20 times `frequency` squared.
pub fn icosphere(frequency: u32, color: [f32; 3]) -> Body {
    let color = linear(color);
    let frequency = frequency.max(1);
    let g = 0.5 * (1.0 + 5.0_f32.sqrt());
    let corners = [
        [-1.0, g, 0.0],
        [1.0, g, 0.0],
        [-1.0, -g, 0.0],
        [1.0, -g, 0.0],
        [0.0, -1.0, g],
        [0.0, 1.0, g],
        [0.0, -1.0, -g],
        [0.0, 1.0, -g],
        [g, 0.0, -1.0],
        [g, 0.0, 1.0],
        [-g, 0.0, -1.0],
        [-g, 0.0, 1.0],
    ]
    .map(Vec3::from_array);
    let faces = [
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    let mut body = Body::default();
    for face in faces {
        let [a, b, c] = face.map(|i: usize| corners[i]);
        let mut rows: Vec<u32> = Vec::new();
        for j in 0..=frequency {
            rows.push(body.positions.len() as u32);
            for i in 0..=frequency - j {
                let (u, v) = (i as f32 / frequency as f32, j as f32 / frequency as f32);
                let p = (a + (b - a) * u + (c - a) * v).normalize_or_zero();
                body.push_vertex(p, p, color);
            }
        }
        for j in 0..frequency {
            for i in 0..frequency - j {
                let (low, high) = (rows[j as usize] + i, rows[j as usize + 1] + i);
                body.push_triangle(low, low + 1, high);
                if i + 1 < frequency - j {
                    body.push_triangle(low + 1, high + 1, high);
                }
            }
        }
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
