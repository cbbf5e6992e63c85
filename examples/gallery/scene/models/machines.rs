//! Robots, claw-bots and windmills.

use core::f32::consts::{FRAC_PI_2, TAU};

use bevy::prelude::*;

use super::{Model, Part, Style, Turn, at, resting};
use crate::scene::mesh::{Body, ball, block, lathe, rod, shade};

fn put(body: &mut Body, part: &Body, place: Transform) {
    body.add(part, place);
}

fn bar(body: &mut Body, a: Vec3, b: Vec3, r: [f32; 2], segments: u32, color: [f32; 3]) {
    body.add(&rod(a, b, r, segments, color), Transform::IDENTITY);
}

/// A walker on two legs with a gun for one arm and a launcher for the other.
pub fn robot(style: Style) -> Model {
    let [color, trim] = style.colors;
    let dark = shade(trim, 0.5);
    let n = style.segments;
    let few = style.fine(0.6);
    let mut body = Body::default();
    for side in [-1.0_f32, 1.0] {
        let stride = 0.05 * side;
        let hip = Vec3::new(0.11 * side, 0.47, 0.0);
        let knee = Vec3::new(0.14 * side, 0.27, -0.05 - stride);
        let ankle = Vec3::new(0.15 * side, 0.06, 0.02 - stride);
        put(&mut body, &block(Vec3::new(0.13, 0.05, 0.22), 0.012, dark), at(ankle.x, 0.025, ankle.z - 0.03));
        for toe in [-0.04, 0.04] {
            put(&mut body, &block(Vec3::new(0.04, 0.035, 0.08), 0.008, trim), at(ankle.x + toe, 0.018, ankle.z - 0.16));
        }
        bar(&mut body, hip, knee, [0.055, 0.045], n, color);
        bar(&mut body, knee, ankle, [0.05, 0.035], n, trim);
        put(&mut body, &ball(n, dark), Transform::from_translation(knee).with_scale(Vec3::splat(0.058)));
        put(&mut body, &block(Vec3::new(0.09, 0.13, 0.05), 0.012, color), at(knee.x, 0.19, knee.z - 0.035));

        let shoulder = Vec3::new(0.24 * side, 0.75, 0.0);
        put(&mut body, &ball(n, color), Transform::from_translation(shoulder).with_scale(Vec3::new(0.09, 0.085, 0.095)));
        let elbow = Vec3::new(0.28 * side, 0.58, 0.02);
        let hand = Vec3::new(0.27 * side, 0.52, -0.19);
        bar(&mut body, shoulder, elbow, [0.045, 0.04], few, dark);
        bar(&mut body, elbow, hand, [0.05, 0.045], n, color);
        if side > 0.0 {
            bar(&mut body, hand, hand + Vec3::new(0.0, 0.0, -0.3), [0.022, 0.018], n, dark);
            bar(&mut body, hand + Vec3::Z * -0.3, hand + Vec3::Z * -0.34, [0.028, 0.028], n, trim);
            put(&mut body, &block(Vec3::new(0.05, 0.09, 0.16), 0.01, trim), at(hand.x, hand.y + 0.05, hand.z + 0.02));
        } else {
            put(&mut body, &block(Vec3::new(0.14, 0.12, 0.2), 0.014, trim), at(hand.x, hand.y + 0.01, hand.z));
            for (i, j) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
                let tube = Vec3::new(hand.x + 0.033 * i, hand.y + 0.01 + 0.028 * j, hand.z - 0.09);
                bar(&mut body, tube, tube + Vec3::Z * -0.035, [0.022, 0.02], few, dark);
            }
        }
    }
    put(&mut body, &block(Vec3::new(0.24, 0.1, 0.15), 0.02, dark), at(0.0, 0.48, 0.0));
    put(&mut body, &lathe(&[(0.07, 0.5), (0.08, 0.56), (0.07, 0.58)], n, trim), Transform::IDENTITY);
    put(&mut body, &block(Vec3::new(0.36, 0.24, 0.24), 0.045, color), at(0.0, 0.69, 0.0));
    put(&mut body, &block(Vec3::new(0.2, 0.12, 0.06), 0.02, trim), at(0.0, 0.69, -0.12));
    put(&mut body, &block(Vec3::new(0.24, 0.2, 0.12), 0.03, dark), at(0.0, 0.7, 0.16));
    put(&mut body, &block(Vec3::new(0.13, 0.11, 0.15), 0.03, color), at(0.0, 0.87, -0.02));
    put(&mut body, &block(Vec3::new(0.11, 0.028, 0.03), 0.008, [0.95, 0.55, 0.15]), at(0.0, 0.885, -0.09));
    for (x, tall) in [(-0.09, 1.0), (0.1, 0.97), (0.13, 0.9)] {
        bar(&mut body, Vec3::new(x, 0.78, 0.17), Vec3::new(x * 1.2, tall, 0.2), [0.006, 0.003], 5, dark);
    }
    for x in [-0.07, 0.07] {
        bar(&mut body, Vec3::new(x, 0.62, 0.22), Vec3::new(x, 0.56, 0.26), [0.03, 0.036], few, dark);
    }
    resting(body)
}

/// A tracked digger with a jointed arm and a three-fingered claw that swings.
pub fn claw_bot(style: Style) -> Model {
    let [color, trim] = style.colors;
    let dark = [0.12, 0.12, 0.13];
    let n = style.segments;
    let few = style.fine(0.5);
    let mut body = Body::default();
    for side in [-1.0, 1.0] {
        let x = 0.24 * side;
        put(&mut body, &block(Vec3::new(0.13, 0.1, 0.6), 0.04, dark), at(x, 0.09, 0.0));
        for wheel in 0..6 {
            let z = -0.25 + 0.1 * wheel as f32;
            let turn = Quat::from_rotation_z(FRAC_PI_2);
            let disc = lathe(&[(0.055, -0.08), (0.06, -0.07), (0.06, 0.07), (0.055, 0.08)], n, trim);
            put(&mut body, &disc, at(x, 0.07, z).with_rotation(turn));
        }
        for link in 0..26 {
            let a = TAU * link as f32 / 26.0;
            let (sin, cos) = a.sin_cos();
            let y = 0.09 + 0.065 * sin.signum() * sin.abs().powf(0.4);
            let z = 0.31 * cos.signum() * cos.abs().powf(0.6);
            put(&mut body, &block(Vec3::new(0.15, 0.02, 0.045), 0.006, shade(dark, 1.6)), at(x, y, z).with_rotation(Quat::from_rotation_x(a)));
        }
    }
    put(&mut body, &lathe(&[(0.2, 0.13), (0.2, 0.17), (0.17, 0.18), (0.17, 0.22)], n, dark), Transform::IDENTITY);
    let mut upper = Body::default();
    put(&mut upper, &block(Vec3::new(0.42, 0.2, 0.4), 0.05, color), at(0.0, 0.12, 0.06));
    put(&mut upper, &block(Vec3::new(0.16, 0.2, 0.2), 0.04, trim), at(-0.12, 0.26, -0.06));
    put(&mut upper, &block(Vec3::new(0.13, 0.1, 0.02), 0.008, [0.2, 0.4, 0.55]), at(-0.12, 0.29, -0.16));
    bar(&mut upper, Vec3::new(0.12, 0.2, 0.2), Vec3::new(0.12, 0.4, 0.22), [0.03, 0.025], n, dark);
    for x in [-0.16, 0.0, 0.16] {
        bar(&mut upper, Vec3::new(x, 0.22, 0.24), Vec3::new(x, 0.3, 0.24), [0.008, 0.008], few, trim);
    }
    let joints = [
        Vec3::new(0.08, 0.16, -0.12),
        Vec3::new(0.08, 0.62, -0.3),
        Vec3::new(0.08, 0.55, -0.68),
        Vec3::new(0.08, 0.3, -0.78),
    ];
    for (pair, r) in joints.windows(2).zip([0.05, 0.042, 0.034]) {
        bar(&mut upper, pair[0], pair[1], [r, r * 0.8], n, color);
        put(&mut upper, &ball(n, dark), Transform::from_translation(pair[0]).with_scale(Vec3::splat(r * 1.4)));
    }
    bar(&mut upper, Vec3::new(0.08, 0.24, -0.02), Vec3::new(0.08, 0.56, -0.24), [0.018, 0.018], n, trim);
    bar(&mut upper, Vec3::new(0.08, 0.7, -0.34), Vec3::new(0.08, 0.62, -0.6), [0.014, 0.014], n, trim);
    for finger in 0..3 {
        let turn = Quat::from_rotation_y(TAU * finger as f32 / 3.0);
        let wrist = joints[3];
        let out = wrist + turn * Vec3::new(0.0, -0.06, -0.1);
        let tip = wrist + turn * Vec3::new(0.0, -0.19, -0.04);
        bar(&mut upper, wrist, out, [0.026, 0.022], n, dark);
        bar(&mut upper, out, tip, [0.022, 0.005], n, dark);
    }
    Model {
        body,
        parts: vec![Part {
            body: upper,
            joint: at(0.0, 0.2, 0.0),
            turn: Turn::Swing(Vec3::Y, 0.7, 0.5, style.seed as f32),
        }],
    }
}

/// A lattice mast with a wheel of twelve blades and a tail vane.
pub fn windmill(style: Style) -> Model {
    let [color, trim] = style.colors;
    let n = style.fine(0.5);
    let mut body = Body::default();
    let corner = |level: f32, i: usize| {
        let turn = Quat::from_rotation_y(TAU * (i % 4) as f32 / 4.0 + 0.785);
        turn * Vec3::new(0.0, 0.8 * level, 0.12 * (1.0 - 0.8 * level))
    };
    let levels = 8;
    for level in 0..levels {
        let (lo, hi) = (level as f32 / levels as f32, (level + 1) as f32 / levels as f32);
        for i in 0..4 {
            bar(&mut body, corner(lo, i), corner(hi, i), [0.008, 0.008], n, color);
            bar(&mut body, corner(hi, i), corner(hi, i + 1), [0.004, 0.004], n, color);
            bar(&mut body, corner(lo, i), corner(hi, i + 1), [0.0035, 0.0035], n, color);
        }
    }
    put(&mut body, &block(Vec3::new(0.05, 0.05, 0.14), 0.012, trim), at(0.0, 0.82, 0.0));
    bar(&mut body, Vec3::new(0.0, 0.82, 0.05), Vec3::new(0.0, 0.83, 0.26), [0.008, 0.006], n, trim);
    put(&mut body, &block(Vec3::new(0.006, 0.11, 0.13), 0.002, trim), at(0.0, 0.84, 0.3));
    for i in 0..4 {
        put(&mut body, &block(Vec3::new(0.05, 0.03, 0.05), 0.01, shade(color, 0.6)), Transform::from_translation(corner(0.0, i)));
    }

    let mut wheel = Body::default();
    put(&mut wheel, &lathe(&[(0.03, -0.03), (0.035, 0.0), (0.02, 0.04), (0.0, 0.05)], style.segments, trim), Transform::from_rotation(Quat::from_rotation_x(-FRAC_PI_2)));
    for blade in 0..12 {
        let turn = Quat::from_rotation_z(TAU * blade as f32 / 12.0);
        let shape = block(Vec3::new(1.0, 1.0, 0.006), 0.001, color).bent(|p| {
            let width = 0.028 + 0.03 * (p.y + 0.5);
            let y = 0.05 + 0.15 * (p.y + 0.5);
            Vec3::new(p.x * width, y, p.z + p.x * width * 0.5)
        });
        put(&mut wheel, &shape, Transform::from_rotation(turn));
        let a = turn * Vec3::Y * 0.02;
        bar(&mut wheel, a, turn * Vec3::Y * 0.2, [0.004, 0.003], 6, trim);
        let next = Quat::from_rotation_z(TAU * (blade + 1) as f32 / 12.0);
        bar(&mut wheel, turn * Vec3::Y * 0.15, next * Vec3::Y * 0.15, [0.003, 0.003], 6, trim);
    }
    Model {
        body,
        parts: vec![Part {
            body: wheel,
            joint: at(0.0, 0.82, -0.1),
            turn: Turn::Spin(Vec3::Z, 0.9),
        }],
    }
}
