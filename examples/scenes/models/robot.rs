//! War robots: two bodies, legs and what turns upon them, each painted and bare.

use bevy::prelude::*;

use super::super::{
    mesh::{Body, shade},
    shapes::{ball, block, crate_box, lathe, strut},
};
use super::{Finish, Model, Part, Style, Turn, at, fixed, sized};

const LAMP: [f32; 3] = [1.0, 0.62, 0.18];

/// Where the upper body turns.
const WAIST: f32 = 0.5;

/// Painted and bare metal of one rigid piece.
#[derive(Default)]
struct Piece {
    paint: Body,
    bare: Body,
}

/// A robot on two legs. Variants: a rifleman, one with shoulder cannons, and a scout with a dish.
pub fn robot(style: Style) -> Model {
    let [color, trim] = style.colors;
    let dark = shade(trim, 0.55);
    let kind = style.variant % 3;
    let legs = legs(style, kind, color, trim, dark);
    let mut top = torso(style, kind, color, trim, dark);
    arms(&mut top, style, kind, color, trim, dark);
    // A rotating joint's frame has its origin at the joint.
    let lower = |body: Body| body.moved(Vec3::Y * -WAIST);
    let turn = Turn::Swing(Vec3::Y, 0.32, 0.55, (style.seed % 17) as f32);
    let joint = at(0.0, WAIST, 0.0);
    Model {
        body: legs.paint,
        finish: Finish::Satin,
        parts: vec![
            fixed(legs.bare, Finish::Metal),
            Part {
                body: lower(top.paint),
                finish: Finish::Satin,
                joint,
                turn,
            },
            Part {
                body: lower(top.bare),
                finish: Finish::Metal,
                joint,
                turn,
            },
        ],
    }
}

fn legs(style: Style, kind: u32, color: [f32; 3], trim: [f32; 3], dark: [f32; 3]) -> Piece {
    let n = style.segments;
    let mut piece = Piece::default();
    let wide = if kind == 1 { 1.25 } else { 1.0 };
    for side in [-1.0_f32, 1.0] {
        // One foot before the other.
        let stride = 0.07 * side;
        let hip = Vec3::new(0.1 * side * wide, 0.45, 0.0);
        let back = if kind == 2 { 0.09 } else { -0.05 };
        let knee = Vec3::new(0.135 * side * wide, 0.26, back - stride);
        let ankle = Vec3::new(0.145 * side * wide, 0.055, 0.025 - stride);
        let foot = block(Vec3::new(0.115 * wide, 0.05, 0.17), 0.014, dark);
        piece.bare.add(&foot, at(ankle.x, 0.025, ankle.z));
        for toe in [-0.036, 0.036] {
            let toe_box = crate_box(Vec3::new(0.045, 0.034, 0.1), trim);
            piece
                .bare
                .add(&toe_box, at(ankle.x + toe * wide, 0.017, ankle.z - 0.125));
        }
        piece.bare.add(
            &crate_box(Vec3::new(0.05, 0.03, 0.07), trim),
            at(ankle.x, 0.015, ankle.z + 0.11),
        );
        piece.paint.add(
            &strut(hip, knee, [0.058 * wide, 0.044], n, color),
            Transform::IDENTITY,
        );
        piece.bare.add(
            &strut(knee, ankle, [0.036, 0.028], n, dark),
            Transform::IDENTITY,
        );
        piece.bare.add(
            &ball(n, trim),
            at(knee.x, knee.y, knee.z).with_scale(Vec3::splat(0.052)),
        );
        let shin = (knee + ankle) * 0.5;
        let tilt = Quat::from_rotation_arc(Vec3::Y, (knee - ankle).normalize_or(Vec3::Y));
        let greave = block(Vec3::new(0.088 * wide, 0.15, 0.075), 0.018, color);
        piece.paint.add(
            &greave,
            Transform::from_translation(shin + tilt * Vec3::new(0.0, 0.0, -0.012))
                .with_rotation(tilt),
        );
    }
    piece.bare.add(
        &block(Vec3::new(0.25 * wide, 0.085, 0.14), 0.022, dark),
        at(0.0, 0.455, 0.0),
    );
    piece.paint.add(
        &crate_box(Vec3::new(0.09, 0.11, 0.04), color),
        at(0.0, 0.43, -0.075),
    );
    piece
}

fn torso(style: Style, kind: u32, color: [f32; 3], trim: [f32; 3], dark: [f32; 3]) -> Piece {
    let n = style.segments;
    let mut piece = Piece::default();
    let turntable = lathe(&[(0.085, 0.49), (0.095, 0.52), (0.07, 0.575)], n, dark);
    piece.bare.add(&turntable, Transform::IDENTITY);
    let bulk = if kind == 1 { 1.12 } else { 1.0 };
    // Narrow at the waist, broad at the shoulders.
    let chest = block(Vec3::new(1.0, 1.0, 1.0), 0.13, color).carved(|p| {
        let up = p.y + 0.5;
        Vec3::new(
            p.x * (0.24 + 0.17 * up) * bulk,
            0.56 + 0.25 * up,
            p.z * (0.19 + 0.09 * up) - 0.035 * (p.z < 0.0) as u32 as f32 * up,
        )
    });
    piece.paint.add(&chest, Transform::IDENTITY);
    piece.bare.add(
        &crate_box(Vec3::new(0.17, 0.09, 0.05), trim),
        at(0.0, 0.69, -0.145),
    );
    piece.bare.add(
        &block(Vec3::new(0.22, 0.2, 0.11), 0.03, dark),
        at(0.0, 0.7, 0.17),
    );
    for x in [-0.07, 0.07] {
        let (a, b) = (Vec3::new(x, 0.72, 0.21), Vec3::new(x * 1.2, 0.86, 0.27));
        piece.bare.add(
            &strut(a, b, [0.03, 0.038], n.min(7), trim),
            Transform::IDENTITY,
        );
    }
    match kind {
        // A cockpit sunk between two cannons.
        1 => {
            piece.bare.add(
                &ball(n, [0.25, 0.34, 0.42]),
                sized(0.0, 0.8, -0.08, Vec3::new(0.09, 0.06, 0.1)),
            );
            for side in [-1.0_f32, 1.0] {
                let breech = Vec3::new(0.135 * side, 0.885, 0.1);
                piece.paint.add(
                    &block(Vec3::new(0.085, 0.1, 0.22), 0.022, color),
                    at(breech.x, breech.y, breech.z),
                );
                let muzzle = Vec3::new(0.135 * side, 0.935, -0.36);
                piece.bare.add(
                    &strut(breech, muzzle, [0.026, 0.018], n, dark),
                    Transform::IDENTITY,
                );
                let brake = muzzle + Vec3::new(0.0, 0.005, -0.05);
                piece.bare.add(
                    &strut(muzzle, brake, [0.028, 0.028], n, trim),
                    Transform::IDENTITY,
                );
            }
            let tip = Vec3::new(0.03, 1.0, 0.22);
            piece.bare.add(
                &strut(Vec3::new(0.03, 0.78, 0.19), tip, [0.006, 0.003], 5, dark),
                Transform::IDENTITY,
            );
        }
        // A slim head under a dish.
        2 => {
            piece.paint.add(
                &block(Vec3::new(0.1, 0.1, 0.17), 0.028, color),
                at(0.0, 0.865, -0.04),
            );
            piece.bare.add(
                &ball(n, LAMP),
                sized(0.0, 0.87, -0.12, Vec3::new(0.036, 0.03, 0.025)),
            );
            let dish = lathe(
                &[
                    (0.0, 0.0),
                    (0.06, 0.012),
                    (0.1, 0.04),
                    (0.1, 0.05),
                    (0.05, 0.03),
                    (0.0, 0.025),
                ],
                n,
                trim,
            );
            let tilt = Quat::from_rotation_x(-1.1) * Quat::from_rotation_z(0.3);
            piece
                .bare
                .add(&dish, at(0.1, 0.93, 0.12).with_rotation(tilt));
            piece.bare.add(
                &strut(
                    Vec3::new(0.1, 0.78, 0.16),
                    Vec3::new(0.1, 0.93, 0.12),
                    [0.014, 0.01],
                    6,
                    dark,
                ),
                Transform::IDENTITY,
            );
            let tip = Vec3::new(-0.13, 1.0, 0.2);
            piece.bare.add(
                &strut(Vec3::new(-0.1, 0.78, 0.17), tip, [0.006, 0.003], 5, dark),
                Transform::IDENTITY,
            );
        }
        // A helmet with a visor and two aerials.
        _ => {
            piece.paint.add(
                &block(Vec3::new(0.13, 0.115, 0.15), 0.034, color),
                at(0.0, 0.865, -0.02),
            );
            piece.bare.add(
                &crate_box(Vec3::new(0.1, 0.026, 0.02), LAMP),
                at(0.0, 0.88, -0.092),
            );
            piece.bare.add(
                &strut(Vec3::Y * 0.8, Vec3::Y * 0.83, [0.06, 0.05], n, dark),
                Transform::IDENTITY,
            );
            for (x, tall) in [(-0.09, 1.0), (0.1, 0.95)] {
                let (a, b) = (Vec3::new(x, 0.78, 0.17), Vec3::new(x * 1.25, tall, 0.2));
                piece
                    .bare
                    .add(&strut(a, b, [0.006, 0.003], 5, dark), Transform::IDENTITY);
            }
        }
    }
    piece
}

fn arms(
    piece: &mut Piece,
    style: Style,
    kind: u32,
    color: [f32; 3],
    trim: [f32; 3],
    dark: [f32; 3],
) {
    let n = style.segments;
    for side in [-1.0_f32, 1.0] {
        let shoulder = Vec3::new(0.25 * side, 0.755, 0.0);
        let lean = Quat::from_rotation_z(-0.35 * side);
        let pauldron = block(Vec3::new(0.13, 0.1, 0.17), 0.034, color);
        piece.paint.add(
            &pauldron,
            at(shoulder.x, shoulder.y + 0.02, 0.0).with_rotation(lean),
        );
        let elbow = Vec3::new(0.29 * side, 0.575, 0.035);
        let raised = if kind == 2 && side > 0.0 { 0.14 } else { 0.0 };
        let hand = Vec3::new(0.27 * side, 0.545 + raised, -0.16);
        piece.bare.add(
            &strut(shoulder, elbow, [0.038, 0.032], n.min(7), dark),
            Transform::IDENTITY,
        );
        piece.paint.add(
            &strut(elbow, hand, [0.05, 0.042], n, color),
            Transform::IDENTITY,
        );
        if side > 0.0 {
            // A rifle as long as the arm.
            let aim = Vec3::new(0.0, raised * 0.4, -0.3);
            piece.bare.add(
                &crate_box(Vec3::new(0.05, 0.085, 0.2), trim),
                at(hand.x, hand.y + 0.03, hand.z - 0.03),
            );
            piece.bare.add(
                &strut(hand, hand + aim, [0.021, 0.016], n, dark),
                Transform::IDENTITY,
            );
            piece.bare.add(
                &strut(
                    hand + aim,
                    hand + aim * 1.16,
                    [0.027, 0.027],
                    n.min(7),
                    trim,
                ),
                Transform::IDENTITY,
            );
        } else if kind == 0 {
            piece.bare.add(
                &block(Vec3::new(0.15, 0.13, 0.2), 0.02, trim),
                at(hand.x, hand.y + 0.01, hand.z),
            );
            for (i, j) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
                let mouth = Vec3::new(hand.x + 0.035 * i, hand.y + 0.01 + 0.03 * j, hand.z - 0.09);
                piece.bare.add(
                    &strut(mouth, mouth - Vec3::Z * 0.035, [0.023, 0.021], 6, dark),
                    Transform::IDENTITY,
                );
            }
        } else {
            // A claw.
            for finger in [-1.0_f32, 0.0, 1.0] {
                let knuckle = hand
                    + Vec3::new(
                        0.035 * finger,
                        if finger == 0.0 { -0.035 } else { 0.02 },
                        -0.06,
                    );
                let tip = hand
                    + Vec3::new(
                        0.012 * finger,
                        if finger == 0.0 { -0.01 } else { 0.0 },
                        -0.14,
                    );
                piece.bare.add(
                    &strut(hand, knuckle, [0.02, 0.02], 5, dark),
                    Transform::IDENTITY,
                );
                piece.bare.add(
                    &strut(knuckle, tip, [0.02, 0.004], 5, trim),
                    Transform::IDENTITY,
                );
            }
        }
    }
}
