//! A day of minutes.

use core::f32::consts::TAU;

use bevy::prelude::*;

use crate::scene::SceneSun;

/// Elevation of the sun at noon (degrees).
const NOON: f32 = 62.0;
/// The sun's light comes and goes while it is this near to the horizon (sine of its elevation).
const TWILIGHT: f32 = 0.06;
/// What time it is, if the sun goes by that.
#[derive(Resource, Debug)]
pub struct Day {
    /// From 0 to 24.
    pub hour: Option<f32>,
    /// How long a day lasts.
    pub minutes: f32,
}

impl Default for Day {
    fn default() -> Self {
        Self {
            hour: None,
            minutes: 2.0,
        }
    }
}

impl Day {
    /// Begins in the morning, or ends.
    pub fn toggle(&mut self) {
        self.hour = match self.hour {
            None => Some(7.0),
            Some(_) => None,
        };
    }
}

/// Towards the sun: it rises in the east at six.
fn to_sun(hour: f32) -> Vec3 {
    let (sin, cos) = ((hour - 12.0) / 24.0 * TAU).sin_cos();
    let (height, south) = NOON.to_radians().sin_cos();
    Vec3::new(-sin, cos * height, cos * south)
}

/// Has the sun follow the time. Below the horizon it has no light, and the plugin nothing to do.
pub fn pass_time(
    time: Res<Time>,
    mut day: ResMut<Day>,
    mut suns: Query<(&SceneSun, &mut Transform, &mut DirectionalLight)>,
) {
    if day.is_changed() && day.hour.is_none() {
        for (sun, mut transform, mut light) in &mut suns {
            *transform = sun.transform();
            light.illuminance = sun.description.illuminance;
        }
    }
    let Some(hour) = day.hour else {
        return;
    };
    let pace = 24.0 / (60.0 * day.minutes);
    let hour = (hour + pace * time.delta_secs()).rem_euclid(24.0);
    day.hour = Some(hour);
    let to_sun = to_sun(hour);
    for (sun, mut transform, mut light) in &mut suns {
        transform.look_to(-to_sun, Vec3::Y);
        light.illuminance = sun.description.illuminance * (to_sun.y / TWILIGHT).clamp(0.0, 1.0);
    }
}
