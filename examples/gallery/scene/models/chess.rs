//! Chess pieces, turned on a lathe.

use bevy::prelude::*;

use super::{Model, Style, at, resting};
use crate::scene::{
    format::ModelKind,
    mesh::{Body, ball, block, lathe, rod},
};

const FOOT: [(f32, f32); 9] = [
    (0.26, 0.0),
    (0.27, 0.02),
    (0.27, 0.05),
    (0.24, 0.08),
    (0.24, 0.08),
    (0.21, 0.09),
    (0.21, 0.13),
    (0.17, 0.15),
    (0.15, 0.18),
];

pub fn piece(kind: ModelKind, style: Style) -> Model {
    let [color, trim] = style.colors;
    let turned = |rest: &[(f32, f32)]| -> Body {
        let profile: Vec<_> = FOOT.iter().chain(rest).copied().collect();
        lathe(&profile, style.segments, color)
    };
    let collar = |y: f32, r: f32| lathe(&[(r * 0.7, y - 0.02), (r, y), (r, y), (r * 0.7, y + 0.02)], style.segments, trim);
    let mut body = match kind {
        ModelKind::Pawn => {
            let mut body = turned(&[(0.11, 0.3), (0.09, 0.5), (0.09, 0.62), (0.0, 0.66)]);
            body.add(&collar(0.62, 0.16), Transform::IDENTITY);
            body.add(&ball(style.segments, color), at(0.0, 0.81, 0.0).with_scale(Vec3::splat(0.19)));
            body
        }
        ModelKind::Rook => {
            let mut body = turned(&[
                (0.13, 0.35),
                (0.125, 0.68),
                (0.18, 0.74),
                (0.19, 0.76),
                (0.19, 0.88),
                (0.19, 0.88),
                (0.14, 0.88),
                (0.14, 0.88),
                (0.14, 0.8),
                (0.0, 0.8),
            ]);
            for i in 0..6 {
                let turn = Quat::from_rotation_y(core::f32::consts::TAU / 6.0 * i as f32);
                let merlon = block(Vec3::new(0.11, 0.12, 0.055), 0.008, color);
                body.add(
                    &merlon,
                    Transform::from_translation(turn * Vec3::new(0.0, 0.935, 0.163)).with_rotation(turn),
                );
            }
            body
        }
        ModelKind::Horse => horse(turned(&[(0.16, 0.22), (0.0, 0.24)]), style),
        ModelKind::Bishop => {
            let mut body = turned(&[(0.11, 0.32), (0.085, 0.58), (0.0, 0.62)]);
            body.add(&collar(0.6, 0.15), Transform::IDENTITY);
            body.add(&collar(0.64, 0.12), Transform::IDENTITY);
            let mitre = [(0.07, 0.63), (0.12, 0.7), (0.125, 0.76), (0.1, 0.83), (0.05, 0.91), (0.0, 0.94)];
            body.add(&lathe(&mitre, style.segments, color), Transform::IDENTITY);
            let slit = block(Vec3::new(0.03, 0.14, 0.16), 0.006, trim);
            body.add(
                &slit,
                at(0.05, 0.84, 0.0).with_rotation(Quat::from_rotation_z(-0.5)),
            );
            body.add(&ball(style.fine(0.6), trim), at(0.0, 0.965, 0.0).with_scale(Vec3::splat(0.035)));
            body
        }
        ModelKind::Queen => {
            let mut body = turned(&[(0.12, 0.3), (0.08, 0.62), (0.1, 0.7), (0.16, 0.88), (0.13, 0.88), (0.0, 0.9)]);
            body.add(&collar(0.66, 0.15), Transform::IDENTITY);
            for i in 0..9 {
                let turn = Quat::from_rotation_y(core::f32::consts::TAU / 9.0 * i as f32);
                let point = turn * Vec3::new(0.0, 0.9, 0.145);
                body.add(
                    &ball(style.fine(0.35), trim),
                    Transform::from_translation(point).with_scale(Vec3::splat(0.03)),
                );
            }
            body.add(&ball(style.fine(0.6), color), at(0.0, 0.94, 0.0).with_scale(Vec3::splat(0.06)));
            body
        }
        _ => {
            let mut body = turned(&[(0.12, 0.3), (0.085, 0.62), (0.1, 0.7), (0.15, 0.84), (0.12, 0.87), (0.0, 0.9)]);
            body.add(&collar(0.66, 0.15), Transform::IDENTITY);
            for (size, y) in [(Vec3::new(0.035, 0.13, 0.035), 0.935), (Vec3::new(0.11, 0.035, 0.035), 0.95)] {
                body.add(&block(size, 0.006, trim), at(0.0, y, 0.0));
            }
            body
        }
    };
    body.add(&collar(0.17, 0.2), Transform::IDENTITY);
    resting(body)
}

/// A horse's head: neck, muzzle, ears and a mane of rods on the turned foot.
fn horse(mut body: Body, style: Style) -> Body {
    let [color, trim] = style.colors;
    let n = style.segments;
    let spine = [
        (Vec3::new(0.0, 0.2, 0.05), 0.15),
        (Vec3::new(0.0, 0.42, 0.09), 0.13),
        (Vec3::new(0.0, 0.62, 0.08), 0.11),
        (Vec3::new(0.0, 0.78, 0.0), 0.1),
    ];
    for pair in spine.windows(2) {
        body.add(&rod(pair[0].0, pair[1].0, [pair[0].1, pair[1].1], n, color), Transform::IDENTITY);
    }
    body.add(&rod(Vec3::new(0.0, 0.79, 0.0), Vec3::new(0.0, 0.62, -0.2), [0.1, 0.06], n, color), Transform::IDENTITY);
    body.add(&ball(n, color), at(0.0, 0.6, -0.215).with_scale(Vec3::new(0.062, 0.06, 0.07)));
    for side in [-1.0, 1.0] {
        body.add(
            &rod(Vec3::new(0.045 * side, 0.85, 0.02), Vec3::new(0.06 * side, 0.97, 0.0), [0.03, 0.006], style.fine(0.4), color),
            Transform::IDENTITY,
        );
        body.add(&ball(style.fine(0.4), trim), at(0.075 * side, 0.77, -0.09).with_scale(Vec3::splat(0.018)));
    }
    for i in 0..6 {
        let t = i as f32 / 5.0;
        let root = Vec3::new(0.0, 0.86 - 0.5 * t, 0.07 + 0.1 * (t * 3.0).sin());
        body.add(&rod(root, root + Vec3::new(0.0, -0.02, 0.07), [0.035, 0.012], style.fine(0.4), trim), Transform::IDENTITY);
    }
    body
}
