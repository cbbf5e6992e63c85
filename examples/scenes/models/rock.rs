//! Rocks.

use core::f32::consts::TAU;

use bevy::prelude::*;

use super::super::{
    mesh::{Body, shade},
    noise::{Stream, fractal},
    shapes::icosphere,
};
use super::{Finish, Model, Style, at, resting};

/// A boulder.
pub fn rock(style: Style) -> Model {
    let [color, dust] = style.colors;
    let seed = style.seed;
    let stretch = Vec3::new(0.75, 0.62, 0.6);
    let mut body = Body::default();
    let boulder = icosphere(style.segments, color)
        .bent(|p| {
            // Cut by planes, then weathered.
            let mut out = 1.25_f32;
            let mut random = Stream::new(seed);
            for _ in 0..14 {
                let axis = Vec3::new(
                    random.between(-1.0, 1.0),
                    random.between(-1.0, 1.0),
                    random.between(-1.0, 1.0),
                );
                let axis = axis.normalize_or(Vec3::Y);
                let near = random.between(0.7, 1.0);
                out = out.min(near / p.dot(axis).max(0.05));
            }
            let rough = fractal(p.x * 3.0 + 3.0 * p.z, p.y * 3.0 - p.z, seed, 4);
            p * stretch * (out + 0.07 * rough)
        })
        .tinted(|p| {
            let stain = fractal(p.x * 4.0 - p.z, p.y * 6.0 + p.z * 3.0, seed + 4, 4);
            shade(color, 1.0 + 0.25 * stain + 0.15 * p.y)
        });
    body.add(&boulder, at(0.0, 0.4, 0.0));
    let mut random = Stream::new(seed);
    for _ in 0..6 {
        let around = random.between(0.0, TAU);
        let pebble = icosphere(style.fine(0.3), dust)
            .bent(|p| p * (1.0 + 0.3 * fractal(p.x * 2.0, p.y * 2.0 + p.z, seed, 3)));
        let size = random.between(0.06, 0.16);
        body.add(
            &pebble,
            at(around.cos() * 0.85, size * 0.4, around.sin() * 0.75).with_scale(Vec3::new(
                size,
                size * 0.7,
                size,
            )),
        );
    }
    resting(body, Finish::Matte)
}
