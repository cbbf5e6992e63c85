//! Wind pumps.

use core::f32::consts::{FRAC_PI_2, TAU};

use bevy::prelude::*;

use super::super::{
    mesh::{Body, shade},
    shapes::{block, lathe},
};
use super::{
    Finish, Model, Part, Style, Turn, at,
    mine::{bar, put},
};

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
        let (lo, hi) = (
            level as f32 / levels as f32,
            (level + 1) as f32 / levels as f32,
        );
        for i in 0..4 {
            bar(
                &mut body,
                corner(lo, i),
                corner(hi, i),
                [0.008, 0.008],
                n,
                color,
            );
            bar(
                &mut body,
                corner(hi, i),
                corner(hi, i + 1),
                [0.004, 0.004],
                n,
                color,
            );
            bar(
                &mut body,
                corner(lo, i),
                corner(hi, i + 1),
                [0.0035, 0.0035],
                n,
                color,
            );
        }
    }
    put(
        &mut body,
        &block(Vec3::new(0.05, 0.05, 0.14), 0.012, trim),
        at(0.0, 0.82, 0.0),
    );
    bar(
        &mut body,
        Vec3::new(0.0, 0.82, 0.05),
        Vec3::new(0.0, 0.83, 0.26),
        [0.008, 0.006],
        n,
        trim,
    );
    put(
        &mut body,
        &block(Vec3::new(0.006, 0.11, 0.13), 0.002, trim),
        at(0.0, 0.84, 0.3),
    );
    for i in 0..4 {
        put(
            &mut body,
            &block(Vec3::new(0.05, 0.03, 0.05), 0.01, shade(color, 0.6)),
            Transform::from_translation(corner(0.0, i)),
        );
    }

    let mut wheel = Body::default();
    put(
        &mut wheel,
        &lathe(
            &[(0.03, -0.03), (0.035, 0.0), (0.02, 0.04), (0.0, 0.05)],
            style.segments,
            trim,
        ),
        Transform::from_rotation(Quat::from_rotation_x(-FRAC_PI_2)),
    );
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
        bar(
            &mut wheel,
            turn * Vec3::Y * 0.15,
            next * Vec3::Y * 0.15,
            [0.003, 0.003],
            6,
            trim,
        );
    }
    Model {
        body,
        finish: Finish::Metal,
        parts: vec![Part {
            body: wheel,
            finish: Finish::Satin,
            joint: at(0.0, 0.82, -0.1),
            turn: Turn::Spin(Vec3::Z, 0.9),
        }],
    }
}
