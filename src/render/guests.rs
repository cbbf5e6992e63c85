//! Other crates' systems that look for maps where there are none while lights are managed.

use core::any::TypeId;

use bevy::{
    core_pipeline::schedule::Core3d,
    ecs::{
        component::ComponentId,
        query::FilteredAccess,
        schedule::{Schedule, Schedules},
        system::{IntoSystem, Local, Res, System, SystemAccess},
        world::{FromWorld, World},
    },
    log::warn,
    pbr::{
        EARLY_SHADOW_PASS, LATE_SHADOW_PASS, ShadowView, per_view_shadow_pass, shared_shadow_pass,
    },
};

use super::{ShadowTarget, pass::DrawShadowMap};

/// The component by which maps are found in `Core3d`.
pub(super) struct ShadowViewId(ComponentId);

impl FromWorld for ShadowViewId {
    fn from_world(world: &mut World) -> Self {
        Self(world.register_component::<ShadowView>())
    }
}

fn type_of<Marker>(system: impl IntoSystem<(), (), Marker>) -> TypeId {
    IntoSystem::into_system(system).system_type()
}

/// True once: as soon as there are maps, and it is known what `Core3d` runs.
pub(super) fn may_be_there(
    schedules: Res<Schedules>,
    target: Res<ShadowTarget>,
    mut is_done: Local<bool>,
) -> bool {
    if *is_done || !target.exists() {
        return false;
    }
    let core = schedules.get(Core3d);
    // Before its first run nothing is known of it.
    *is_done = core.is_some_and(|it| it.systems_with_access().is_ok());
    *is_done
}

/// Warns if a system of another crate draws into maps as though they were Bevy's, and none draws into the plugin's.
pub(super) fn warn_of_guests(schedules: Res<Schedules>, shadow_view: Local<ShadowViewId>) {
    let Some(Ok(systems)) = schedules.get(Core3d).map(|it| it.systems_with_access()) else {
        return;
    };
    let guests = schedules
        .get(DrawShadowMap)
        .map_or(0, Schedule::systems_len);
    if guests > 0 {
        return;
    }
    let of_bevy = [
        type_of(per_view_shadow_pass::<EARLY_SHADOW_PASS>),
        type_of(per_view_shadow_pass::<LATE_SHADOW_PASS>),
        type_of(shared_shadow_pass::<EARLY_SHADOW_PASS>),
        type_of(shared_shadow_pass::<LATE_SHADOW_PASS>),
    ];
    for (_, system) in systems {
        let SystemAccess::Shared(access) = system.access() else {
            continue;
        };
        // Whoever has all of the world reads it too, and need not mean to.
        let accesses = access
            .filtered_accesses()
            .iter()
            .map(FilteredAccess::access);
        let reads = accesses
            .filter(|it| !it.has_read_all())
            .any(|it| it.has_read(shadow_view.0));
        if reads && !of_bevy.contains(&system.system_type()) {
            warn!(
                "{} finds no `ShadowView`s while lights have `ParallelSplitShadows`: what it draws \
                 throws no shadow. Systems that draw into maps belong into `bevy_pssm::DrawShadowMap`",
                system.name()
            );
        }
    }
}
