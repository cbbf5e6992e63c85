//! Worlds that are broken, in whole apps with the plugin's shadows and with Bevy's own.

use std::panic::catch_unwind;

use bevy::{
    app::App,
    camera::{primitives::Aabb, visibility::Visibility},
    ecs::{entity::Entity, hierarchy::ChildOf, world::World},
    light::{
        CascadeShadowConfig, CascadeShadowConfigBuilder, Cascades, DirectionalLight,
        cascade::Cascade,
    },
    math::{DVec3, Quat, Vec3, Vec3A},
    mesh::Mesh3d,
    transform::components::Transform,
};
use bevy_pssm::{ShadowPlans, geometry::light_frame::angle_between, prelude::*};

use crate::{
    lights::{app, camera, sun},
    warnings,
};

/// A whole app with the plugin's shadows, or with Bevy's own.
struct Stage {
    app: App,
    view: Entity,
    light: Entity,
}

impl Stage {
    fn new(is_ours: bool) -> Self {
        let mut app = app();
        let view = camera(&mut app);
        let light = if is_ours {
            sun(&mut app, ParallelSplitShadows::default())
        } else {
            sun(&mut app, ())
        };
        app.world_mut()
            .get_mut::<DirectionalLight>(light)
            .expect("a light")
            .shadow_maps_enabled = true;
        app.update();
        Self { app, view, light }
    }

    fn cascades(&self) -> &[Cascade] {
        let cascades = self.app.world().get::<Cascades>(self.light);
        &cascades.expect("a light has them").cascades[&self.view]
    }

    /// Cascades with maps: of Bevy's, all.
    fn maps(&self) -> usize {
        match self.app.world().get::<ShadowPlans>(self.light) {
            Some(plans) => {
                let plans = plans.views[&self.view].iter();
                plans.filter(|plan| plan.map.is_some()).count()
            }
            None => self.cascades().len(),
        }
    }
}

/// How far the first map's axes turn from frame to frame, at most, while the sun goes through the zenith
/// by a tenth of a degree each, turned by `looking_to` (degrees).
pub fn turned_at_zenith(is_ours: bool) -> f64 {
    let mut stage = Stage::new(is_ours);
    let mut last: Option<DVec3> = None;
    let mut most = 0.0_f64;
    for frame in 0..100 {
        let (sin, cos) = (85.0 + 0.1 * frame as f32).to_radians().sin_cos();
        let aimed = Transform::default().looking_to(Vec3::new(-cos, -sin, 0.0), Vec3::Y);
        stage.app.world_mut().entity_mut(stage.light).insert(aimed);
        stage.app.update();
        let axis = stage.cascades()[0].world_from_cascade.x_axis.truncate();
        let axis = axis.as_dvec3();
        if let Some(last) = last.replace(axis) {
            most = most.max(angle_between(last, axis));
        }
    }
    most.to_degrees()
}

/// Done to a world, its camera and its light.
pub type Harm = fn(&mut World, Entity, Entity);

pub fn bad_worlds() -> [(&'static str, Harm); 7] {
    [
        ("mesh with endless bounds", |world, _, _| {
            let endless = Aabb {
                half_extents: Vec3A::INFINITY,
                ..Default::default()
            };
            world.spawn((Mesh3d::default(), endless, Transform::default()));
        }),
        ("camera of scale 1e-12", |world, view, _| {
            let small = Transform::from_scale(Vec3::splat(1e-12));
            world.entity_mut(view).insert(small);
        }),
        ("camera with parallel axes", |world, view, _| {
            let flat = Transform::from_scale(Vec3::new(1.0, 0.0, 1.0));
            let parent = world.spawn((flat, Visibility::default())).id();
            let turned = Transform::from_rotation(Quat::from_rotation_z(0.7));
            world.entity_mut(view).insert((turned, ChildOf(parent)));
        }),
        ("camera 1e30 m from the origin", |world, view, _| {
            let away = Transform::from_translation(Vec3::splat(1e30));
            world.entity_mut(view).insert(away);
        }),
        ("camera at no number", |world, view, _| {
            let nowhere = Transform::from_translation(Vec3::NAN);
            world.entity_mut(view).insert(nowhere);
        }),
        ("sun of scale 0", |world, _, light| {
            let nothing = Transform::from_scale(Vec3::ZERO);
            world.entity_mut(light).insert(nothing);
        }),
        ("shadows without end", |world, _, light| {
            if let Some(mut ours) = world.get_mut::<ParallelSplitShadows>(light) {
                ours.far = f32::INFINITY;
            } else if let Some(mut built_in) = world.get_mut::<CascadeShadowConfig>(light) {
                *built_in = CascadeShadowConfigBuilder {
                    maximum_distance: f32::INFINITY,
                    ..Default::default()
                }
                .build();
            }
        }),
    ]
}

/// What comes of it. Tests have debug assertions: it panics where one fails, in the plugin or in Bevy.
pub fn fate(is_ours: bool, harm: Harm) -> String {
    let found = catch_unwind(|| {
        let mut stage = Stage::new(is_ours);
        harm(stage.app.world_mut(), stage.view, stage.light);
        stage.app.update();
        let cascades = stage.cascades().iter();
        let broken = cascades.filter(|it| !it.clip_from_world.is_finite());
        (broken.count(), stage.maps())
    });
    match found {
        Err(_) => "panics".to_owned(),
        Ok((0, 0)) => "no map".to_owned(),
        Ok((0, maps)) => format!("{maps} maps"),
        Ok((broken, maps)) => format!("{maps} maps, {broken} of no numbers"),
    }
}

/// However long it lasts, and whether a sun or a camera is to blame.
#[test]
fn each_light_is_told_once_of_what_is_degenerate() {
    warnings::capture();
    let mut stage = Stage::new(true);
    // Lights of other tests are told the same, but none of them has such a number.
    for _ in 0..10_000 {
        stage.app.world_mut().spawn_empty();
    }
    let lights = [(); 2].map(|()| sun(&mut stage.app, ParallelSplitShadows::default()));
    for (name, expected) in [
        ("sun of scale 0", [1, 0]),
        ("camera with parallel axes", [1, 1]),
    ] {
        let mut worlds = bad_worlds().into_iter();
        let (_, harm) = worlds.find(|world| world.0 == name).expect("a bad world");
        harm(stage.app.world_mut(), stage.view, lights[0]);
        for _ in 0..3 {
            stage.app.update();
        }
        let told = lights.map(|light| {
            let of_light = format!("Light {light} or a camera has a degenerate");
            let lines = warnings::peek().into_iter();
            lines.filter(|line| line.contains(&of_light)).count()
        });
        assert_eq!(told, expected, "{name}");
    }
}
