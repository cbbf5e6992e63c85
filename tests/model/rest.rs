//! What a frame costs in which nothing changes.

#![expect(unsafe_code, reason = "allocators are unsafe")]

use core::{
    alloc::{GlobalAlloc, Layout},
    cell::Cell,
};
use std::alloc::System;

use bevy::{
    camera::{primitives::Aabb, visibility::CascadesVisibleEntities},
    light::check_dir_light_mesh_visibility,
    math::DVec3,
    prelude::*,
};
use bevy_pssm::{
    ShadowPlans,
    prelude::*,
    systems::{cull_casters, find_changes, plan_shadows},
};

use crate::lights::{app, camera, sun};

/// The system's allocator, which counts what a thread asks it for.
struct Counting;

thread_local! {
    static ASKED: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: all is left to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ASKED.set(ASKED.get() + 1);
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn frames_at_rest_allocate_nothing() {
    // Alone, beside another one, and beside one whose maps it looks up; all have turned before.
    for turns in [&[0.0][..], &[0.0, 0.5], &[0.0, 0.0]] {
        rests_without_allocations(turns);
    }
}

/// `turns`: of each camera (radians).
fn rests_without_allocations(turns: &[f32]) {
    let mut app = app();
    let mut views = Vec::new();
    for turn in turns {
        let view = camera(&mut app);
        let mut at = app.world_mut().get_mut::<Transform>(view).unwrap();
        at.rotate_y(*turn);
        views.push(view);
    }
    let lights = [(); 2].map(|()| sun(&mut app, ParallelSplitShadows::default()));
    let side = 100;
    let places = (0..side * side).map(|index| [index / side, index % side]);
    let boxes = places.map(|[x, z]| {
        (
            Mesh3d::default(),
            Aabb::from_min_max(Vec3::splat(-0.5), Vec3::splat(0.5)),
            Transform::from_xyz(2.0 * x as f32 - 100.0, 0.5, -2.0 * z as f32),
            Visibility::default(),
        )
    });
    app.world_mut().spawn_batch(boxes.collect::<Vec<_>>());
    for frame in 0..900 {
        if frame < 200 {
            for view in &views {
                let mut at = app.world_mut().get_mut::<Transform>(*view).unwrap();
                at.rotate_y(1.5_f32.to_radians());
            }
        }
        app.update();
    }
    let world = app.world_mut();
    let find = world.register_system(find_changes);
    let plan = world.register_system(plan_shadows);
    let cull = world.register_system(cull_casters);
    let bevys = world.register_system(check_dir_light_mesh_visibility);
    let mut asked = 0;
    for frame in 0..8 {
        for (system, is_ours) in [(find, true), (plan, true), (bevys, false), (cull, true)] {
            let before = ASKED.get();
            world.run_system(system).expect("it runs");
            if is_ours && frame >= 4 {
                asked += ASKED.get() - before;
            }
        }
    }
    assert_eq!(asked, 0, "{turns:?}");
    let holds_casters = |light| {
        let lists = world.get::<CascadesVisibleEntities>(light).unwrap();
        let mut lists = lists.entities.values().flatten();
        lists.any(|list| !list.entities.is_empty())
    };
    assert!(lights.into_iter().all(holds_casters));
}

/// What a plan is made from has it made anew, however long nothing changed before.
#[test]
fn what_changes_ends_a_rest() {
    let mut app = app();
    let view = camera(&mut app);
    let light = sun(&mut app, ParallelSplitShadows::default());
    type Change = fn(&mut World, Entity, Entity);
    let changes: [(&str, Change); 6] = [
        ("view", |world, view, _| {
            let mut at = world.get_mut::<Transform>(view).unwrap();
            at.rotate_y(0.1);
        }),
        ("light", |world, _, light| {
            let mut at = world.get_mut::<Transform>(light).unwrap();
            at.rotate_y(0.1);
        }),
        ("origin", |world, _, _| {
            world.insert_resource(ShadowGridOrigin(DVec3::new(0.3, 0.0, 0.2)));
        }),
        ("fit", |world, _, light| {
            let mut shadows = world.get_mut::<ParallelSplitShadows>(light).unwrap();
            shadows.fit = CascadeFit::Stable;
        }),
        ("cut", |world, view, _| {
            world.trigger(CameraCut { entity: view });
        }),
        ("always", |world, _, light| {
            let mut shadows = world.get_mut::<ParallelSplitShadows>(light).unwrap();
            shadows.comparison.updates = MapUpdates::EveryFrame;
        }),
    ];
    for (name, change) in changes {
        let any_drawn = |app: &mut App| {
            app.update();
            let plans = &app.world().get::<ShadowPlans>(light).unwrap().views[&view];
            let mut maps = plans.iter().filter_map(|plan| plan.map.as_ref());
            maps.any(|map| map.redraw.is_some())
        };
        let last = (0..700).map(|_| any_drawn(&mut app)).last();
        assert_eq!(last, Some(false), "{name}");
        change(app.world_mut(), view, light);
        assert!(any_drawn(&mut app), "{name}");
    }
}
