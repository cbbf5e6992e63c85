//! The ground's relief, and its mesh.

use bevy::prelude::*;

use super::{
    format::{GroundDescription, GroundKind},
    mesh::{Body, linear, shade},
    noise::{fractal, noise},
};

/// What everything stands on. Also a resource, for what walks on it.
#[derive(Resource, Debug, Clone)]
pub struct Ground {
    description: GroundDescription,
    seed: u64,
}

impl Ground {
    pub fn new(description: GroundDescription, seed: u64) -> Self {
        Self { description, seed }
    }

    /// Height at (x, z), in metres.
    pub fn height(&self, x: f32, z: f32) -> f32 {
        let seed = self.seed;
        match self.description.kind {
            GroundKind::Plain => 2.5 * fractal(x / 130.0, z / 130.0, seed, 3),
            GroundKind::Board => {
                let half = self.description.size * 0.5;
                let inside = x.abs().max(z.abs());
                // A frame around the fields.
                if inside > 0.93 * half { 2.0 } else { 0.0 }
            }
            GroundKind::Desert => {
                let along = x * 0.8 + z * 0.6 + 40.0 * noise(x / 170.0, z / 170.0, seed);
                let ridge = 1.0 - (2.0 * (along / 95.0).rem_euclid(1.0) - 1.0).abs();
                let dunes = 5.0 * ridge * ridge * (0.6 + 0.4 * noise(x / 230.0, z / 230.0, seed + 3));
                dunes + 0.12 * (along * 1.1).sin() + 7.0 * fractal(x / 420.0, z / 420.0, seed + 7, 3)
            }
            GroundKind::Pit => {
                let distance = (x * x + z * z).sqrt() + 30.0 * noise(x / 90.0, z / 90.0, seed);
                let depth = ((460.0 - distance) / 340.0).clamp(0.0, 1.0) * 88.0;
                // Terraces: flat for most of each step, then a slope.
                let step = depth / 11.0;
                let terraced = 11.0 * (step.floor() + ((step.fract() - 0.72) / 0.28).clamp(0.0, 1.0));
                let rim = ((distance - 430.0) / 400.0).clamp(0.0, 1.0);
                let mountains = rim * rim * 150.0 * (0.55 + fractal(x / 260.0, z / 260.0, seed + 1, 6)).abs();
                mountains - terraced + 1.6 * fractal(x / 24.0, z / 24.0, seed + 2, 4)
            }
        }
    }

    fn color(&self, x: f32, z: f32, slope: f32) -> [f32; 4] {
        let [main, second] = self.description.colors;
        let mix = |t: f32| -> [f32; 3] {
            core::array::from_fn(|i| main[i] + (second[i] - main[i]) * t.clamp(0.0, 1.0))
        };
        let grain = 1.0 + 0.1 * fractal(x / 7.0, z / 7.0, self.seed + 5, 3);
        let color = match self.description.kind {
            GroundKind::Board => {
                let half = self.description.size * 0.5;
                let field = |v: f32| ((v / (0.93 * half) + 1.0) * 4.0).floor() as i32;
                if x.abs().max(z.abs()) > 0.925 * half {
                    [0.32, 0.2, 0.12]
                } else if (field(x) + field(z)) % 2 == 0 {
                    main
                } else {
                    second
                }
            }
            GroundKind::Plain | GroundKind::Desert => {
                mix(0.5 + 0.9 * fractal(x / 60.0, z / 60.0, self.seed + 4, 4))
            }
            GroundKind::Pit => mix(3.2 * slope + 0.4 * fractal(x / 40.0, z / 40.0, self.seed + 4, 4)),
        };
        linear(shade(color, grain))
    }

    /// The grid, cut into square tiles so that what is out of sight need not be drawn.
    pub fn tiles(&self) -> Vec<Body> {
        let GroundDescription { size, cells, .. } = self.description;
        let per_tile = cells.div_ceil(TILES);
        (0..TILES * TILES)
            .map(|tile| {
                let first = |t: u32| (t * per_tile).min(cells);
                let (i0, j0) = (first(tile % TILES), first(tile / TILES));
                let (i1, j1) = (first(tile % TILES + 1), first(tile / TILES + 1));
                self.tile(size / cells as f32, [i0, i1], [j0, j1])
            })
            .filter(|tile| tile.triangles() > 0)
            .collect()
    }

    fn tile(&self, step: f32, [i0, i1]: [u32; 2], [j0, j1]: [u32; 2]) -> Body {
        let half = self.description.size * 0.5;
        let mut body = Body::default();
        if i0 == i1 || j0 == j1 {
            return body;
        }
        for j in j0..=j1 {
            for i in i0..=i1 {
                let (x, z) = (i as f32 * step - half, j as f32 * step - half);
                let h = |dx: f32, dz: f32| self.height(x + dx, z + dz);
                let e = 0.5 * step;
                let normal =
                    Vec3::new(h(-e, 0.0) - h(e, 0.0), 2.0 * e, h(0.0, -e) - h(0.0, e)).normalize();
                body.push_vertex(
                    Vec3::new(x, h(0.0, 0.0), z),
                    normal,
                    self.color(x + 0.01 * step, z + 0.01 * step, 1.0 - normal.y),
                );
            }
        }
        let row = i1 - i0 + 1;
        for j in 0..j1 - j0 {
            for i in 0..i1 - i0 {
                let a = j * row + i;
                body.push_quad(a, a + row, a + row + 1, a + 1);
            }
        }
        body
    }
}

/// Tiles along a side.
const TILES: u32 = 8;
