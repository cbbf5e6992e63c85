//! How many casters maps have in a village, compared with Bevy's own.

use bevy::{
    camera::{RenderTargetInfo, primitives::Aabb, visibility::CascadesVisibleEntities},
    light::CascadeShadowConfigBuilder,
    prelude::*,
};
use bevy_pssm::prelude::*;

use crate::lights::app;

/// Houses nearer than this (meters) are counted by themselves too: where they have most vertices, they cost most.
const NEAR: f32 = 30.0;

/// An app with rows of houses so far apart (meters), and a camera in the street between two.
fn village(apart: f32) -> (App, Entity) {
    let mut app = app();
    let view = app
        .world_mut()
        .spawn((Camera3d::default(), Transform::from_xyz(0.0, 1.7, 0.0)))
        .id();
    let mut camera = app.world_mut().get_mut::<Camera>(view).unwrap();
    camera.computed.target_info = Some(RenderTargetInfo {
        physical_size: UVec2::new(1280, 720),
        scale_factor: 1.0,
    });
    let mut spawn = |low: Vec3, high: Vec3, at: Vec3| {
        app.world_mut().spawn((
            Mesh3d::default(),
            Aabb::from_min_max(low, high),
            Transform::from_translation(at),
            Visibility::default(),
        ));
    };
    spawn(
        Vec3::new(-500.0, -0.1, -500.0),
        Vec3::new(500.0, 0.0, 500.0),
        Vec3::ZERO,
    );
    for (row, column) in (-20..20).flat_map(|row| (-20..20).map(move |column| (row, column))) {
        let at = apart * Vec3::new(row as f32 + 0.5, 0.0, column as f32);
        spawn(Vec3::new(-3.5, 0.0, -4.0), Vec3::new(3.5, 7.0, 4.0), at);
        let barrel = at + Vec3::new(-4.2, 0.0, 3.0);
        spawn(Vec3::new(-0.5, 0.0, -0.5), Vec3::new(0.5, 1.0, 0.5), barrel);
    }
    (app, view)
}

/// Casters in all maps of a light: all, and near ones.
fn counts(app: &App, view: Entity, light: Entity) -> [f64; 2] {
    let lists = app.world().get::<CascadesVisibleEntities>(light).unwrap();
    let casters = lists.entities[&view].iter().flat_map(|list| &list.entities);
    let near = |it: &&Entity| {
        let at = app.world().get::<Transform>(**it).unwrap().translation;
        (0.001..NEAR).contains(&at.length())
    };
    [casters.clone().count(), casters.filter(near).count()].map(|count| count as f64)
}

/// Whether the sun is behind, beside or before: fitted maps hold fewer than Bevy's, and fewer of the near ones.
#[test]
fn maps_hold_fewer_houses_than_bevys() {
    for (apart, elevation, aside) in [
        (9.0, 12.0_f32, 0.0_f32),
        (14.0, 12.0, 10.0),
        (14.0, 35.0, 0.0),
        (14.0, 35.0, 90.0),
        (14.0, 35.0, 180.0),
        (30.0, 60.0, 0.0),
    ] {
        let (mut app, view) = village(apart);
        // A sun at 0 degrees is behind the camera.
        let turn = Quat::from_rotation_y(aside.to_radians())
            * Quat::from_rotation_x(-elevation.to_radians());
        let sun = (
            DirectionalLight {
                shadow_maps_enabled: true,
                ..default()
            },
            Transform::from_rotation(turn),
        );
        for (first, far) in [(10.0, 500.0), (35.0, 500.0), (10.0, 150.0), (5.0, 60.0)] {
            let cascades = CascadeShadowConfigBuilder {
                first_cascade_far_bound: first,
                maximum_distance: far,
                ..default()
            };
            let bevys = app.world_mut().spawn((sun, cascades.build())).id();
            let fits = [CascadeFit::Steady, CascadeFit::Tight];
            let fits = fits.map(|fit| {
                let shadows = ParallelSplitShadows {
                    far,
                    fit,
                    ..default()
                };
                app.world_mut().spawn((sun, shadows)).id()
            });
            for _ in 0..3 {
                app.update();
            }
            let of_bevys = counts(&app, view, bevys);
            for (name, light) in ["steady", "tight"].into_iter().zip(fits) {
                let of_maps = counts(&app, view, light);
                for index in 0..2 {
                    let share = of_maps[index] / of_bevys[index];
                    assert!(
                        share < 0.85,
                        "{name}: {of_maps:?}, Bevy's {of_bevys:?}, {apart} m apart, sun at {elevation}, \
                         {aside} degrees, {far} m"
                    );
                }
                app.world_mut().despawn(light);
            }
            app.world_mut().despawn(bevys);
        }
    }
}
