//! Trees, cacti and rocks.

use core::f32::consts::TAU;

use bevy::prelude::*;

use super::{Model, Style, at, resting};
use crate::scene::{
    mesh::{Body, ball, lathe, rod, shade},
    noise::{Stream, fractal},
};

/// A trunk that forks three times, with a clump of leaves at every end.
pub fn tree(style: Style) -> Model {
    let [leaf, bark] = style.colors;
    let mut random = Stream::new(style.seed);
    let mut body = Body::default();
    let trunk = [(0.055, 0.0), (0.036, 0.03), (0.028, 0.1), (0.024, 0.32)];
    body.add(&lathe(&trunk, style.segments, bark), Transform::IDENTITY);
    grow(&mut body, &mut random, style, Vec3::Y * 0.32, Vec3::Y, 0.19, 0.024, 3, [leaf, bark]);
    resting(body)
}

fn grow(
    body: &mut Body,
    random: &mut Stream,
    style: Style,
    from: Vec3,
    along: Vec3,
    length: f32,
    radius: f32,
    forks: u32,
    colors: [[f32; 3]; 2],
) {
    let [leaf, bark] = colors;
    let to = from + along * length;
    body.add(&rod(from, to, [radius, radius * 0.7], style.fine(0.5), bark), Transform::IDENTITY);
    if forks <= 2 {
        let size = Vec3::new(0.1, 0.075, 0.1) * random.between(0.75, 1.25);
        let seed = (random.next() * 1e6) as u64;
        let color = shade(leaf, random.between(0.75, 1.2));
        let clump = ball(style.segments, color).bent(|p| {
            let bumps = fractal(p.x * 2.3 + p.z, p.y * 2.3 - p.z, seed, 3);
            p * (1.0 + 0.35 * bumps)
        });
        body.add(&clump, Transform::from_translation(to).with_scale(size));
    }
    if forks == 0 {
        return;
    }
    let turn = random.between(0.0, TAU);
    for branch in 0..3 {
        let around = turn + TAU * branch as f32 / 3.0 + random.between(-0.4, 0.4);
        let side = Vec3::new(around.cos(), random.between(0.0, 0.35), around.sin());
        let next = (along * 0.9 + side).normalize();
        let shorter = length * random.between(0.62, 0.82);
        grow(body, random, style, to, next, shorter, radius * 0.62, forks - 1, colors);
    }
}

/// A ribbed column with arms that bend upwards.
pub fn cactus(style: Style) -> Model {
    let [green, tip] = style.colors;
    let mut random = Stream::new(style.seed);
    let mut body = Body::default();
    column(&mut body, style, &[Vec3::ZERO, Vec3::Y * 0.5, Vec3::Y * 0.94], 0.085, green);
    body.add(&ball(style.fine(0.5), tip), at(0.0, 1.0, 0.0).with_scale(Vec3::splat(0.03)));
    for arm in 0..3 {
        let around = TAU * arm as f32 / 3.0 + random.between(-0.5, 0.5);
        let out = Vec3::new(around.cos(), 0.0, around.sin());
        let root = Vec3::Y * random.between(0.35, 0.55);
        let elbow = root + out * random.between(0.18, 0.24) + Vec3::Y * 0.04;
        let end = elbow + Vec3::Y * random.between(0.15, 0.32);
        column(&mut body, style, &[root, elbow, end], 0.055, shade(green, 0.95));
        body.add(&ball(style.fine(0.5), tip), Transform::from_translation(end + Vec3::Y * 0.05).with_scale(Vec3::splat(0.02)));
    }
    resting(body)
}

/// Ribbed rods along a line of points.
fn column(body: &mut Body, style: Style, points: &[Vec3], radius: f32, color: [f32; 3]) {
    for pair in points.windows(2) {
        let length = pair[0].distance(pair[1]);
        let steps = 8;
        let mut profile = vec![(0.0, -radius * 0.9), (radius * 0.7, -radius * 0.6)];
        profile.extend((0..=steps).map(|i| (radius, length * i as f32 / steps as f32)));
        profile.extend([(radius * 0.75, length + radius * 0.6), (0.0, length + radius * 0.85)]);
        let ribbed = lathe(&profile, style.segments * 2, color).bent(|p| {
            let rib = 1.0 + 0.09 * (p.z.atan2(p.x) * 12.0).cos();
            Vec3::new(p.x * rib, p.y, p.z * rib)
        });
        let turn = Quat::from_rotation_arc(Vec3::Y, (pair[1] - pair[0]) / length);
        body.add(&ribbed, Transform::from_translation(pair[0]).with_rotation(turn));
    }
}

/// A boulder.
pub fn rock(style: Style) -> Model {
    let [color, dust] = style.colors;
    let seed = style.seed;
    let stretch = Vec3::new(0.75, 0.62, 0.6);
    let mut body = Body::default();
    let boulder = ball(style.segments * 2, color).bent(|p| {
        let facets = fractal(p.x * 1.4 + 3.0 * p.z, p.y * 1.4 - p.z, seed, 5);
        let flat = 1.0 - 0.25 * fractal(p.z * 0.8, p.x * 0.8 + p.y, seed + 9, 2).abs();
        p * stretch * (1.0 + 0.3 * facets) * flat
    });
    body.add(&boulder, at(0.0, 0.4, 0.0));
    let mut random = Stream::new(seed);
    for _ in 0..6 {
        let around = random.between(0.0, TAU);
        let pebble = ball(style.fine(0.5), dust).bent(|p| p * (1.0 + 0.3 * fractal(p.x * 2.0, p.y * 2.0 + p.z, seed, 3)));
        let size = random.between(0.06, 0.16);
        body.add(&pebble, at(around.cos() * 0.85, size * 0.4, around.sin() * 0.75).with_scale(Vec3::new(size, size * 0.7, size)));
    }
    resting(body)
}
