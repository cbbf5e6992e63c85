//! The chessboard: eight by eight fields in a moulded frame.

use bevy::prelude::*;

use super::{
    mesh::{Body, linear, shade},
    noise::fractal,
};

/// Width of the frame, as a part of the whole board's.
const FRAME: f32 = 30.0 / 700.0;
const WOOD: [f32; 3] = [0.34, 0.19, 0.11];

/// The frame's section: outwards from the fields, and height (meters).
const MOULDING: [(f32, f32); 11] = [
    (0.0, 0.0),
    (0.0, 1.4),
    (1.2, 2.4),
    (4.0, 2.4),
    (4.8, 1.7),
    (7.0, 1.7),
    (7.8, 2.4),
    (25.5, 2.4),
    (29.0, 0.4),
    (30.0, -2.0),
    (30.0, -9.0),
];

/// Height of the board at (x, z).
pub fn height(size: f32, x: f32, z: f32) -> f32 {
    let out = x.abs().max(z.abs()) - size * (0.5 - FRAME);
    if out < 0.0 {
        return 0.0;
    }
    MOULDING
        .windows(2)
        .find(|pair| out <= pair[1].0)
        .map_or(-9.0, |pair| pair[0].1.max(pair[1].1))
}

/// The board's meshes: sixteen pieces of the field, and the frame.
pub fn tiles(size: f32, cells: u32, colors: [[f32; 3]; 2], seed: u64) -> Vec<Body> {
    let inner = size * (0.5 - FRAME);
    let per_field = (cells / 8).max(1);
    let mut tiles: Vec<Body> = (0..16)
        .map(|tile| {
            let mut body = Body::default();
            for field in 0..4 {
                let (i, j) = (2 * (tile % 4) + field % 2, 2 * (tile / 4) + field / 2);
                add_field(
                    &mut body,
                    inner,
                    per_field,
                    [i, j],
                    colors[((i + j) % 2) as usize],
                    seed,
                );
            }
            body
        })
        .collect();
    tiles.push(frame(inner, per_field * 4, seed));
    tiles
}

fn add_field(
    body: &mut Body,
    inner: f32,
    cells: u32,
    [i, j]: [u32; 2],
    color: [f32; 3],
    seed: u64,
) {
    let side = inner / 4.0;
    let corner = Vec2::new(i as f32, j as f32) * side - inner;
    let first = body.vertices();
    for b in 0..=cells {
        for a in 0..=cells {
            let place = corner + Vec2::new(a as f32, b as f32) * side / cells as f32;
            // Veins, running differently in every field.
            let turned = Vec2::from_angle((i * 5 + j * 3) as f32).rotate(place);
            let vein = fractal(
                turned.x / 46.0,
                turned.y / 12.0,
                seed + u64::from(i * 8 + j),
                3,
            );
            let tone = shade(color, 1.0 + 0.13 * vein);
            body.push_vertex(Vec3::new(place.x, 0.0, place.y), Vec3::Y, linear(tone));
        }
    }
    let row = cells + 1;
    for b in 0..cells {
        for a in 0..cells {
            let k = first + b * row + a;
            body.push_quad(k, k + row, k + row + 1, k + 1);
        }
    }
}

fn frame(inner: f32, cells: u32, seed: u64) -> Body {
    let mut body = Body::default();
    for side in 0..4 {
        let turn = Quat::from_rotation_y(core::f32::consts::FRAC_PI_2 * side as f32);
        for pair in MOULDING.windows(2) {
            let (low, high) = (pair[0], pair[1]);
            let normal =
                turn * Vec3::new(0.0, high.0 - low.0, low.1 - high.1).normalize_or(Vec3::Y);
            let first = body.vertices();
            for (out, y) in [low, high] {
                let reach = inner + out;
                for k in 0..=cells {
                    let along = (2.0 * k as f32 / cells as f32 - 1.0) * reach;
                    let tone = 1.0 + 0.2 * fractal(along / 60.0, out / 2.0, seed + side as u64, 4);
                    let place = turn * Vec3::new(along, y, reach);
                    body.push_vertex(place, normal, linear(shade(WOOD, tone)));
                }
            }
            let row = cells + 1;
            for k in first..first + cells {
                body.push_quad(k, k + row, k + row + 1, k + 1);
            }
        }
    }
    let (reach, depth) = (inner + MOULDING[10].0, MOULDING[10].1);
    let v = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, z)| {
        body.push_vertex(
            Vec3::new(x * reach, depth, z * reach),
            Vec3::NEG_Y,
            linear(WOOD),
        )
    });
    body.push_quad(v[0], v[1], v[2], v[3]);
    body
}
