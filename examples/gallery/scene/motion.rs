//! What moves, by the time alone.

use bevy::prelude::*;

use super::{
    format::{Motion, SunDescription},
    ground::Ground,
    models::Turn,
    spawn::Sky,
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

/// Where a walker's circle lies and where on it the walk begins.
#[derive(Component, Debug, Clone, Copy)]
pub struct Walker {
    pub centre: Vec2,
    pub start: f32,
}

pub(super) fn animate(
    time: Res<Time>,
    ground: Option<Res<Ground>>,
    mut walkers: Query<(&Motion, &Walker, &mut Transform), Without<Turn>>,
    mut parts: Query<(&Turn, &mut Transform)>,
) {
    let now = time.elapsed_secs();
    for (motion, walker, mut transform) in &mut walkers {
        let (Motion::Walk { radius, speed }, Some(ground)) = (*motion, ground.as_ref()) else {
            continue;
        };
        let angle = walker.start + now * speed / radius;
        let place = walker.centre + radius * Vec2::from_angle(angle);
        let bob = 0.02 * transform.scale.y * (now * 6.4).sin().abs();
        transform.translation = Vec3::new(place.x, ground.height(place.x, place.y) + bob, place.y);
        // Models face −z; the walk goes along the circle.
        transform.rotation = Quat::from_rotation_y(-angle + core::f32::consts::PI);
    }
    for (turn, mut transform) in &mut parts {
        transform.rotation = match *turn {
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

/// The sky is a dome around the camera.
pub(super) fn carry_sky(
    cameras: Query<&GlobalTransform, With<Camera3d>>,
    mut skies: Query<&mut Transform, With<Sky>>,
) {
    if let Some(camera) = cameras.iter().next() {
        for mut sky in &mut skies {
            sky.translation = camera.translation();
        }
    }
}
