//! The ground's relief, and its meshes.

use bevy::{platform::sync::Arc, prelude::*};

use super::{
    board,
    format::{GroundDescription, GroundKind, HeightsDescription},
    heights::Heights,
    mesh::{Body, linear, shade},
    noise::{fractal, noise, ridged},
};

/// Tiles along a side.
const TILES: u32 = 8;

/// Width and depth of the mine's terraces.
const TERRACE: Vec2 = Vec2::new(42.0, 11.0);

/// What everything stands on. Also a resource, for what walks on it.
#[derive(Resource, Debug, Clone)]
pub struct Ground {
    description: GroundDescription,
    seed: u64,
    heights: Option<Arc<Heights>>,
}

fn smooth(from: f32, to: f32, x: f32) -> f32 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

impl Ground {
    /// A ground as described; flat if its heights cannot be read.
    pub fn new(description: GroundDescription, seed: u64) -> Self {
        let read = |heights: &HeightsDescription| match Heights::read(heights) {
            Ok(heights) => Some(Arc::new(heights)),
            Err(error) => {
                error!("{}: {error}", heights.file);
                None
            }
        };
        Self {
            heights: description.heights.as_ref().and_then(read),
            description,
            seed,
        }
    }

    /// Height at (x, z), in meters.
    pub fn height(&self, x: f32, z: f32) -> f32 {
        let size = self.description.size;
        // 0 in the middle, 1 at the edge: hills there hide that the ground ends.
        let edge = x.abs().max(z.abs()) / (0.5 * size);
        self.description.relief
            * match self.description.kind {
                GroundKind::Plain => self.plain(x, z, edge),
                GroundKind::Board => board::height(size, x, z),
                GroundKind::Desert => self.desert(x, z, edge),
                GroundKind::Pit => self.pit(x, z),
                GroundKind::Measured => self.heights.as_ref().map_or(0.0, |it| it.at(x, z)),
            }
    }

    fn plain(&self, x: f32, z: f32, edge: f32) -> f32 {
        let seed = self.seed;
        let swells = 2.2 * fractal(x / 120.0, z / 120.0, seed, 3);
        let hills =
            smooth(0.55, 1.0, edge) * (16.0 + 34.0 * ridged(x / 210.0, z / 210.0, seed + 1, 4));
        swells + hills
    }

    fn desert(&self, x: f32, z: f32, edge: f32) -> f32 {
        let seed = self.seed;
        let along = x * 0.8 + z * 0.6 + 46.0 * fractal(x / 170.0, z / 170.0, seed, 2);
        // Gentle to windward, steep to leeward.
        let phase = (along / 105.0).rem_euclid(1.0);
        let crest = if phase < 0.72 {
            smooth(0.0, 0.72, phase)
        } else {
            smooth(1.0, 0.72, phase)
        };
        let tall = 0.45 + 0.55 * fractal(x / 230.0, z / 230.0, seed + 3, 2).abs();
        let ripples = 0.1 * (along * 1.15 + 2.0 * noise(x / 9.0, z / 9.0, seed + 4)).sin();
        let calm = smooth(0.05, 0.3, edge);
        let rim =
            smooth(0.6, 1.0, edge) * 22.0 * (0.6 + noise(x / 190.0, z / 190.0, seed + 8)).max(0.0);
        crest * tall * (3.0 + 9.0 * calm)
            + ripples
            + 6.0 * fractal(x / 420.0, z / 420.0, seed + 7, 3)
            + rim
    }

    /// An open pit within a high plain, mountains around it. Terraces wind down as one spiral,
    /// so that there is a road to the floor.
    fn pit(&self, x: f32, z: f32) -> f32 {
        let seed = self.seed;
        let distance = x.hypot(z) * (1.0 + 0.16 * noise(x / 260.0, z / 260.0, seed + 11))
            + 7.0 * fractal(x / 60.0, z / 60.0, seed, 3);
        let turns = z.atan2(x) / core::f32::consts::TAU;
        let floor_radius = 120.0;
        let steps = 8.0;
        let level = ((floor_radius + steps * TERRACE.x - distance) / TERRACE.x).min(steps);
        let spiral = level + turns;
        let terraced = spiral.floor() + smooth(0.66, 0.97, spiral.rem_euclid(1.0)) - turns;
        let inside = smooth(-0.6, 0.6, level);
        let floor = smooth(steps - 0.5, steps, level);
        let depth =
            inside * (terraced.clamp(0.0, steps) * (1.0 - floor) + steps * floor) * TERRACE.y;
        let rim = smooth(470.0, 800.0, distance);
        let mountains = rim * (20.0 + 150.0 * ridged(x / 330.0, z / 330.0, seed + 1, 6));
        let rough = 0.5 + 1.4 * smooth(-0.5, -3.0, level);
        mountains - depth + rough * fractal(x / 26.0, z / 26.0, seed + 2, 5)
    }

    fn color(&self, x: f32, y: f32, z: f32, slope: f32) -> [f32; 4] {
        let [main, second] = self.description.colors;
        let seed = self.seed;
        let mix = |a: [f32; 3], b: [f32; 3], t: f32| -> [f32; 3] {
            core::array::from_fn(|i| a[i] + (b[i] - a[i]) * t.clamp(0.0, 1.0))
        };
        let patches = fractal(x / 75.0, z / 75.0, seed + 4, 5);
        let grain = 1.0 + 0.16 * fractal(x / 11.0, z / 11.0, seed + 5, 3);
        let color = match self.description.kind {
            GroundKind::Plain => {
                let earth = smooth(0.1, 0.6, fractal(x / 34.0, z / 34.0, seed + 6, 4));
                let grown = mix(main, second, 0.5 + 1.1 * patches);
                mix(
                    mix(grown, [0.43, 0.34, 0.24], 0.75 * earth),
                    [0.36, 0.33, 0.3],
                    2.2 * slope,
                )
            }
            GroundKind::Desert => {
                let hollow = smooth(9.0, -4.0, y);
                mix(
                    main,
                    second,
                    0.25 + 0.45 * patches + 0.45 * hollow + 1.5 * slope,
                )
            }
            // Beds of rock show on the slopes.
            GroundKind::Pit | GroundKind::Board | GroundKind::Measured => {
                let bed = noise(y / 5.5 + 0.6 * patches, 3.0, seed + 9);
                let rock = mix(second, [0.62, 0.5, 0.42], 0.5 + 0.6 * bed);
                let grass = smooth(-0.1, 0.5, patches) * smooth(6.0, 2.0, (y - 4.0).abs() * 0.25);
                let floor = mix(main, [0.42, 0.41, 0.24], 0.55 * grass);
                mix(floor, rock, 4.5 * slope - 0.15 + 0.25 * patches)
            }
        };
        linear(shade(color, grain))
    }

    /// The ground in square tiles, so that what is out of sight need not be drawn.
    pub fn tiles(&self) -> Vec<Body> {
        let GroundDescription {
            kind,
            size,
            cells,
            colors,
            ..
        } = self.description;
        if kind == GroundKind::Board {
            return board::tiles(size, cells, colors, self.seed);
        }
        let first = |t: u32| t * cells / TILES;
        (0..TILES * TILES)
            .map(|tile| {
                let (i, j) = (tile % TILES, tile / TILES);
                let [x, z] = [i, j].map(|t| [first(t), first(t + 1)]);
                self.tile(size / cells.max(1) as f32, x, z)
            })
            .filter(|tile| tile.triangles() > 0)
            .collect()
    }

    fn tile(&self, step: f32, [i0, i1]: [u32; 2], [j0, j1]: [u32; 2]) -> Body {
        let half = self.description.size * 0.5;
        let row = i1 - i0 + 3;
        // One more point around, for the normals at the seams.
        let heights: Vec<f32> = (0..(j1 - j0 + 3) * row)
            .map(|k| {
                let place = |first: u32, k: u32| (first as f32 + k as f32 - 1.0) * step - half;
                self.height(place(i0, k % row), place(j0, k / row))
            })
            .collect();
        let at = |i: u32, j: u32| heights[(j * row + i) as usize];
        let mut body = Body::default();
        for j in 1..=j1 - j0 + 1 {
            for i in 1..=i1 - i0 + 1 {
                let slope = Vec3::new(
                    at(i - 1, j) - at(i + 1, j),
                    2.0 * step,
                    at(i, j - 1) - at(i, j + 1),
                );
                let normal = slope.normalize_or(Vec3::Y);
                let (x, z) = (
                    (i0 + i - 1) as f32 * step - half,
                    (j0 + j - 1) as f32 * step - half,
                );
                let y = at(i, j);
                body.push_vertex(
                    Vec3::new(x, y, z),
                    normal,
                    self.color(x, y, z, 1.0 - normal.y),
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
