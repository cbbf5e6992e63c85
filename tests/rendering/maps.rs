//! The own pass: which maps are drawn, at which size, and how it is measured.

use bevy::{
    diagnostic::{DiagnosticPath, DiagnosticsStore},
    ecs::schedule::{Schedule, ScheduleLabel, Schedules},
    light::DirectionalLightShadowMap,
    prelude::*,
    render::{
        ExtractSchedule, Render, RenderApp, diagnostic::RenderDiagnosticsPlugin,
        settings::WgpuSettings,
    },
};
use bevy_pssm::{prelude::*, render::SHADOW_PASS_SPAN};

use crate::{
    headless::Headless,
    stage::{Stage, shadows, take_turn},
};

/// Maps whose passes reported vertex shader invocations in the last frames.
fn drawn(stage: &mut Stage) -> Vec<(usize, f64)> {
    stage.picture();
    let store = stage.world().resource::<DiagnosticsStore>();
    (0..8)
        .filter_map(|map| {
            let path = format!("render/{SHADOW_PASS_SPAN}_{map}/vertex_shader_invocations");
            Some((
                map,
                store.get_measurement(&DiagnosticPath::new(path))?.value,
            ))
        })
        .collect()
}

fn stage() -> Stage {
    Stage::with_app(WgpuSettings::default(), |app| {
        app.add_plugins(RenderDiagnosticsPlugin);
    })
}

#[test]
fn each_map_has_its_span() {
    let mut stage = stage();
    let sun = stage.sun();
    // Nothing is seen in the nearest slice.
    let shadows = ParallelSplitShadows {
        comparison: Comparison {
            focus: ShadowFocus::Off,
            ..Default::default()
        },
        ..shadows()
    };
    stage.world().entity_mut(sun).insert(shadows);
    let drawn = drawn(&mut stage);
    assert_eq!(
        drawn.iter().map(|(map, _)| *map).collect::<Vec<_>>(),
        [0, 1, 2, 3]
    );
    assert!(
        drawn.iter().all(|(_, invocations)| *invocations > 0.0),
        "{drawn:?}"
    );
}

#[test]
fn maps_without_casters_are_not_drawn() {
    let mut stage = stage();
    stage.clear_casters();
    // The ground casts into every cascade: take it away too.
    stage.clear_ground();
    let sun = stage.sun();
    stage.world().entity_mut(sun).insert(shadows());
    assert_eq!(drawn(&mut stage), []);
}

#[test]
fn bevys_unused_array_takes_no_room() {
    let mut stage = stage();
    let sun = stage.sun();
    stage.picture();
    let size = |stage: &mut Stage| {
        let world = stage.render_world();
        world.resource::<DirectionalLightShadowMap>().size
    };
    assert_eq!(size(&mut stage), 1024);
    stage.world().entity_mut(sun).insert(shadows());
    stage.picture();
    assert_eq!(size(&mut stage), 1);
    stage
        .world()
        .entity_mut(sun)
        .remove::<ParallelSplitShadows>();
    // Bevy's maps are whole in the very frame that uses them again.
    stage.step();
    assert_eq!(size(&mut stage), 1024);
}

/// A system costs the waking of a thread, and a flush of what systems spawn makes all others wait.
#[test]
fn few_systems_and_no_flushes_are_added_to_a_frame() {
    let _turn = take_turn();
    let count = |setup: fn(&mut App)| {
        let mut headless = Headless::new(UVec2::splat(16), setup);
        headless.step();
        let world = headless.app.sub_app(RenderApp).world();
        let schedules = world.resource::<Schedules>();
        [ExtractSchedule.intern(), Render.intern()]
            .map(|label| schedules.get(label).map_or(0, Schedule::systems_len))
    };
    let with = count(|app| {
        app.add_plugins(PssmPlugin);
    });
    let without = count(|_| ());
    assert!(without[0] > 0 && without[1] > 0, "{without:?}");
    let added = [with[0] - without[0], with[1] - without[1]];
    assert_eq!(added, [3, 6], "of extraction, and of rendering");
}
