//! Claw-bots.

use core::f32::consts::{FRAC_PI_2, TAU};

use bevy::prelude::*;

use super::super::{
    mesh::{Body, shade},
    shapes::{ball, block, lathe, rod, strut, tube},
};
use super::{Finish, Model, Part, Style, Turn, at};

pub(super) fn put(body: &mut Body, part: &Body, place: Transform) {
    body.add(part, place);
}

/// Where something upright must be put to reach from `a` to `b`.
fn along(a: Vec3, b: Vec3) -> Transform {
    // Seen from the side, so that its own sides stay upright.
    let way = b - a;
    Transform::from_translation(a).with_rotation(Quat::from_rotation_x(way.z.atan2(way.y)))
}

/// An upright box girder, thickest in its lower half.
fn beam(wide: f32, narrow: f32, length: f32, color: [f32; 3]) -> Body {
    block(Vec3::ONE, 0.14, color).carved(|p| {
        let up = p.y + 0.5;
        let half = wide + (narrow - wide) * up;
        Vec3::new(
            p.x * 1.5 * half,
            -0.03 + up * (length + 0.06),
            p.z * 2.2 * half,
        )
    })
}

pub(super) fn bar(body: &mut Body, a: Vec3, b: Vec3, r: [f32; 2], segments: u32, color: [f32; 3]) {
    body.add(&rod(a, b, r, segments, color), Transform::IDENTITY);
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
        put(
            &mut body,
            &block(Vec3::new(0.13, 0.1, 0.6), 0.04, dark),
            at(x, 0.09, 0.0),
        );
        for wheel in 0..6 {
            let z = -0.25 + 0.1 * wheel as f32;
            let turn = Quat::from_rotation_z(FRAC_PI_2);
            let disc = lathe(
                &[(0.055, -0.08), (0.06, -0.07), (0.06, 0.07), (0.055, 0.08)],
                n,
                trim,
            );
            put(&mut body, &disc, at(x, 0.07, z).with_rotation(turn));
        }
        for link in 0..26 {
            let a = TAU * link as f32 / 26.0;
            let (sin, cos) = a.sin_cos();
            let y = 0.09 + 0.065 * sin.signum() * sin.abs().powf(0.4);
            let z = 0.31 * cos.signum() * cos.abs().powf(0.6);
            put(
                &mut body,
                &block(Vec3::new(0.15, 0.02, 0.045), 0.006, shade(dark, 1.6)),
                at(x, y, z).with_rotation(Quat::from_rotation_x(a)),
            );
        }
    }
    put(
        &mut body,
        &lathe(
            &[(0.2, 0.13), (0.2, 0.17), (0.17, 0.18), (0.17, 0.22)],
            n,
            dark,
        ),
        Transform::IDENTITY,
    );
    let mut upper = Body::default();
    put(
        &mut upper,
        &block(Vec3::new(0.42, 0.2, 0.4), 0.05, color),
        at(0.0, 0.12, 0.06),
    );
    put(
        &mut upper,
        &block(Vec3::new(0.16, 0.2, 0.2), 0.04, trim),
        at(-0.12, 0.26, -0.06),
    );
    put(
        &mut upper,
        &block(Vec3::new(0.13, 0.1, 0.02), 0.008, [0.2, 0.4, 0.55]),
        at(-0.12, 0.29, -0.16),
    );
    bar(
        &mut upper,
        Vec3::new(0.12, 0.2, 0.2),
        Vec3::new(0.12, 0.4, 0.22),
        [0.03, 0.025],
        n,
        dark,
    );
    for x in [-0.16, 0.0, 0.16] {
        bar(
            &mut upper,
            Vec3::new(x, 0.22, 0.24),
            Vec3::new(x, 0.3, 0.24),
            [0.008, 0.008],
            few,
            trim,
        );
    }
    let joints = [
        Vec3::new(0.08, 0.16, -0.12),
        Vec3::new(0.08, 0.62, -0.3),
        Vec3::new(0.08, 0.55, -0.68),
        Vec3::new(0.08, 0.3, -0.78),
    ];
    for (pair, r) in joints.windows(2).zip([0.062, 0.05, 0.036]) {
        put(
            &mut upper,
            &beam(r, r * 0.72, pair[0].distance(pair[1]), color),
            along(pair[0], pair[1]),
        );
        let pin = strut(
            Vec3::X * (0.08 - r),
            Vec3::X * (0.08 + r),
            [r * 0.8, r * 0.8],
            n,
            dark,
        );
        put(&mut upper, &pin, at(0.0, pair[0].y, pair[0].z));
    }
    // Cylinders and their pistons.
    for (a, b, r) in [
        (
            Vec3::new(0.03, 0.2, -0.24),
            Vec3::new(0.03, 0.5, -0.27),
            0.022,
        ),
        (
            Vec3::new(0.13, 0.2, -0.24),
            Vec3::new(0.13, 0.5, -0.27),
            0.022,
        ),
        (
            Vec3::new(0.08, 0.55, -0.2),
            Vec3::new(0.08, 0.7, -0.42),
            0.02,
        ),
        (
            Vec3::new(0.08, 0.66, -0.46),
            Vec3::new(0.08, 0.48, -0.72),
            0.016,
        ),
    ] {
        let middle = a.lerp(b, 0.55);
        bar(&mut upper, a, middle, [r, r], n, trim);
        bar(
            &mut upper,
            middle,
            b,
            [r * 0.55, r * 0.55],
            n,
            [0.75, 0.76, 0.78],
        );
    }
    for finger in 0..4 {
        let turn = Quat::from_rotation_y(TAU * finger as f32 / 4.0 + 0.4);
        let point = |out: f32, down: f32, r: f32| {
            (
                joints[3] + turn * Vec3::new(0.0, -down, -out),
                Vec2::new(r, r * 0.8),
            )
        };
        let claw = [
            point(0.0, 0.0, 0.03),
            point(0.075, 0.025, 0.03),
            point(0.125, 0.085, 0.027),
            point(0.13, 0.15, 0.021),
            point(0.095, 0.205, 0.013),
            point(0.055, 0.235, 0.003),
        ];
        put(
            &mut upper,
            &tube(&claw, turn * Vec3::X, n, dark),
            Transform::IDENTITY,
        );
    }
    put(
        &mut upper,
        &ball(n, dark),
        Transform::from_translation(joints[3]).with_scale(Vec3::splat(0.05)),
    );
    // A handrail, a ladder and lamps.
    for pair in [(-0.19, 0.25), (0.19, 0.25)] {
        let (x, z) = pair;
        bar(
            &mut upper,
            Vec3::new(x, 0.3, z),
            Vec3::new(x, 0.3, 0.0),
            [0.006, 0.006],
            few,
            trim,
        );
        for post in [0.0, 0.125, 0.25] {
            bar(
                &mut upper,
                Vec3::new(x, 0.21, post),
                Vec3::new(x, 0.3, post),
                [0.006, 0.006],
                few,
                trim,
            );
        }
    }
    bar(
        &mut upper,
        Vec3::new(-0.19, 0.3, 0.25),
        Vec3::new(0.19, 0.3, 0.25),
        [0.006, 0.006],
        few,
        trim,
    );
    for x in [-0.17, -0.07] {
        put(
            &mut upper,
            &ball(few, [1.0, 0.85, 0.5]),
            at(x, 0.375, -0.13).with_scale(Vec3::splat(0.018)),
        );
    }
    bar(
        &mut upper,
        Vec3::new(-0.18, 0.35, 0.02),
        Vec3::new(-0.19, 0.62, 0.04),
        [0.005, 0.002],
        few,
        dark,
    );
    Model {
        body,
        finish: Finish::Metal,
        parts: vec![Part {
            body: upper,
            finish: Finish::Satin,
            joint: at(0.0, 0.2, 0.0),
            turn: Turn::Swing(Vec3::Y, 0.7, 0.5, style.seed as f32),
        }],
    }
}
