//! Knights.

use bevy::prelude::*;

use super::super::{
    mesh::{Body, shade},
    shapes::{ball, block, lathe, rod, sheet},
};
use super::{
    Finish, Model, Style, at, fixed,
    folk::{LEATHER, STEEL, WOOD, legs, limb},
};

/// Tall, in plate, with a plume, a lance with its pennon and a kite shield.
pub fn knight(style: Style) -> Model {
    let [cloth, trim] = style.colors;
    let n = style.segments;
    let few = style.fine(0.6);
    let dark = shade(STEEL, 0.55);
    let mut body = Body::default();
    let mut soft = Body::default();
    let cuirass = [
        (0.12, 0.45),
        (0.13, 0.48),
        (0.105, 0.53),
        (0.1, 0.55),
        (0.13, 0.62),
        (0.14, 0.68),
        (0.12, 0.74),
        (0.05, 0.77),
        (0.0, 0.775),
    ];
    body.add(
        &lathe(&cuirass, n, STEEL),
        at(0.0, 0.0, 0.0).with_scale(Vec3::new(1.0, 1.0, 0.78)),
    );
    let skirt = [(0.15, 0.34), (0.155, 0.36), (0.13, 0.45), (0.11, 0.5)];
    soft.add(
        &lathe(&skirt, n, cloth),
        at(0.0, 0.0, 0.0).with_scale(Vec3::new(1.0, 1.0, 0.8)),
    );
    soft.add(
        &lathe(
            &[(0.118, 0.5), (0.125, 0.51), (0.125, 0.53), (0.11, 0.54)],
            n,
            LEATHER,
        ),
        at(0.0, 0.0, 0.0).with_scale(Vec3::new(1.0, 1.0, 0.8)),
    );
    let helmet = [
        (0.05, 0.76),
        (0.06, 0.78),
        (0.075, 0.8),
        (0.08, 0.85),
        (0.078, 0.9),
        (0.06, 0.94),
        (0.03, 0.965),
        (0.0, 0.972),
    ];
    body.add(
        &lathe(&helmet, n, STEEL),
        at(0.0, 0.0, -0.01).with_scale(Vec3::new(0.9, 1.0, 1.0)),
    );
    body.add(
        &block(Vec3::new(0.1, 0.012, 0.03), 0.004, [0.05; 3]),
        at(0.0, 0.87, -0.078),
    );
    body.add(
        &block(Vec3::new(0.014, 0.13, 0.02), 0.004, dark),
        at(0.0, 0.85, -0.088),
    );
    let mut from = Vec3::new(0.0, 0.96, 0.0);
    for step in 0..7 {
        let to = from + Vec3::new(0.0, 0.02 - 0.012 * step as f32, 0.028);
        soft.add(
            &rod(
                from,
                to,
                [0.014 + 0.004 * step as f32, 0.018 + 0.003 * step as f32],
                few,
                trim,
            ),
            Transform::IDENTITY,
        );
        from = to;
    }
    for side in [-1.0, 1.0] {
        for plate in 0..3 {
            let y = 0.71 - 0.035 * plate as f32;
            let dome = lathe(
                &[
                    (0.075, 0.0),
                    (0.078, 0.012),
                    (0.06, 0.05),
                    (0.03, 0.068),
                    (0.0, 0.072),
                ],
                n,
                if plate == 1 { dark } else { STEEL },
            );
            body.add(
                &dome,
                at((0.145 + 0.012 * plate as f32) * side, y, 0.0)
                    .with_rotation(Quat::from_rotation_z(-0.5 * side)),
            );
        }
    }
    let cape = sheet([20, 20], 0.008, cloth, |u, v| {
        let (across, down) = (0.5 - u, 1.0 - v);
        let folds = 0.016 * (across * 26.0).sin() * down;
        Vec3::new(
            across * (0.2 + 0.16 * down),
            0.74 - 0.58 * down,
            0.105 + 0.08 * down * down + folds + 0.12 * (0.25 - across * across) * (0.3 + down),
        )
    });
    soft.add(&cape, Transform::IDENTITY);

    let mut parts = legs(Finish::Metal, 0.44, 0.065, 0.05, n, STEEL, dark);
    let upper = rod(
        Vec3::ZERO,
        Vec3::new(0.04, -0.15, 0.0),
        [0.042, 0.036],
        n,
        dark,
    );
    let lower = rod(
        Vec3::new(0.04, -0.15, 0.0),
        Vec3::new(0.04, -0.19, -0.14),
        [0.04, 0.034],
        n,
        STEEL,
    );
    let mut lance = rod(
        Vec3::new(0.04, -0.6, -0.14),
        Vec3::new(0.04, 0.75, -0.2),
        [0.014, 0.009],
        few,
        WOOD,
    );
    lance.add(
        &lathe(
            &[(0.012, -0.02), (0.05, 0.0), (0.035, 0.06), (0.012, 0.16)],
            n,
            STEEL,
        ),
        at(0.04, -0.13, -0.16),
    );
    lance.add(
        &lathe(&[(0.01, 0.0), (0.022, 0.03), (0.0, 0.13)], n, STEEL),
        at(0.04, 0.75, -0.2),
    );
    let pennon = sheet([16, 6], 0.003, trim, |u, v| {
        let tall = 0.1 * (1.0 - 0.8 * u);
        Vec3::new(
            0.05 + 0.26 * u,
            0.67 + (v - 0.5) * tall,
            -0.195 + 0.022 * (u * 8.0).sin() * u,
        )
    });
    lance.add(&pennon, Transform::IDENTITY);
    lance.add(
        &ball(n, dark),
        at(0.04, -0.195, -0.155).with_scale(Vec3::splat(0.038)),
    );
    parts.push(limb(
        [upper, lower, lance],
        Finish::Metal,
        Vec3::new(0.17, 0.69, 0.0),
        0.06,
        1.0,
    ));
    let upper = rod(
        Vec3::ZERO,
        Vec3::new(-0.03, -0.15, -0.01),
        [0.042, 0.036],
        n,
        dark,
    );
    let lower = rod(
        Vec3::new(-0.03, -0.15, -0.01),
        Vec3::new(-0.01, -0.2, -0.13),
        [0.04, 0.034],
        n,
        STEEL,
    );
    let mut shield = Body::default();
    let kite = sheet([14, 18], 0.014, trim, |u, v| {
        let (across, down) = (0.5 - u, 1.0 - v);
        let width = 0.27 * (1.0 - down.powf(2.4)).max(0.02);
        Vec3::new(
            across * width,
            0.13 - 0.44 * down,
            1.3 * (across * width).powi(2),
        )
    });
    for (half, center) in [
        (Vec2::new(0.014, 0.19), -0.07),
        (Vec2::new(0.085, 0.016), 0.02),
    ] {
        let band = sheet([8, 8], 0.012, STEEL, |u, v| {
            let (x, y) = ((1.0 - 2.0 * u) * half.x, center + (2.0 * v - 1.0) * half.y);
            Vec3::new(x, y, 1.3 * x * x - 0.004)
        });
        shield.add(&band, at(-0.04, -0.14, -0.17));
    }
    shield.add(&kite, at(-0.04, -0.14, -0.17));
    shield.add(
        &ball(n, STEEL),
        at(-0.04, -0.12, -0.185).with_scale(Vec3::new(0.035, 0.035, 0.02)),
    );
    parts.push(limb(
        [upper, lower, shield],
        Finish::Metal,
        Vec3::new(-0.17, 0.69, 0.0),
        0.1,
        2.4,
    ));
    parts.push(fixed(soft, Finish::Matte));
    Model {
        body,
        finish: Finish::Metal,
        parts,
    }
}
