//! Schedules whose systems follow one another, on one thread.
//!
//! As systems of `Render` each would cost the waking of a thread, and what they spawn or remove a flush that all others
//! wait for: more than most of them take.

use bevy::ecs::{
    schedule::{
        IntoScheduleConfigs, Schedule, ScheduleBuildSettings, ScheduleLabel, SingleThreadedExecutor,
    },
    system::ScheduleSystem,
    world::World,
};

/// A schedule of systems that follow one another. What they spawn or remove by commands is done after the last of them, or where
/// there is an `ApplyDeferred` among them.
pub(super) fn schedule<M>(
    label: impl ScheduleLabel,
    systems: impl IntoScheduleConfigs<ScheduleSystem, M>,
) -> Schedule {
    let mut schedule = Schedule::new(label);
    schedule
        .set_executor(SingleThreadedExecutor::new())
        .set_build_settings(ScheduleBuildSettings {
            auto_insert_apply_deferred: false,
            ..Default::default()
        })
        .add_systems(systems);
    schedule
}

pub(super) fn run(label: impl ScheduleLabel + Clone) -> impl FnMut(&mut World) {
    move |world| world.run_schedule(label.clone())
}
