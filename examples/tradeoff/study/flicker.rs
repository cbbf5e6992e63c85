//! Shadows that change where nothing does.
//!
//! Points must be followed, not pixels: an edge that is wrong but rests on its surface does not
//! flicker. So the picture is taken from one place throughout, while the maps are laid for a
//! camera, or a sun, that has moved a little: whatever changes is the maps' doing. (What the
//! move does to split depths at a pixel is left out with the move.)

use bevy::{
    camera::CameraUpdateSystems,
    light::SimulationLightSystems,
    math::DVec3,
    prelude::*,
    tasks::{ComputeTaskPool, ParallelSlice},
};
use bevy_pssm::PssmSystems;

use super::trace::{Sample, Tracer};

/// Small motions, each in steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// To the right, by 0.3 pixels at a distance of 10 m.
    Pan,
    /// To the left about the vertical, by 0.3 pixels.
    Turn,
    /// Into the picture, its edges by 0.3 pixels.
    Zoom,
    /// The sun about the vertical, by 0.005°: a day of an hour at 20 frames a second.
    Sun,
}

/// Pixels that the camera's motions move the picture by.
const STEP: f32 = 0.3;
/// Distance at which a pan moves the picture by that (meters).
const PAN_DISTANCE: f32 = 10.0;
/// The sun's turn per step (degrees).
const SUN_STEP: f32 = 0.005;

/// What maps are laid for, beside the picture's own place.
#[derive(Resource, Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct Nudge(pub Option<(Motion, usize)>);

impl Motion {
    /// All.
    pub const ALL: [Self; 4] = [Self::Pan, Self::Turn, Self::Zoom, Self::Sun];

    fn move_camera(
        self,
        steps: usize,
        height: f32,
        place: &mut GlobalTransform,
        projection: &mut Projection,
    ) {
        let share = STEP * steps as f32 / (0.5 * height);
        let tangent = match projection {
            Projection::Perspective(lens) => (0.5 * lens.fov).tan(),
            _ => 1.0,
        };
        let mut transform = place.compute_transform();
        match self {
            Self::Pan => {
                let right = transform.right();
                transform.translation += right * (share * tangent * PAN_DISTANCE);
            }
            Self::Turn => transform.rotate_y((share * tangent).atan()),
            Self::Zoom => {
                if let Projection::Perspective(lens) = projection {
                    lens.fov = 2.0 * (tangent * (1.0 - share)).atan();
                }
            }
            Self::Sun => return,
        }
        *place = transform.into();
    }

    /// A light's place after some steps.
    pub fn move_sun(self, steps: usize, place: &mut GlobalTransform) {
        if self == Self::Sun {
            let mut transform = place.compute_transform();
            transform.rotate_y((SUN_STEP * steps as f32).to_radians());
            *place = transform.into();
        }
    }
}

/// Has maps laid according to [`Nudge`].
pub struct NudgePlugin {
    /// Height of the picture (pixels).
    pub height: f32,
}

/// What was moved, to be put back before the picture is taken.
#[derive(Resource, Default)]
struct Moved {
    cameras: Vec<(Entity, GlobalTransform, Projection)>,
    suns: Vec<(Entity, GlobalTransform)>,
}

impl Plugin for NudgePlugin {
    fn build(&self, app: &mut App) {
        let height = self.height;
        let nudge = move |nudge: Res<Nudge>,
                          mut moved: ResMut<Moved>,
                          mut cameras: Query<
            (Entity, &mut GlobalTransform, &mut Projection),
            (With<Camera3d>, Without<DirectionalLight>),
        >,
                          mut suns: Query<
            (Entity, &mut GlobalTransform),
            (With<DirectionalLight>, Without<Camera3d>),
        >| {
            let Some((motion, steps)) = nudge.0 else {
                return;
            };
            for (entity, mut place, mut projection) in &mut cameras {
                moved.cameras.push((entity, *place, projection.clone()));
                motion.move_camera(steps, height, &mut place, &mut projection);
            }
            for (entity, mut place) in &mut suns {
                moved.suns.push((entity, *place));
                motion.move_sun(steps, &mut place);
            }
        };
        app.init_resource::<Nudge>()
            .init_resource::<Moved>()
            .add_systems(
                PostUpdate,
                (
                    nudge
                        .after(TransformSystems::Propagate)
                        .after(CameraUpdateSystems)
                        .before(SimulationLightSystems::UpdateDirectionalLightCascades)
                        .before(PssmSystems::PlanCascades),
                    put_back
                        .after(SimulationLightSystems::CheckLightVisibility)
                        .after(PssmSystems::CullCasters),
                ),
            );
    }
}

fn put_back(
    mut moved: ResMut<Moved>,
    mut places: Query<&mut GlobalTransform>,
    mut projections: Query<&mut Projection>,
) {
    for (entity, place, projection) in moved.cameras.drain(..) {
        if let (Ok(mut now), Ok(mut lens)) = (places.get_mut(entity), projections.get_mut(entity)) {
            (*now, *lens) = (place, projection);
        }
    }
    for (entity, place) in moved.suns.drain(..) {
        if let Ok(mut now) = places.get_mut(entity) {
            *now = place;
        }
    }
}

/// How pixels fared whose truth stayed the same.
#[derive(Default, Debug, Clone, Copy, PartialEq, Eq)]
pub struct Flips {
    /// Pixels that face the sun, and whose truth stayed the same.
    pub followed: usize,
    /// Of these, those whose answer changed: lit, more than half the light, or not.
    pub flipped: usize,
}

impl Flips {
    /// Percent of the pixels followed.
    pub fn percent(self) -> f64 {
        100.0 * self.flipped as f64 / self.followed.max(1) as f64
    }

    /// Compares two pictures' light shares. `steady` tells, by pixel, whether it is to be
    /// followed.
    pub fn between(before: &[Option<f32>], after: &[Option<f32>], steady: &[bool]) -> Self {
        let mut flips = Self::default();
        for ((before, after), _) in before.iter().zip(after).zip(steady).filter(|(_, s)| **s) {
            if let (Some(before), Some(after)) = (before, after) {
                flips.followed += 1;
                flips.flipped += usize::from((*before > 0.5) != (*after > 0.5));
            }
        }
        flips
    }
}

impl core::ops::AddAssign for Flips {
    fn add_assign(&mut self, other: Self) {
        self.followed += other.followed;
        self.flipped += other.flipped;
    }
}

/// By pixel, whether it faces the sun and its truth is the same under a sun in another
/// direction.
pub fn steady(tracer: &Tracer, samples: &[Option<Sample>], to_sun: DVec3) -> Vec<bool> {
    let same = |sample: &Option<Sample>| {
        let sample = sample.filter(|sample| sample.faces_sun);
        sample.is_some_and(|sample| tracer.is_same_under(&sample, &[to_sun]))
    };
    let chunks = samples.par_chunk_map(ComputeTaskPool::get(), 1024, |_, chunk| {
        chunk.iter().map(same).collect::<Vec<bool>>()
    });
    chunks.into_iter().flatten().collect()
}
