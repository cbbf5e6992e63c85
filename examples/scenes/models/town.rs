//! A town's houses and street lamps.

use core::f32::consts::PI;

use bevy::prelude::*;

use super::super::{
    mesh::{Body, shade},
    noise::Stream,
    shapes::{block, crate_box},
};
use super::{
    Finish, Model, Style, at,
    mine::{bar, put},
    resting,
};

/// Half a house's width and depth.
const HALF: Vec2 = Vec2::new(0.36, 0.25);
/// Where its roof begins.
const EAVES: f32 = 0.74;
/// Windows side by side.
const WINDOWS: u32 = 4;

/// A house of three to five stories with sills, balconies and chimneys.
pub fn house(style: Style) -> Model {
    let [color, trim] = style.colors;
    let mut random = Stream::new(style.seed);
    let color = shade(color, random.between(0.8, 1.1));
    let roof = shade([0.5, 0.26, 0.2], random.between(0.8, 1.2));
    let stories = 3 + style.variant % 3;
    let story = (EAVES - 0.04) / stories as f32;
    let mut body = crate_box(Vec3::new(2.0 * HALF.x, EAVES, 2.0 * HALF.y), color)
        .moved(Vec3::Y * (0.5 * EAVES));
    let rise = 1.0 - EAVES;
    let gable = crate_box(Vec3::new(2.0 * HALF.x + 0.03, rise, 2.0), roof)
        .carved(|p| p.with_z(p.z * (0.02 + (HALF.y + 0.03) * (0.5 - p.y / rise))));
    put(&mut body, &gable, at(0.0, EAVES + 0.5 * rise, 0.0));
    for side in [-1.0, 1.0] {
        let ledge = crate_box(Vec3::new(2.0 * HALF.x, 0.012, 0.03), trim);
        put(&mut body, &ledge, at(0.0, EAVES - 0.02, side * HALF.y));
        put(
            &mut body,
            &block(Vec3::new(0.06, 0.16, 0.04), 0.004, shade(roof, 0.8)),
            at(side * random.between(0.1, 0.28), 0.95, 0.07 * side),
        );
        for level in 0..stories {
            for window in 0..WINDOWS {
                let x = (window as f32 - 0.5 * (WINDOWS as f32 - 1.0)) * 0.17;
                let y = 0.04 + (level as f32 + 0.5) * story;
                let place = Transform::from_xyz(x, y, side * HALF.y);
                put(&mut body, &pane(0.5 * story, trim), place);
                let is_middle = window == 1 || window == 2;
                if level > 0 && is_middle && random.next() < 0.5 {
                    let turn = Quat::from_rotation_y(if side < 0.0 { 0.0 } else { PI });
                    put(&mut body, &balcony(story, trim), place.with_rotation(turn));
                }
            }
        }
    }
    resting(body, Finish::Matte)
}

/// A window in its frame, on both sides of z = 0.
fn pane(height: f32, trim: [f32; 3]) -> Body {
    let glass = [0.16, 0.19, 0.23];
    let mut body = crate_box(Vec3::new(0.07, height, 0.004), glass);
    for side in [-1.0, 1.0] {
        let jamb = crate_box(Vec3::new(0.008, height, 0.012), trim);
        put(&mut body, &jamb, at(0.039 * side, 0.0, 0.0));
        let depth = if side < 0.0 { 0.028 } else { 0.014 };
        let sill = crate_box(Vec3::new(0.094, 0.008, depth), trim);
        put(
            &mut body,
            &sill,
            at(0.0, 0.5 * side * (height + 0.008), 0.0),
        );
    }
    body
}

/// A slab with a railing, towards −z, under the middle of a window.
fn balcony(story: f32, trim: [f32; 3]) -> Body {
    let (depth, rail) = (0.08, 0.07);
    let iron = [0.12, 0.13, 0.13];
    let floor = -0.32 * story;
    let mut body =
        crate_box(Vec3::new(0.13, 0.01, depth), trim).moved(Vec3::new(0.0, floor, -0.5 * depth));
    let post = |x: f32, z: f32| {
        crate_box(Vec3::new(0.0025, rail, 0.0025), iron).moved(Vec3::new(x, floor + 0.5 * rail, z))
    };
    for i in 0..=10 {
        let x = 0.012 * (i as f32 - 5.0);
        body.add(&post(x, -depth), Transform::IDENTITY);
    }
    for side in [-1.0, 1.0] {
        for i in 1..6 {
            let z = -depth * i as f32 / 6.0;
            body.add(&post(0.06 * side, z), Transform::IDENTITY);
        }
        let along = crate_box(Vec3::new(0.004, 0.004, depth), iron);
        put(
            &mut body,
            &along,
            at(0.06 * side, floor + rail, -0.5 * depth),
        );
    }
    let across = crate_box(Vec3::new(0.124, 0.004, 0.004), iron);
    put(&mut body, &across, at(0.0, floor + rail, -depth));
    body
}

/// A lamp on a bent post, over what it faces.
pub fn lamp(style: Style) -> Model {
    let [color, glass] = style.colors;
    let n = style.fine(0.6);
    let mut body = block(Vec3::new(0.05, 0.06, 0.05), 0.01, color).moved(Vec3::Y * 0.03);
    bar(
        &mut body,
        Vec3::Y * 0.05,
        Vec3::Y * 0.92,
        [0.014, 0.009],
        n,
        color,
    );
    let tip = Vec3::new(0.0, 0.99, -0.2);
    bar(&mut body, Vec3::Y * 0.92, tip, [0.009, 0.007], n, color);
    put(
        &mut body,
        &block(Vec3::new(0.05, 0.025, 0.1), 0.008, glass),
        Transform::from_translation(tip),
    );
    resting(body, Finish::Metal)
}
