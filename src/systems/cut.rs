//! Cameras that jump.

use bevy::ecs::{
    entity::Entity,
    event::EntityEvent,
    observer::On,
    system::{Query, Res},
};

use super::{ShadowPlans, SharedViews};

/// Says that a camera's view has jumped, as at a cut: fitted maps then hold on to nothing of what the
/// camera saw before. Turns by more than ten degrees, moves by more than half the first cascade's depth
/// and zooms by more than a quarter, from one frame to the next, are taken for cuts without it; but not turns by up to 45
/// degrees and moves up to [`far`](crate::ParallelSplitShadows::far) that are much as the frame before's.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_pssm::prelude::*;
/// fn cut(mut commands: Commands, camera: Single<Entity, With<Camera3d>>) {
///     commands.trigger(CameraCut { entity: *camera });
/// }
/// ```
#[derive(EntityEvent, Debug, Clone, Copy)]
pub struct CameraCut {
    /// The camera.
    pub entity: Entity,
}

/// Forgets what was held for a camera.
pub(super) fn forget_cut_view(
    cut: On<CameraCut>,
    shared: Res<SharedViews>,
    mut lights: Query<&mut ShadowPlans>,
) {
    let planned = shared.host_of(cut.entity).unwrap_or(cut.entity);
    for mut plans in &mut lights {
        plans.forget(planned);
    }
}
