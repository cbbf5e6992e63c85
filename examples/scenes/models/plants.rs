//! Trees and cacti.

use core::f32::consts::TAU;

use bevy::prelude::*;

use super::super::{
    mesh::{Body, shade},
    noise::{Stream, fractal},
    shapes::{ball, icosphere, lathe, tube},
};
use super::{Finish, Model, Style, at, resting};

/// What a growing tree needs to know.
struct Growth {
    random: Stream,
    style: Style,
    body: Body,
}

/// A trunk on spread roots that forks three times, with leaves in clumps at the ends.
pub fn tree(style: Style) -> Model {
    let bark = style.colors[1];
    let mut growth = Growth {
        random: Stream::new(style.seed),
        style,
        body: Body::default(),
    };
    let lean = Vec3::new(
        growth.random.between(-0.06, 0.06),
        0.0,
        growth.random.between(-0.06, 0.06),
    );
    let trunk: Vec<(Vec3, Vec2)> = [
        (0.0, 0.05),
        (0.025, 0.037),
        (0.08, 0.031),
        (0.2, 0.027),
        (0.34, 0.023),
    ]
    .iter()
    .map(|(y, r)| (Vec3::Y * *y + lean * (y * 6.0).sin(), Vec2::splat(*r)))
    .collect();
    growth.body.add(
        &tube(&trunk, Vec3::X, style.segments, bark),
        Transform::IDENTITY,
    );
    for root in 0..5 {
        let out = Vec3::new((root as f32 * 1.26).cos(), 0.0, (root as f32 * 1.26).sin());
        let path = [
            (Vec3::Y * 0.05 + out * 0.02, Vec2::new(0.016, 0.014)),
            (Vec3::Y * 0.012 + out * 0.06, Vec2::new(0.013, 0.011)),
            (Vec3::Y * -0.012 + out * 0.105, Vec2::new(0.006, 0.005)),
        ];
        growth.body.add(
            &tube(&path, Vec3::Y, style.fine(0.5), bark),
            Transform::IDENTITY,
        );
    }
    let top = trunk.last().map_or(Vec3::ZERO, |(place, _)| *place);
    growth.branch(top, Vec3::Y + lean, 0.17, 0.022, 3);
    resting(growth.body, Finish::Matte)
}

impl Growth {
    fn branch(&mut self, from: Vec3, along: Vec3, length: f32, radius: f32, forks: u32) {
        let bark = self.style.colors[1];
        let to = from + along * length;
        let sag = Vec3::new(
            self.random.between(-0.1, 0.1),
            0.08,
            self.random.between(-0.1, 0.1),
        ) * length;
        let path = [
            (from - along * length * 0.04, Vec2::splat(radius)),
            (from.lerp(to, 0.35) + sag, Vec2::splat(radius * 0.85)),
            (from.lerp(to, 0.7) + sag * 0.7, Vec2::splat(radius * 0.72)),
            (to, Vec2::splat(radius * 0.6)),
        ];
        self.body.add(
            &tube(&path, Vec3::X, self.style.fine(0.5), bark),
            Transform::IDENTITY,
        );
        if forks <= 1 {
            self.leaves(to, along, forks);
        }
        if forks == 0 {
            return;
        }
        let turn = self.random.between(0.0, TAU);
        for branch in 0..3 {
            let around = turn + TAU * branch as f32 / 3.0 + self.random.between(-0.4, 0.4);
            let side = Vec3::new(around.cos(), self.random.between(0.0, 0.3), around.sin());
            let next = (along * 0.85 + side).normalize_or(Vec3::Y);
            let shorter = length * self.random.between(0.66, 0.86);
            self.branch(to, next, shorter, radius * 0.6, forks - 1);
        }
    }

    /// A ragged clump, flattened, lighter on top.
    fn leaves(&mut self, place: Vec3, along: Vec3, forks: u32) {
        let seed = (self.random.next() * 1e6) as u64;
        let size = self.random.between(0.8, 1.25) * if forks == 0 { 0.085 } else { 0.065 };
        let tone = self.random.between(0.8, 1.15);
        let leaf = self.style.colors[0];
        let clump = icosphere(self.style.fine(0.34), leaf)
            .bent(|p| {
                let bumps = fractal(p.x * 2.6 + p.z, p.y * 2.6 - p.z, seed, 2);
                let ragged = fractal(p.x * 7.0 - p.y, p.z * 7.0 + p.y * 3.0, seed + 5, 2);
                p * (1.0 + 0.35 * bumps + 0.22 * ragged) * Vec3::new(1.0, 0.72, 1.0)
            })
            .tinted(|p| {
                let speckle = fractal(p.x * 9.0 + p.y * 5.0, p.z * 9.0 - p.y, seed + 9, 2);
                shade(leaf, tone * (0.86 + 0.3 * p.y + 0.28 * speckle))
            });
        self.body.add(
            &clump,
            Transform::from_translation(place + along * 0.02).with_scale(Vec3::splat(size)),
        );
    }
}

/// A ribbed column with arms that bend upwards.
pub fn cactus(style: Style) -> Model {
    let [green, tip] = style.colors;
    let mut random = Stream::new(style.seed);
    let mut body = Body::default();
    column(
        &mut body,
        style,
        &[Vec3::ZERO, Vec3::Y * 0.5, Vec3::Y * 0.94],
        0.085,
        green,
    );
    body.add(
        &ball(style.fine(0.5), tip),
        at(0.0, 1.0, 0.0).with_scale(Vec3::splat(0.03)),
    );
    for arm in 0..3 {
        let around = TAU * arm as f32 / 3.0 + random.between(-0.5, 0.5);
        let out = Vec3::new(around.cos(), 0.0, around.sin());
        let root = Vec3::Y * random.between(0.35, 0.55);
        let elbow = root + out * random.between(0.18, 0.24) + Vec3::Y * 0.04;
        let end = elbow + Vec3::Y * random.between(0.15, 0.32);
        column(
            &mut body,
            style,
            &[root, elbow, end],
            0.055,
            shade(green, 0.95),
        );
        body.add(
            &ball(style.fine(0.5), tip),
            Transform::from_translation(end + Vec3::Y * 0.05).with_scale(Vec3::splat(0.02)),
        );
    }
    resting(body, Finish::Matte)
}

/// Ribbed rods along a line of points.
fn column(body: &mut Body, style: Style, points: &[Vec3], radius: f32, color: [f32; 3]) {
    for pair in points.windows(2) {
        let length = pair[0].distance(pair[1]);
        let steps = 8;
        let mut profile = vec![(0.0, -radius * 0.9), (radius * 0.7, -radius * 0.6)];
        profile.extend((0..=steps).map(|i| (radius, length * i as f32 / steps as f32)));
        profile.extend([
            (radius * 0.75, length + radius * 0.6),
            (0.0, length + radius * 0.85),
        ]);
        let ribbed = lathe(&profile, style.segments * 2, color).bent(|p| {
            let rib = 1.0 + 0.09 * (p.z.atan2(p.x) * 12.0).cos();
            Vec3::new(p.x * rib, p.y, p.z * rib)
        });
        let turn = Quat::from_rotation_arc(Vec3::Y, (pair[1] - pair[0]) / length);
        body.add(
            &ribbed,
            Transform::from_translation(pair[0]).with_rotation(turn),
        );
    }
}
