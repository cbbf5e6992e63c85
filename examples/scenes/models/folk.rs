//! Dwarfs, and what they have in common with knights.

use core::f32::consts::{FRAC_PI_2, PI, TAU};

use bevy::prelude::*;

use super::super::{
    mesh::{Body, shade},
    shapes::{ball, block, lathe, rod},
};
use super::{Finish, Model, Part, Style, Turn, at};

const SKIN: [f32; 3] = [0.78, 0.57, 0.44];
pub(super) const STEEL: [f32; 3] = [0.62, 0.64, 0.68];
pub(super) const LEATHER: [f32; 3] = [0.3, 0.19, 0.11];
pub(super) const WOOD: [f32; 3] = [0.42, 0.29, 0.16];

/// A leg or arm that swings from its joint.
pub(super) fn limb(parts: [Body; 3], finish: Finish, joint: Vec3, swing: f32, phase: f32) -> Part {
    let mut body = Body::default();
    for part in &parts {
        body.add(part, Transform::IDENTITY);
    }
    Part {
        body,
        finish,
        joint: Transform::from_translation(joint),
        turn: Turn::Swing(Vec3::X, swing, 3.2, phase),
    }
}

/// Two legs from hips so high and so far apart.
pub(super) fn legs(
    finish: Finish,
    hip: f32,
    spread: f32,
    thick: f32,
    n: u32,
    cloth: [f32; 3],
    boot: [f32; 3],
) -> Vec<Part> {
    [-1.0_f32, 1.0]
        .map(|side| {
            let thigh = rod(
                Vec3::ZERO,
                Vec3::Y * -hip * 0.5,
                [thick, thick * 0.85],
                n,
                cloth,
            );
            let shin = rod(
                Vec3::Y * -hip * 0.5,
                Vec3::Y * -hip * 0.92,
                [thick * 0.95, thick * 0.7],
                n,
                boot,
            );
            let mut foot = Body::default();
            foot.add(
                &ball(n, boot),
                at(0.0, -hip + thick * 0.5, -thick * 0.7).with_scale(Vec3::new(
                    thick * 0.8,
                    thick * 0.55,
                    thick * 1.6,
                )),
            );
            limb(
                [thigh, shin, foot],
                finish,
                Vec3::new(spread * side, hip, 0.0),
                0.45,
                if side > 0.0 { 0.0 } else { PI },
            )
        })
        .into()
}

fn round_shield(n: u32, color: [f32; 3]) -> Body {
    let mut shield = lathe(
        &[
            (0.0, -0.01),
            (0.14, -0.006),
            (0.155, 0.0),
            (0.155, 0.012),
            (0.14, 0.018),
            (0.14, 0.018),
            (0.05, 0.03),
            (0.05, 0.03),
            (0.04, 0.05),
            (0.0, 0.06),
        ],
        n,
        color,
    );
    for i in 0..10 {
        let turn = Quat::from_rotation_y(TAU * i as f32 / 10.0);
        shield.add(
            &ball(n / 3, STEEL),
            Transform::from_translation(turn * Vec3::new(0.0, 0.016, 0.147))
                .with_scale(Vec3::splat(0.01)),
        );
    }
    shield
}

/// Short and broad, with a beard, a horned helmet, an axe and a round shield.
pub fn dwarf(style: Style) -> Model {
    let [cloth, beard] = style.colors;
    let n = style.segments;
    let few = style.fine(0.6);
    let mut body = Body::default();
    let tunic = [
        (0.19, 0.24),
        (0.23, 0.27),
        (0.24, 0.36),
        (0.225, 0.43),
        (0.225, 0.46),
        (0.24, 0.56),
        (0.22, 0.64),
        (0.1, 0.7),
        (0.0, 0.71),
    ];
    body.add(
        &lathe(&tunic, n, cloth),
        at(0.0, 0.0, 0.0).with_scale(Vec3::new(1.0, 1.0, 0.82)),
    );
    let belt = [(0.225, 0.42), (0.24, 0.43), (0.24, 0.47), (0.225, 0.48)];
    body.add(
        &lathe(&belt, n, LEATHER),
        at(0.0, 0.0, 0.0).with_scale(Vec3::new(1.0, 1.0, 0.83)),
    );
    body.add(
        &block(Vec3::new(0.07, 0.06, 0.02), 0.008, [0.8, 0.65, 0.25]),
        at(0.0, 0.45, -0.2),
    );
    body.add(
        &ball(n, SKIN),
        at(0.0, 0.79, -0.01).with_scale(Vec3::new(0.12, 0.12, 0.115)),
    );
    body.add(
        &ball(few, SKIN),
        at(0.0, 0.78, -0.13).with_scale(Vec3::new(0.03, 0.026, 0.035)),
    );
    for strand in 0..13 {
        let t = strand as f32 / 6.0 - 1.0;
        let root = Vec3::new(0.095 * t, 0.745 + 0.02 * t.abs(), -0.085 + 0.035 * t.abs());
        let tip = Vec3::new(0.12 * t, 0.47 + 0.13 * t.abs(), -0.21 + 0.06 * t.abs());
        body.add(
            &rod(
                root,
                tip,
                [0.036, 0.01],
                few,
                shade(beard, 0.9 + 0.1 * (strand % 3) as f32),
            ),
            Transform::IDENTITY,
        );
    }
    body.add(
        &lathe(
            &[
                (0.135, 0.8),
                (0.14, 0.83),
                (0.13, 0.84),
                (0.115, 0.9),
                (0.06, 0.955),
                (0.0, 0.97),
            ],
            n,
            STEEL,
        ),
        Transform::IDENTITY,
    );
    for side in [-1.0, 1.0] {
        let mut from = Vec3::new(0.12 * side, 0.87, 0.0);
        for step in 0..5 {
            let angle = 0.2 + 0.32 * step as f32;
            let to = from + Vec3::new(0.035 * side * angle.cos(), 0.035 * angle.sin(), -0.006);
            let r = |s: i32| 0.026 * (1.0 - s as f32 / 5.5);
            body.add(
                &rod(from, to, [r(step), r(step + 1)], few, [0.85, 0.8, 0.68]),
                Transform::IDENTITY,
            );
            from = to;
        }
        body.add(
            &ball(n, STEEL),
            at(0.23 * side, 0.63, 0.0).with_scale(Vec3::new(0.09, 0.07, 0.1)),
        );
    }
    let mut parts = legs(
        Finish::Satin,
        0.27,
        0.1,
        0.075,
        n,
        shade(cloth, 0.6),
        LEATHER,
    );
    let upper = rod(
        Vec3::ZERO,
        Vec3::new(0.05, -0.16, -0.03),
        [0.06, 0.052],
        n,
        cloth,
    );
    let lower = rod(
        Vec3::new(0.05, -0.16, -0.03),
        Vec3::new(0.06, -0.24, -0.16),
        [0.052, 0.045],
        n,
        SKIN,
    );
    let mut axe = rod(
        Vec3::new(0.06, -0.5, -0.14),
        Vec3::new(0.06, 0.34, -0.22),
        [0.014, 0.014],
        few,
        WOOD,
    );
    for side in [-1.0, 1.0] {
        let blade = block(Vec3::new(1.0, 1.0, 1.0), 0.1, STEEL).bent(|p| {
            let reach = p.z + 0.5;
            Vec3::new(
                p.x * (0.024 - 0.02 * reach),
                p.y * (0.07 + 0.17 * reach * reach),
                side * reach * 0.13,
            )
        });
        axe.add(&blade, at(0.06, 0.27, -0.213));
    }
    axe.add(
        &ball(n, SKIN),
        at(0.06, -0.25, -0.17).with_scale(Vec3::splat(0.048)),
    );
    parts.push(limb(
        [upper, lower, axe],
        Finish::Satin,
        Vec3::new(0.25, 0.62, 0.0),
        0.12,
        0.4,
    ));
    let upper = rod(
        Vec3::ZERO,
        Vec3::new(-0.06, -0.15, -0.03),
        [0.06, 0.052],
        n,
        cloth,
    );
    let lower = rod(
        Vec3::new(-0.06, -0.15, -0.03),
        Vec3::new(-0.03, -0.19, -0.17),
        [0.052, 0.045],
        n,
        SKIN,
    );
    let mut shield = Body::default();
    shield.add(
        &round_shield(n, shade(cloth, 1.3)),
        at(-0.05, -0.18, -0.22).with_rotation(Quat::from_rotation_x(-FRAC_PI_2)),
    );
    parts.push(limb(
        [upper, lower, shield],
        Finish::Satin,
        Vec3::new(-0.25, 0.62, 0.0),
        0.12,
        2.0,
    ));
    Model {
        body,
        finish: Finish::Satin,
        parts,
    }
}
