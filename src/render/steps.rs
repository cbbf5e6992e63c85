//! What the plugin runs in `Render`, in two steps.

use bevy::{
    ecs::{
        schedule::{ApplyDeferred, IntoScheduleConfigs, Schedule, ScheduleLabel, SystemSet},
        system::Res,
    },
    light::DirectionalLightShadowMap,
};

use super::{
    ExtractedShadows,
    added::{self, AddedViews},
    adopt,
    extract::ExtractedLight,
    hold,
    moving::{self, MovingViews},
    one_thread::schedule,
    pass,
    target::ShadowTarget,
    uniform,
};
use crate::support::ShadowSupport;

/// Once Bevy has made views, and before it looks for their pipelines: which maps are the plugin's, and where they lie.
/// [`PssmRenderSystems::AdoptViews`](super::PssmRenderSystems::AdoptViews) runs it.
#[derive(ScheduleLabel, Debug, Clone, PartialEq, Eq, Hash)]
pub(super) struct AdoptStep;

/// Once Bevy has queued casters: what is drawn in the frame.
/// [`PssmRenderSystems::ChooseMaps`](super::PssmRenderSystems::ChooseMaps) runs it.
#[derive(ScheduleLabel, Debug, Clone, PartialEq, Eq, Hash)]
pub(super) struct ChooseStep;

/// What second views take: nothing runs while there are none, nor will be.
#[derive(SystemSet, Debug, Clone, PartialEq, Eq, Hash)]
struct SecondViewSystems;

pub(super) fn schedules() -> [Schedule; 2] {
    let adopt = (
        adopt::adopt_views,
        (
            ApplyDeferred,
            added::add_added_views,
            moving::add_moving_views,
            moving::make_room_apart,
        )
            .chain()
            .in_set(SecondViewSystems),
    );
    // What these take out of the frame leaves it after the last: none of them looks whether it is there.
    let choose = (
        hold::hold_maps,
        (added::choose_added_views, moving::choose_moving_views)
            .chain()
            .in_set(SecondViewSystems),
        pass::collect_drawn_views,
        uniform::write_uniforms,
    );
    [
        schedule(AdoptStep, adopt.chain()),
        schedule(ChooseStep, choose.chain()),
    ]
    .map(|mut schedule| {
        schedule.configure_sets(SecondViewSystems.run_if(has_second_views));
        schedule
    })
}

/// Whether any map is to be the plugin's, or anything is left of those that were.
pub(super) fn has_maps(
    extracted: Res<ExtractedShadows>,
    target: Res<ShadowTarget>,
    support: Res<ShadowSupport>,
    built_in: Res<DirectionalLightShadowMap>,
    (added, moving): (Res<AddedViews>, Res<MovingViews>),
) -> bool {
    let is_all_undone = !target.exists()
        && !support.is_out_of_room()
        && built_in.size == extracted.built_in_size
        && added.are_none()
        && moving.are_none();
    !extracted.lights.is_empty() || !is_all_undone
}

/// Whether there are second views, or are to be.
fn has_second_views(
    extracted: Res<ExtractedShadows>,
    added: Res<AddedViews>,
    moving: Res<MovingViews>,
) -> bool {
    let has_casters = |light: &ExtractedLight| {
        let mut lists = light.moving.values().chain(light.added.values()).flatten();
        lists.any(|casters| !casters.is_empty())
    };
    !added.are_none() || !moving.are_none() || extracted.lights.values().any(has_casters)
}
