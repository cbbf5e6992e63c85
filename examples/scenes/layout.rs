//! Where a group's objects stand.

use core::f32::consts::TAU;

use bevy::prelude::*;

use super::{format::Layout, ground::Ground, noise::Stream};

/// Attempts at scattering before a group stays smaller than wanted.
const ATTEMPTS: u32 = 40_000;

/// Where an object stands.
pub struct Place {
    /// Its (x, z).
    pub at: Vec2,
    /// Where it looks, clockwise from −z (degrees).
    pub facing: f32,
}

/// Where a group's objects stand.
pub fn places(layout: &Layout, ground: &Ground, random: &mut Stream) -> Vec<Place> {
    match layout {
        Layout::Places(list) => list
            .iter()
            .map(|(x, z, facing)| Place {
                at: Vec2::new(*x, *z),
                facing: *facing,
            })
            .collect(),
        Layout::Ranks {
            center,
            count,
            spacing,
            facing,
        } => {
            let turn = Vec2::from_angle(facing.to_radians());
            let offset = |i: u32, of: u32, step: f32| (i as f32 - 0.5 * (of as f32 - 1.0)) * step;
            (0..count[0] * count[1])
                .map(|i| {
                    let straight = Vec2::new(
                        offset(i % count[0], count[0], spacing[0]),
                        offset(i / count[0], count[1], spacing[1]),
                    );
                    let jitter = Vec2::new(random.between(-0.1, 0.1), random.between(-0.1, 0.1));
                    Place {
                        at: Vec2::from_array(*center)
                            + turn.rotate(straight + jitter * Vec2::from_array(*spacing)),
                        facing: facing + random.between(-9.0, 9.0),
                    }
                })
                .collect()
        }
        Layout::Blocks {
            center,
            count,
            pitch,
            size,
            spacing,
        } => {
            let [center, pitch, size] = [center, pitch, size].map(|it| Vec2::from_array(*it));
            let all = UVec2::from_array(*count);
            (0..all.element_product())
                .flat_map(|i| {
                    let block = UVec2::new(i % all.x, i / all.x).as_vec2();
                    let middle = center + (block - 0.5 * (all.as_vec2() - 1.0)) * pitch;
                    around(size, *spacing).map(move |place| Place {
                        at: middle + place.at,
                        ..place
                    })
                })
                .collect()
        }
        Layout::Scatter {
            count,
            center,
            radius,
            apart,
            slope,
        } => {
            let mut list: Vec<Place> = Vec::new();
            let mut attempts = 0;
            while list.len() < *count as usize && attempts < ATTEMPTS {
                attempts += 1;
                let [near, far] = *radius;
                let out = near.hypot((random.next() * (far * far - near * near)).sqrt());
                let at =
                    Vec2::from_array(*center) + out * Vec2::from_angle(random.between(0.0, TAU));
                let height = |dx: f32, dz: f32| ground.height(at.x + dx, at.y + dz);
                let steep = Vec2::new(
                    height(3.0, 0.0) - height(-3.0, 0.0),
                    height(0.0, 3.0) - height(0.0, -3.0),
                );
                let free = list.iter().all(|other| other.at.distance(at) >= *apart);
                if free && steep.length() / 6.0 < *slope {
                    list.push(Place {
                        at,
                        facing: random.between(0.0, 360.0),
                    });
                }
            }
            list
        }
    }
}

/// Along the sides of a rectangle about the origin, looking out of it.
fn around(size: Vec2, spacing: f32) -> impl Iterator<Item = Place> {
    // Each side's direction, and where it looks.
    let sides = [
        (Vec2::X, 0.0),
        (Vec2::Y, 90.0),
        (Vec2::NEG_X, 180.0),
        (Vec2::NEG_Y, 270.0),
    ];
    sides.into_iter().flat_map(move |(along, facing)| {
        let length = (along * size).length();
        let count = (length / spacing).floor().max(1.0) as u32;
        // A quarter turn from the side's direction.
        let out = Vec2::new(along.y, -along.x);
        (0..count).map(move |i| Place {
            at: 0.5 * out * size + along * length * ((i as f32 + 0.5) / count as f32 - 0.5),
            facing,
        })
    })
}
