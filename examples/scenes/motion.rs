//! What moves, by the time alone.

use core::f32::consts::{PI, TAU};

use bevy::prelude::*;

use super::{
    format::{Motion, SunDescription},
    ground::Ground,
    models::Turn,
    sky::Sky,
};

/// Whether the sun wanders.
#[derive(Resource, Debug, Default, Clone, Copy)]
pub struct MovingSun(pub bool);

/// The scene's sun, which knows where it stands.
#[derive(Component, Debug, Clone)]
pub struct SceneSun {
    /// From the scene.
    pub description: SunDescription,
    /// How far it has wandered (degrees).
    pub wandered: f32,
}

impl SceneSun {
    /// The light's transform.
    pub fn transform(&self) -> Transform {
        let azimuth = (self.description.azimuth + self.wandered).to_radians();
        let (height, reach) = self.description.elevation.to_radians().sin_cos();
        let to_sun = Vec3::new(azimuth.sin() * reach, height, -azimuth.cos() * reach);
        Transform::default().looking_to(-to_sun, Vec3::Y)
    }
}

/// Where a walk goes.
#[derive(Component, Debug, Clone, Copy)]
pub struct Walker {
    /// A point of the walk (x, z).
    pub home: Vec2,
    /// Direction of the first steps, clockwise from −z (radians).
    pub facing: f32,
    /// How much of a round is over at the start, 0 to 1.
    pub start: f32,
}

impl Walker {
    /// Place and facing after some seconds, if the motion is a walk.
    pub fn step(&self, motion: Motion, seconds: f32) -> Option<(Vec2, f32)> {
        // Ahead and to the right of who starts.
        let ahead = Vec2::new(self.facing.sin(), -self.facing.cos());
        let right = ahead.perp();
        let (place, turned) = match motion {
            Motion::Walk { radius, speed } => {
                let angle = TAU * self.start + seconds * speed / radius;
                (Vec2::new(1.0 - angle.cos(), angle.sin()) * radius, angle)
            }
            Motion::March {
                length,
                radius,
                speed,
            } => {
                let round = 2.0 * length + TAU * radius;
                let done = (self.start * round + seconds * speed).rem_euclid(round);
                let arc = PI * radius;
                let bow = |angle: f32| Vec2::new(1.0 - angle.cos(), angle.sin()) * radius;
                if done < length {
                    (Vec2::new(0.0, done), 0.0)
                } else if done < length + arc {
                    let angle = (done - length) / radius;
                    (bow(angle) + Vec2::new(0.0, length), angle)
                } else if done < 2.0 * length + arc {
                    (Vec2::new(2.0 * radius, 2.0 * length + arc - done), PI)
                } else {
                    let angle = PI + (done - 2.0 * length - arc) / radius;
                    (bow(angle), angle)
                }
            }
            Motion::Still | Motion::Parts { .. } => return None,
        };
        Some((
            self.home + right * place.x + ahead * place.y,
            self.facing + turned,
        ))
    }
}

/// How fast a part turns, against its model's own speed.
#[derive(Component, Debug, Clone, Copy)]
pub struct Rate(pub f32);

pub(super) fn animate(
    time: Res<Time>,
    ground: Option<Res<Ground>>,
    mut walkers: Query<(&Motion, &Walker, &mut Transform), Without<Turn>>,
    mut parts: Query<(&Turn, &Rate, &mut Transform)>,
) {
    let now = time.elapsed_secs();
    for (motion, walker, mut transform) in &mut walkers {
        let (Some((place, facing)), Some(ground)) = (walker.step(*motion, now), ground.as_ref())
        else {
            continue;
        };
        transform.translation = Vec3::new(place.x, ground.height(place.x, place.y), place.y);
        transform.rotation = Quat::from_rotation_y(-facing);
    }
    for (turn, rate, mut transform) in &mut parts {
        let now = now * rate.0;
        transform.rotation = match *turn {
            Turn::Rest => continue,
            Turn::Spin(axis, speed) => Quat::from_axis_angle(axis, now * speed),
            Turn::Swing(axis, amplitude, speed, phase) => {
                Quat::from_axis_angle(axis, amplitude * (now * speed + phase).sin())
            }
        };
    }
}

pub(super) fn move_sun(
    time: Res<Time>,
    moving: Res<MovingSun>,
    mut suns: Query<(&mut SceneSun, &mut Transform)>,
) {
    if moving.0 {
        for (mut sun, mut transform) in &mut suns {
            sun.wandered += sun.description.degrees_per_second * time.delta_secs();
            *transform = sun.transform();
        }
    }
}

/// The sky is a dome around the camera, and its glow is where the sun is.
pub(super) fn carry_sky(
    cameras: Query<&Transform, (With<Camera3d>, Without<Sky>)>,
    suns: Query<&SceneSun>,
    mut skies: Query<&mut Transform, With<Sky>>,
) {
    let wandered = suns
        .iter()
        .next()
        .map_or(0.0, |sun| sun.wandered.to_radians());
    if let Some(camera) = cameras.iter().next() {
        for mut sky in &mut skies {
            sky.translation = camera.translation;
            sky.rotation = Quat::from_rotation_y(-wandered);
        }
    }
}
