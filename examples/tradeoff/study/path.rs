//! The ways that cameras go, and suns.

use bevy::{
    math::{DQuat, DVec3},
    prelude::*,
};

use super::studio::Stance;

/// Frames of a path.
pub const FRAMES: usize = 600;
/// … in a second.
pub const RATE: f32 = 60.0;
/// The first of those that are looked at whatever happens.
const FIRST: usize = 60;
/// Frames between cuts.
const PERIOD: usize = 120;
/// Frames between those that are looked at whatever happens while the sun moves: its steps are many and small.
const SUN_PERIOD: usize = 18;
/// No camera comes nearer to the ground than this (meters).
const LEAST_HEIGHT: f32 = 2.0;

/// What a camera does, for ten seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Path {
    /// Nothing.
    Rest,
    /// Goes ahead over the ground for five seconds, then back (meters per second).
    Ahead(f32),
    /// The same, while the sun goes up (degrees per second).
    UnderSun(f32, f32),
    /// Turns to the left (degrees per second).
    Turn(f32),
    /// Looks down to its feet and back to the horizon, every four seconds.
    LookDown,
    /// Zooms in to a third of the view, and out again.
    Zoom,
    /// Cuts from pose to pose, at three frames of which each is looked at.
    Cuts,
}

impl Path {
    /// All under a sun that rests, with their names in tables.
    pub const ALL: [(&'static str, Self); 9] = [
        ("rest", Self::Rest),
        ("walk, 1.5 m/s", Self::Ahead(1.5)),
        ("run, 6 m/s", Self::Ahead(6.0)),
        ("drive, 50 m/s", Self::Ahead(50.0)),
        ("turn, 30°/s", Self::Turn(30.0)),
        ("turn, 90°/s", Self::Turn(90.0)),
        ("look down and up", Self::LookDown),
        ("zoom", Self::Zoom),
        ("three cuts", Self::Cuts),
    ];

    /// Under a sun that rests and one that moves, over points chosen alike.
    pub const UNDER_SUNS: [(&'static str, Self); 2] = [
        ("walk, sun at rest", Self::UnderSun(1.5, 0.0)),
        ("walk, sun 0.3°/s", Self::UnderSun(1.5, 0.3)),
    ];

    /// How closely it is looked at: at one of so many frames.
    pub fn looks(self, every: usize) -> Looks {
        let (period, most_changes, stride) = match self {
            Self::UnderSun(..) => (SUN_PERIOD, 30, 1),
            // Those after cuts are among them.
            Self::Cuts => (PERIOD, 4, 2),
            _ => (every, 4, 2),
        };
        Looks {
            frames: (FIRST..FRAMES).step_by(period).collect(),
            most_changes,
            stride,
        }
    }

    /// How camera and sun stand at a frame. `ground` is its height at (x, z).
    pub fn stance(
        self,
        poses: &[Stance],
        frame: usize,
        ground: &dyn Fn(f32, f32) -> f32,
    ) -> Stance {
        let seconds = frame as f32 / RATE;
        let whole = FRAMES as f32 / RATE;
        let there_and_back = whole / 2.0 - (seconds - whole / 2.0).abs();
        let mut stance = poses[0].clone();
        let camera = &mut stance.camera;
        if let Self::UnderSun(_, speed) = self {
            let degrees = speed * (seconds - whole / 2.0);
            let rise = rise(stance.sun.back().as_dvec3(), f64::from(degrees));
            stance.sun.rotate(rise.as_quat());
        }
        match self {
            Self::Rest => (),
            Self::Ahead(speed) | Self::UnderSun(speed, _) => {
                let forward = *camera.forward() * Vec3::new(1.0, 0.0, 1.0);
                camera.translation += forward.normalize_or(Vec3::NEG_Z) * (speed * there_and_back);
                let floor = ground(camera.translation.x, camera.translation.z) + LEAST_HEIGHT;
                camera.translation.y = camera.translation.y.max(floor);
            }
            Self::Turn(speed) => camera.rotate_y((speed * seconds).to_radians()),
            Self::LookDown => {
                let (yaw, _, _) = camera.rotation.to_euler(EulerRot::YXZ);
                let pitch = -40.0 * (1.0 - (seconds * core::f32::consts::FRAC_PI_2).cos());
                camera.rotation = Quat::from_euler(EulerRot::YXZ, yaw, pitch.to_radians(), 0.0);
            }
            Self::Zoom => {
                if let Projection::Perspective(lens) = &mut stance.projection {
                    let share = 1.0 / (1.0 + 2.0 * there_and_back / (whole / 2.0));
                    lens.fov = 2.0 * ((0.5 * lens.fov).tan() * share).atan();
                }
            }
            Self::Cuts => {
                let done = (1..=3).filter(|cut| frame >= Self::cut(*cut)).count();
                return poses[done % poses.len()].clone();
            }
        }
        stance
    }

    /// The frame of a cut: the one after it is among those looked at.
    fn cut(index: usize) -> usize {
        FIRST + PERIOD * index - 1
    }

    pub fn is_cut(self, frame: usize) -> bool {
        self == Self::Cuts && (1..=3).any(|index| Self::cut(index) == frame)
    }
}

/// How a sun turns as it goes up.
pub fn rise(to_sun: DVec3, degrees: f64) -> DQuat {
    let level = to_sun.cross(DVec3::Y).normalize_or(DVec3::X);
    DQuat::from_axis_angle(level, degrees.to_radians())
}

/// What is looked at of a path.
pub struct Looks {
    /// Frames that are looked at, and their predecessors, under every setting.
    pub frames: Vec<usize>,
    /// Of the frames in which a map changes its grid, so many are looked at, evenly spread.
    pub most_changes: usize,
    /// Points are so many pixels apart, both ways.
    pub stride: usize,
}
