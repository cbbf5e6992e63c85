//! Chess pieces, turned on a lathe.

use bevy::prelude::*;

use super::super::{
    format::ModelKind,
    mesh::Body,
    shapes::{ball, block, lathe, rod, tube},
};
use super::{Finish, Model, Style, at, resting};

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

/// Any of the six pieces.
pub fn piece(kind: ModelKind, style: Style) -> Model {
    let [color, trim] = style.colors;
    let turned = |rest: &[(f32, f32)]| -> Body {
        let profile: Vec<_> = FOOT.iter().chain(rest).copied().collect();
        lathe(&rounded(&profile), style.segments, color)
    };
    let collar = |y: f32, r: f32| {
        lathe(
            &[(r * 0.7, y - 0.02), (r, y), (r, y), (r * 0.7, y + 0.02)],
            style.segments,
            trim,
        )
    };
    let mut body = match kind {
        ModelKind::Pawn => {
            let mut body = turned(&[(0.11, 0.3), (0.09, 0.5), (0.09, 0.62), (0.0, 0.66)]);
            body.add(&collar(0.62, 0.16), Transform::IDENTITY);
            body.add(
                &ball(style.segments, color),
                at(0.0, 0.81, 0.0).with_scale(Vec3::splat(0.19)),
            );
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
                    Transform::from_translation(turn * Vec3::new(0.0, 0.935, 0.163))
                        .with_rotation(turn),
                );
            }
            body
        }
        ModelKind::Horse => horse(turned(&[(0.16, 0.22), (0.0, 0.24)]), style),
        ModelKind::Bishop => {
            let mut body = turned(&[(0.11, 0.32), (0.085, 0.58), (0.0, 0.62)]);
            body.add(&collar(0.6, 0.15), Transform::IDENTITY);
            body.add(&collar(0.64, 0.12), Transform::IDENTITY);
            let mitre = [
                (0.07, 0.63),
                (0.12, 0.7),
                (0.125, 0.76),
                (0.1, 0.83),
                (0.05, 0.91),
                (0.0, 0.94),
            ];
            body.add(&lathe(&mitre, style.segments, color), Transform::IDENTITY);
            let slit = block(Vec3::new(0.03, 0.14, 0.16), 0.006, trim);
            body.add(
                &slit,
                at(0.05, 0.84, 0.0).with_rotation(Quat::from_rotation_z(-0.5)),
            );
            body.add(
                &ball(style.fine(0.6), trim),
                at(0.0, 0.965, 0.0).with_scale(Vec3::splat(0.035)),
            );
            body
        }
        ModelKind::Queen => {
            let mut body = turned(&[
                (0.12, 0.3),
                (0.08, 0.62),
                (0.1, 0.7),
                (0.16, 0.88),
                (0.13, 0.88),
                (0.0, 0.9),
            ]);
            body.add(&collar(0.66, 0.15), Transform::IDENTITY);
            for i in 0..9 {
                let turn = Quat::from_rotation_y(core::f32::consts::TAU / 9.0 * i as f32);
                let point = turn * Vec3::new(0.0, 0.9, 0.145);
                body.add(
                    &ball(style.fine(0.35), trim),
                    Transform::from_translation(point).with_scale(Vec3::splat(0.03)),
                );
            }
            body.add(
                &ball(style.fine(0.6), color),
                at(0.0, 0.94, 0.0).with_scale(Vec3::splat(0.06)),
            );
            body
        }
        _ => {
            let mut body = turned(&[
                (0.12, 0.3),
                (0.085, 0.62),
                (0.1, 0.7),
                (0.15, 0.84),
                (0.12, 0.87),
                (0.0, 0.9),
            ]);
            body.add(&collar(0.66, 0.15), Transform::IDENTITY);
            for (size, y) in [
                (Vec3::new(0.035, 0.13, 0.035), 0.935),
                (Vec3::new(0.11, 0.035, 0.035), 0.95),
            ] {
                body.add(&block(size, 0.006, trim), at(0.0, y, 0.0));
            }
            body
        }
    };
    body.add(&collar(0.17, 0.2), Transform::IDENTITY);
    resting(body, Finish::Polished)
}

/// A profile with a point more on every long curve; points given twice stay sharp.
fn rounded(profile: &[(f32, f32)]) -> Vec<(f32, f32)> {
    let points: Vec<Vec2> = profile.iter().map(|(r, y)| Vec2::new(*r, *y)).collect();
    let mut out = Vec::new();
    for i in 0..points.len() {
        out.push((points[i].x, points[i].y));
        let Some(&next) = points.get(i + 1) else {
            break;
        };
        let here = points[i];
        if here.distance(next) < 0.055 || next.x == 0.0 {
            continue;
        }
        // A doubled neighbor is a corner: no tangent reaches across it.
        let before = points[i.saturating_sub(1)];
        let after = points[(i + 2).min(points.len() - 1)];
        let steps = if here.distance(next) > 0.2 { 4 } else { 2 };
        for step in 1..steps {
            let t = step as f32 / steps as f32;
            let p = 0.5
                * (2.0 * here
                    + (next - before) * t
                    + (2.0 * before - 5.0 * here + 4.0 * next - after) * t * t
                    + (3.0 * (here - next) + after - before) * t * t * t);
            out.push((p.x.max(0.0), p.y));
        }
    }
    out
}

/// A horse's head and neck, bent as one piece, with ears, eyes and a mane.
fn horse(mut body: Body, style: Style) -> Body {
    let [color, trim] = style.colors;
    let n = style.segments;
    let point =
        |y: f32, z: f32, deep: f32, wide: f32| (Vec3::new(0.0, y, z), Vec2::new(deep, wide));
    let neck = [
        point(0.18, 0.03, 0.17, 0.165),
        point(0.28, 0.05, 0.165, 0.14),
        point(0.4, 0.075, 0.155, 0.115),
        point(0.52, 0.085, 0.14, 0.1),
        point(0.64, 0.075, 0.125, 0.09),
        point(0.74, 0.045, 0.115, 0.085),
        point(0.82, 0.0, 0.105, 0.08),
        point(0.86, -0.05, 0.09, 0.07),
        point(0.875, -0.08, 0.05, 0.045),
    ];
    body.add(&tube(&neck, Vec3::X, n, color), Transform::IDENTITY);
    let face = [
        point(0.84, 0.03, 0.05, 0.05),
        point(0.815, -0.01, 0.1, 0.085),
        point(0.76, -0.09, 0.1, 0.086),
        point(0.7, -0.16, 0.08, 0.07),
        point(0.645, -0.225, 0.064, 0.058),
        point(0.6, -0.27, 0.062, 0.06),
        point(0.575, -0.3, 0.045, 0.046),
        point(0.565, -0.31, 0.015, 0.02),
    ];
    body.add(&tube(&face, Vec3::X, n, color), Transform::IDENTITY);
    for side in [-1.0, 1.0] {
        let ear = [
            (Vec3::new(0.045 * side, 0.85, 0.0), Vec2::new(0.035, 0.025)),
            (
                Vec3::new(0.055 * side, 0.92, -0.005),
                Vec2::new(0.03, 0.018),
            ),
            (Vec3::new(0.06 * side, 1.0, -0.02), Vec2::new(0.004, 0.004)),
        ];
        body.add(
            &tube(&ear, Vec3::X, style.fine(0.35), color),
            Transform::IDENTITY,
        );
        let eye = at(0.078 * side, 0.78, -0.09).with_scale(Vec3::new(0.014, 0.022, 0.022));
        body.add(&ball(style.fine(0.4), trim), eye);
        body.add(
            &ball(style.fine(0.3), trim),
            at(0.045 * side, 0.6, -0.29).with_scale(Vec3::splat(0.013)),
        );
    }
    for i in 0..8 {
        let t = i as f32 / 7.0;
        let root = Vec3::new(
            0.0,
            0.9 - 0.58 * t,
            0.09 + 0.145 * (t * 2.6).sin() - 0.03 * t,
        );
        let lock = rod(
            root,
            root + Vec3::new(0.0, -0.055, 0.035),
            [0.034, 0.012],
            style.fine(0.25),
            trim,
        );
        body.add(&lock, Transform::IDENTITY);
    }
    body
}
