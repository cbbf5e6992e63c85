//! ECS behavior of the component, without a renderer.

use bevy::{
    app::PostUpdate,
    camera::{
        RenderTargetInfo, Viewport,
        primitives::{Aabb, CascadesFrusta},
        visibility::{CascadesVisibleEntities, NoFrustumCulling, RenderLayers},
    },
    ecs::{entity_disabling::Disabled, prelude::*},
    light::{
        CascadeShadowConfig, CascadeShadowConfigBuilder, Cascades, DirectionalLightShadowMap,
        NotShadowCaster, SimulationLightSystems,
    },
    math::Vec3A,
    prelude::*,
    shape::ViewFrustum,
};
use bevy_pssm::{
    CasterCascades, ManagedLight, PssmSystems, ShadowPlans, plan::lookup_reach, prelude::*,
};

use crate::{server::server_app, warnings};

/// Casters that Bevy's own culling found for managed lights: must stay none.
#[derive(Resource, Default)]
struct FoundByBevy(usize);

pub fn app() -> App {
    app_with_assets(AssetPlugin::default())
}

/// An app without a renderer, with assets of one's own.
pub fn app_with_assets(assets: AssetPlugin) -> App {
    let mut app = server_app(assets);
    app.init_resource::<FoundByBevy>().add_systems(
        PostUpdate,
        count_found_by_bevy
            .after(SimulationLightSystems::CheckLightVisibility)
            .before(PssmSystems::CullCasters),
    );
    app.finish();
    app.cleanup();
    app
}

fn count_found_by_bevy(
    lights: Query<&CascadesVisibleEntities, With<ParallelSplitShadows>>,
    mut found: ResMut<FoundByBevy>,
) {
    found.0 += lights
        .iter()
        .flat_map(|lists| lists.entities.values().flatten())
        .map(|list| list.entities.len())
        .sum::<usize>();
}

/// A camera, and something before it that receives shadows wherever it looks.
pub fn camera(app: &mut App) -> Entity {
    app.world_mut()
        .spawn((Mesh3d::default(), NoFrustumCulling, NotShadowCaster));
    app.world_mut()
        .spawn((Camera3d::default(), Transform::from_xyz(0.0, 2.0, 0.0)))
        .id()
}

pub fn sun(app: &mut App, shadows: impl Bundle) -> Entity {
    app.world_mut()
        .spawn((
            DirectionalLight::default(),
            Transform::default().looking_to(Vec3::new(1.0, -1.0, 0.0), Vec3::Y),
            shadows,
        ))
        .id()
}

fn caster(app: &mut App, at: Vec3) -> Entity {
    app.world_mut()
        .spawn((
            Mesh3d::default(),
            Aabb::from_min_max(Vec3::splat(-0.5), Vec3::splat(0.5)),
            Transform::from_translation(at),
            Visibility::default(),
        ))
        .id()
}

#[test]
fn adding_the_component_is_enough() {
    let mut app = app();
    let view = camera(&mut app);
    let light = sun(
        &mut app,
        ParallelSplitShadows {
            cascades: 3,
            far: 300.0,
            ..default()
        },
    );
    app.update();
    let light = app.world().entity(light);
    assert!(light.get::<DirectionalLight>().unwrap().shadow_maps_enabled);
    assert_eq!(light.get::<ShadowPlans>().unwrap().views[&view].len(), 3);
    let config = light.get::<CascadeShadowConfig>().unwrap();
    assert_eq!(config.bounds.len(), 3);
    assert_eq!(config.bounds[2], 300.0);
    assert_eq!(light.get::<Cascades>().unwrap().cascades[&view].len(), 3);
    assert_eq!(
        light.get::<CascadesFrusta>().unwrap().frusta[&view].len(),
        3
    );
}

#[test]
fn bevys_components_carry_the_plans() {
    let mut app = app();
    let view = camera(&mut app);
    let light = sun(&mut app, ParallelSplitShadows::default());
    app.update();
    let light = app.world().entity(light);
    let plans = &light.get::<ShadowPlans>().unwrap().views[&view];
    let cascades = &light.get::<Cascades>().unwrap().cascades[&view];
    let frusta = &light.get::<CascadesFrusta>().unwrap().frusta[&view];
    for ((plan, cascade), frustum) in plans.iter().zip(cascades).zip(frusta) {
        let map = plan.map.as_ref().unwrap();
        assert_eq!(cascade.clip_from_world, map.clip_from_world.as_mat4());
        assert_eq!(cascade.texel_size, map.texel.x as f32);
        let expected = ViewFrustum::from_clip_from_world(&cascade.clip_from_world);
        assert_eq!(format!("{:?}", frustum.0), format!("{expected:?}"));
    }
}

/// Of a mesh without end nothing says where it is not seen.
#[test]
fn endless_receivers_are_everywhere() {
    let mut app = app();
    let view = app
        .world_mut()
        .spawn((Camera3d::default(), Transform::from_xyz(0.0, 2.0, 0.0)))
        .id();
    let light = sun(&mut app, ParallelSplitShadows::default());
    app.world_mut().spawn((
        Mesh3d::default(),
        Aabb {
            half_extents: Vec3A::INFINITY,
            ..default()
        },
        Transform::default().looking_to(Vec3::new(1.0, 0.3, 0.2), Vec3::Y),
    ));
    app.update();
    let plans = &app.world().get::<ShadowPlans>(light).unwrap().views[&view];
    assert!(plans.iter().all(|plan| plan.map.is_some()));
}

/// A light that can show no shadow to a camera costs it nothing.
#[test]
fn what_cannot_meet_is_not_planned() {
    let is_planned = |change: &dyn Fn(&mut EntityWorldMut)| {
        let mut app = app();
        let view = camera(&mut app);
        let light = sun(&mut app, ParallelSplitShadows::default());
        caster(&mut app, Vec3::new(-2.0, 2.0, -4.0));
        app.update();
        change(&mut app.world_mut().entity_mut(light));
        app.update();
        let light = app.world().entity(light);
        let casters = &light.get::<CasterCascades>().unwrap().views;
        let casters = casters.get(&view).map_or(0, Vec::len);
        let plans = &light.get::<ShadowPlans>().unwrap().views[&view];
        let is_planned = plans.iter().any(|plan| plan.map.is_some());
        assert_eq!(is_planned, casters > 0);
        is_planned
    };
    let set = |change: fn(&mut DirectionalLight)| {
        is_planned(&|light| change(&mut light.get_mut().expect("a light")))
    };
    assert!(is_planned(&|_| ()));
    assert!(!set(|light| light.illuminance = 0.0));
    assert!(!set(|light| light.shadow_maps_enabled = false));
    assert!(!is_planned(&|light| {
        light.insert(Visibility::Hidden);
    }));
    assert!(!is_planned(&|light| {
        light.insert(RenderLayers::layer(3));
    }));
}

#[test]
fn casters_are_listed_where_they_matter_and_nowhere_else() {
    let mut app = app();
    let view = camera(&mut app);
    // The light travels towards +x and down: what matters lies at −x and above.
    let light = sun(&mut app, ParallelSplitShadows::default());
    let near = caster(&mut app, Vec3::new(-2.0, 2.0, -4.0));
    let far = caster(&mut app, Vec3::new(0.0, 0.0, -300.0));
    let behind = caster(&mut app, Vec3::new(0.0, 0.0, 60.0));
    let high_up_light = caster(&mut app, Vec3::new(-500.0, 500.0, -4.0));
    let silent = caster(&mut app, Vec3::new(-2.0, 2.0, -4.0));
    app.world_mut().entity_mut(silent).insert(NotShadowCaster);
    app.update();

    let record = app.world().get::<CasterCascades>(light).unwrap();
    assert_eq!(
        record.get(view, near).and_then(|it| it.iter().next()),
        Some(0)
    );
    assert_eq!(
        record
            .get(view, far)
            .map(|it| it.iter().collect::<Vec<_>>()),
        Some(vec![3])
    );
    assert_eq!(record.get(view, behind), None);
    assert_eq!(record.get(view, silent), None);
    assert_eq!(
        record
            .get(view, high_up_light)
            .and_then(|it| it.iter().next()),
        Some(0)
    );

    let lists = &app
        .world()
        .get::<CascadesVisibleEntities>(light)
        .unwrap()
        .entities[&view];
    for (index, list) in lists.iter().enumerate() {
        let expected: Vec<Entity> = record.views[&view]
            .iter()
            .filter(|(_, cascades)| cascades.contains(index))
            .map(|(entity, _)| *entity)
            .collect();
        assert_eq!(list.entities, expected);
    }
    // Off-screen casters must be marked visible, or Bevy would not extract their meshes.
    assert!(
        app.world()
            .get::<ViewVisibility>(high_up_light)
            .unwrap()
            .get()
    );
    assert!(!app.world().get::<ViewVisibility>(behind).unwrap().get());
}

#[test]
fn bevy_does_not_cull_for_managed_lights() {
    let mut app = app();
    camera(&mut app);
    let light = sun(&mut app, ParallelSplitShadows::default());
    caster(&mut app, Vec3::new(-2.0, 2.0, -4.0));
    app.update();
    app.update();
    app.update();
    assert_eq!(app.world().resource::<FoundByBevy>().0, 0);
    let lists = app.world().get::<CascadesVisibleEntities>(light).unwrap();
    assert!(
        lists
            .entities
            .values()
            .flatten()
            .any(|list| !list.entities.is_empty())
    );
}

#[test]
fn culling_off_lists_every_caster_in_every_cascade() {
    let mut app = app();
    let view = camera(&mut app);
    let light = sun(
        &mut app,
        ParallelSplitShadows {
            comparison: Comparison {
                culling: CasterCulling::Off,
                ..Default::default()
            },
            ..default()
        },
    );
    let behind = caster(&mut app, Vec3::new(0.0, 0.0, 600.0));
    app.update();
    let record = app.world().get::<CasterCascades>(light).unwrap();
    assert_eq!(
        record
            .get(view, behind)
            .map(|it| it.iter().collect::<Vec<_>>()),
        Some(vec![0, 1, 2, 3])
    );
}

#[test]
fn removal_restores_bevys_settings() {
    let mut app = app();
    let view = camera(&mut app);
    let custom = CascadeShadowConfig {
        bounds: vec![5.0, 50.0],
        overlap_proportion: 0.3,
        minimum_distance: 0.2,
    };
    let light = sun(&mut app, (custom.clone(), ParallelSplitShadows::default()));
    app.update();
    assert_eq!(
        app.world()
            .get::<CascadeShadowConfig>(light)
            .unwrap()
            .bounds
            .len(),
        4
    );
    app.world_mut()
        .entity_mut(light)
        .remove::<ParallelSplitShadows>();
    app.update();
    let entity = app.world().entity(light);
    let config = entity.get::<CascadeShadowConfig>().unwrap();
    assert_eq!(
        (&config.bounds, config.overlap_proportion),
        (&custom.bounds, 0.3)
    );
    assert!(
        !entity
            .get::<DirectionalLight>()
            .unwrap()
            .shadow_maps_enabled
    );
    assert!(entity.get::<ShadowPlans>().is_none() && entity.get::<CasterCascades>().is_none());
    app.world_mut()
        .get_mut::<DirectionalLight>(light)
        .unwrap()
        .shadow_maps_enabled = true;
    app.update();
    assert_eq!(
        app.world().get::<Cascades>(light).unwrap().cascades[&view].len(),
        2
    );
}

#[test]
fn disabling_hands_the_light_back_and_enabling_takes_it_again() {
    let mut app = app();
    camera(&mut app);
    let light = sun(&mut app, ParallelSplitShadows::default());
    let before = CascadeShadowConfig::default().bounds;
    for _ in 0..2 {
        app.update();
        assert_ne!(
            app.world()
                .get::<CascadeShadowConfig>(light)
                .unwrap()
                .bounds,
            before
        );
        app.world_mut()
            .entity_mut(light)
            .remove::<ParallelSplitShadows>();
        app.update();
        assert_eq!(
            app.world()
                .get::<CascadeShadowConfig>(light)
                .unwrap()
                .bounds,
            before
        );
        assert!(
            !app.world()
                .get::<DirectionalLight>(light)
                .unwrap()
                .shadow_maps_enabled
        );
        app.world_mut()
            .entity_mut(light)
            .insert(ParallelSplitShadows::default());
    }
}

#[test]
fn a_bad_change_keeps_the_last_good_configuration() {
    let mut app = app();
    let view = camera(&mut app);
    let light = sun(
        &mut app,
        ParallelSplitShadows {
            cascades: 2,
            ..default()
        },
    );
    app.update();
    let count = |app: &App| app.world().get::<ShadowPlans>(light).unwrap().views[&view].len();
    assert_eq!(count(&app), 2);
    app.world_mut()
        .get_mut::<ParallelSplitShadows>(light)
        .unwrap()
        .cascades = 9;
    app.update();
    assert_eq!(count(&app), 2);
    app.world_mut()
        .get_mut::<ParallelSplitShadows>(light)
        .unwrap()
        .cascades = 3;
    app.update();
    assert_eq!(count(&app), 3);
}

/// A mistake that a game writes in every frame is told once, and another one again.
#[test]
fn a_mistake_is_told_once_however_often_it_is_written() {
    warnings::capture();
    let mut app = app();
    let light = sun(&mut app, ParallelSplitShadows::default());
    let mut write = |far: f32| {
        let mut config = app
            .world_mut()
            .get_mut::<ParallelSplitShadows>(light)
            .unwrap();
        config.far = far;
        app.update();
    };
    for far in [-7.5, -7.5, -7.5, 100.0, -7.5, -8.5, 103.25] {
        write(far);
    }
    let lines = warnings::peek();
    let told = |value: &str| {
        let of_value = |line: &&String| line.contains(&format!("`far` is {value}"));
        lines.iter().filter(of_value).count()
    };
    assert_eq!([told("-7.5"), told("-8.5")], [2, 1], "{lines:#?}");
    for _ in 0..3 {
        let config = app.world_mut().get_mut::<ParallelSplitShadows>(light);
        config.unwrap().splits = SplitScheme::Manual(vec![f32::NAN, 20.0, 78.5]);
        app.update();
    }
    let lines = warnings::peek();
    // No other test's light ends there.
    let of_splits = |line: &&String| line.contains("103.25") && line.contains("NaN");
    assert_eq!(lines.iter().filter(of_splits).count(), 1, "{lines:#?}");
}

/// What was planned for a light goes with it.
#[test]
fn nothing_is_left_of_what_is_no_light_any_more() {
    for is_component_left in [false, true] {
        let mut app = app();
        camera(&mut app);
        let light = sun(&mut app, ParallelSplitShadows::default());
        app.update();
        let mut entity = app.world_mut().entity_mut(light);
        entity.remove::<DirectionalLight>();
        if !is_component_left {
            entity.remove::<ParallelSplitShadows>();
        }
        app.update();
        let light = app.world().entity(light);
        let plans = light.get::<ShadowPlans>();
        assert_eq!(plans.is_some(), is_component_left);
        assert!(plans.is_none_or(|plans| plans.views.is_empty()));
        assert_eq!(light.contains::<ManagedLight>(), is_component_left);
    }
}

/// What one system removes and another puts back before commands are carried out stays managed.
#[test]
fn a_component_that_comes_back_at_once_is_managed() {
    let mut app = app();
    let view = camera(&mut app);
    let light = sun(&mut app, ParallelSplitShadows::default());
    app.update();
    app.world_mut()
        .entity_mut(light)
        .remove::<ParallelSplitShadows>();
    let mut has_come_back = false;
    let put_back = move |mut commands: Commands| {
        if !core::mem::replace(&mut has_come_back, true) {
            commands
                .entity(light)
                .insert(ParallelSplitShadows::default());
        }
    };
    app.add_systems(
        PostUpdate,
        put_back.before_ignore_deferred(PssmSystems::ManageLights),
    );
    app.update();
    app.update();
    let plans = app.world().get::<ShadowPlans>(light).expect("managed");
    assert_eq!(plans.views[&view].len(), 4);
}

#[test]
fn a_component_that_was_never_good_leaves_bevys_shadows_alone() {
    let mut app = app();
    camera(&mut app);
    let light = sun(
        &mut app,
        ParallelSplitShadows {
            near: f32::NAN,
            ..default()
        },
    );
    app.update();
    let entity = app.world().entity(light);
    assert_eq!(
        entity.get::<CascadeShadowConfig>().unwrap().bounds,
        CascadeShadowConfig::default().bounds
    );
    assert!(
        !entity
            .get::<DirectionalLight>()
            .unwrap()
            .shadow_maps_enabled
    );
}

#[test]
fn the_light_may_come_later() {
    let mut app = app();
    camera(&mut app);
    let light = app.world_mut().spawn(ParallelSplitShadows::default()).id();
    app.update();
    app.update();
    app.world_mut()
        .entity_mut(light)
        .insert(DirectionalLight::default());
    app.update();
    let entity = app.world().entity(light);
    assert!(
        entity
            .get::<DirectionalLight>()
            .unwrap()
            .shadow_maps_enabled
    );
    assert_eq!(entity.get::<ShadowPlans>().unwrap().views.len(), 1);
}

#[test]
fn lights_that_were_asleep_are_taken_when_they_wake() {
    let mut app = app();
    camera(&mut app);
    let light = sun(&mut app, (ParallelSplitShadows::default(), Disabled));
    app.update();
    app.update();
    app.world_mut().entity_mut(light).remove::<Disabled>();
    app.update();
    assert_eq!(
        app.world().get::<ShadowPlans>(light).unwrap().views.len(),
        1
    );
}

#[test]
fn a_replaced_light_is_not_given_its_predecessors_settings() {
    let mut app = app();
    camera(&mut app);
    let light = sun(&mut app, ParallelSplitShadows::default());
    app.update();
    app.world_mut()
        .entity_mut(light)
        .remove::<(DirectionalLight, ParallelSplitShadows)>();
    app.update();
    let custom = CascadeShadowConfig {
        bounds: vec![7.0],
        overlap_proportion: 0.1,
        minimum_distance: 0.3,
    };
    app.world_mut().entity_mut(light).insert((
        DirectionalLight {
            shadow_maps_enabled: true,
            ..default()
        },
        custom.clone(),
    ));
    app.update();
    let entity = app.world().entity(light);
    assert!(
        entity
            .get::<DirectionalLight>()
            .unwrap()
            .shadow_maps_enabled
    );
    assert_eq!(
        entity.get::<CascadeShadowConfig>().unwrap().bounds,
        custom.bounds
    );

    // With the component still there, the new light is taken over.
    app.world_mut()
        .entity_mut(light)
        .insert(ParallelSplitShadows::default());
    app.update();
    app.world_mut()
        .entity_mut(light)
        .remove::<DirectionalLight>();
    app.update();
    app.world_mut()
        .entity_mut(light)
        .insert(DirectionalLight::default());
    app.update();
    assert!(
        app.world()
            .get::<DirectionalLight>(light)
            .unwrap()
            .shadow_maps_enabled
    );
    app.world_mut()
        .entity_mut(light)
        .remove::<ParallelSplitShadows>();
    app.update();
    let bounds = &app
        .world()
        .get::<CascadeShadowConfig>(light)
        .unwrap()
        .bounds;
    assert_eq!(*bounds, custom.bounds);
}

#[test]
fn removal_with_everything_required_restores_bevys_settings() {
    let mut app = app();
    camera(&mut app);
    let light = sun(&mut app, ParallelSplitShadows::default());
    app.update();
    app.world_mut()
        .entity_mut(light)
        .remove_with_requires::<ParallelSplitShadows>();
    app.update();
    let entity = app.world().entity(light);
    assert!(
        !entity
            .get::<DirectionalLight>()
            .unwrap()
            .shadow_maps_enabled
    );
    assert_eq!(
        entity.get::<CascadeShadowConfig>().unwrap().bounds,
        CascadeShadowConfig::default().bounds
    );
}

#[test]
fn wide_filters_widen_the_hull() {
    let mut app = app();
    let view = camera(&mut app);
    let light = sun(&mut app, ParallelSplitShadows::default());
    let distance = |app: &mut App, filter| {
        let mut entity = app.world_mut().entity_mut(light);
        entity.get_mut::<ParallelSplitShadows>().unwrap().filter = filter;
        app.update();
        let plans = &app.world().get::<ShadowPlans>(light).unwrap().views[&view];
        let map = plans[0].map.as_ref().unwrap();
        (map.hull.planes[0].distance, map.texel.max_element())
    };
    let (narrow, _) = distance(&mut app, ShadowFilter::Hardware2x2);
    let (wide, texel) = distance(&mut app, ShadowFilter::Soft { sun_degrees: 0.5 });
    assert!(wide > narrow + 7.0 * texel, "{wide} {narrow} {texel}");
}

/// Where a lookup ends within a texel, that one counts.
#[test]
fn guards_are_as_wide_as_lookups_reach() {
    let with = |filter, bias| ParallelSplitShadows {
        fit: CascadeFit::Stable,
        filter,
        comparison: Comparison { bias, ..default() },
        ..default()
    };
    // With the bilinear tap.
    let wide = ShadowFilter::Tent(FilterRadius::Texels(1.5));
    let offset = ShadowBias::NormalOffset { texels: 1.5 };
    for config in [
        with(wide, ShadowBias::Automatic),
        with(ShadowFilter::Hardware2x2, offset),
    ] {
        let reach = lookup_reach(&config, &DirectionalLight::default());
        assert!(reach.texels >= 2.5, "{config:?} {reach:?}");
    }
}

#[test]
fn each_camera_and_light_has_its_own_plan() {
    let mut app = app();
    let first = camera(&mut app);
    let second = app
        .world_mut()
        .spawn((
            Camera3d::default(),
            Camera {
                order: 1,
                ..default()
            },
            Transform::from_xyz(900.0, 2.0, 0.0),
        ))
        .id();
    let lights = [
        sun(&mut app, ParallelSplitShadows::default()),
        sun(
            &mut app,
            ParallelSplitShadows {
                cascades: 1,
                ..default()
            },
        ),
    ];
    app.update();
    for light in lights {
        let plans = &app.world().get::<ShadowPlans>(light).unwrap().views;
        assert_eq!(plans.len(), 2);
        assert_ne!(plans[&first][0].map, plans[&second][0].map);
    }
    app.world_mut().get_mut::<Camera>(second).unwrap().is_active = false;
    app.update();
    let plans = &app.world().get::<ShadowPlans>(lights[0]).unwrap().views;
    assert!(plans.contains_key(&first) && !plans.contains_key(&second));
}

#[test]
fn degenerate_transforms_give_no_map_and_no_nan() {
    let mut app = app();
    let view = camera(&mut app);
    let light = sun(&mut app, ParallelSplitShadows::default());
    caster(&mut app, Vec3::ZERO);
    // Bevy's own visibility systems do not survive transforms that are not numbers.
    for broken in [
        Transform::from_scale(Vec3::splat(1e-12)),
        Transform::from_translation(Vec3::splat(1e30)),
    ] {
        *app.world_mut().get_mut::<Transform>(view).unwrap() = broken;
        app.update();
        for cascade in &app.world().get::<Cascades>(light).unwrap().cascades[&view] {
            assert!(cascade.clip_from_world.is_finite());
        }
    }
    *app.world_mut().get_mut::<Transform>(view).unwrap() = Transform::default();
    app.world_mut()
        .get_mut::<Transform>(light)
        .unwrap()
        .rotation = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0);
    app.update();
    for cascade in &app.world().get::<Cascades>(light).unwrap().cascades[&view] {
        assert!(cascade.clip_from_world.is_finite());
    }
}

#[test]
fn types_are_registered_for_reflection() {
    let app = app();
    let registry = app.world().resource::<AppTypeRegistry>().read();
    for path in [
        "bevy_pssm::config::ParallelSplitShadows",
        "bevy_pssm::config::preset::ShadowPreset",
        "bevy_pssm::debug::ShadowOverlay",
        "bevy_pssm::shaders::features::ShaderFeatures",
        "bevy_pssm::systems::manage::ManagedLight",
        "bevy_pssm::config::splits::SplitScheme",
    ] {
        assert!(registry.get_with_type_path(path).is_some(), "{path}");
    }
}

/// Shadows that the game has switched off stay off, also if the component goes and comes back.
#[test]
fn switched_off_stays_off_when_managed_again() {
    let mut app = app();
    camera(&mut app);
    let light = sun(&mut app, ParallelSplitShadows::default());
    let casts = |app: &App| {
        app.world()
            .get::<DirectionalLight>(light)
            .unwrap()
            .shadow_maps_enabled
    };
    app.update();
    assert!(casts(&app));
    app.world_mut()
        .get_mut::<DirectionalLight>(light)
        .unwrap()
        .shadow_maps_enabled = false;
    app.update();
    app.world_mut()
        .entity_mut(light)
        .remove::<ParallelSplitShadows>();
    app.update();
    assert!(!casts(&app));
    app.world_mut()
        .entity_mut(light)
        .insert(ParallelSplitShadows::default());
    app.update();
    assert!(
        !casts(&app),
        "adding the component switched shadows on again"
    );
    app.world_mut()
        .get_mut::<DirectionalLight>(light)
        .unwrap()
        .shadow_maps_enabled = true;
    app.update();
    assert!(casts(&app));

    // Another light on the same entity knows nothing of it.
    app.world_mut()
        .get_mut::<DirectionalLight>(light)
        .unwrap()
        .shadow_maps_enabled = false;
    app.update();
    let mut entity = app.world_mut().entity_mut(light);
    entity.remove::<ParallelSplitShadows>();
    app.update();
    let mut entity = app.world_mut().entity_mut(light);
    entity.remove::<DirectionalLight>();
    entity.insert((DirectionalLight::default(), ParallelSplitShadows::default()));
    app.update();
    assert!(casts(&app));
}

/// Left at its defaults, the range is that of the light's own configuration, if the game has set one.
#[test]
fn the_range_follows_the_games_own() {
    let mut app = app();
    camera(&mut app);
    let own = |first, last| {
        CascadeShadowConfigBuilder {
            first_cascade_far_bound: first,
            maximum_distance: last,
            ..default()
        }
        .build()
    };
    let bounds = |app: &mut App, light: Entity| {
        app.update();
        let config = app.world().get::<CascadeShadowConfig>(light).unwrap();
        config.bounds.clone()
    };
    let light = sun(&mut app, ParallelSplitShadows::default());
    assert_eq!(bounds(&mut app, light)[3], 500.0);

    let small = sun(&mut app, ());
    app.world_mut()
        .entity_mut(small)
        .insert((own(1.6, 30.0), ParallelSplitShadows::default()));
    let found = bounds(&mut app, small);
    assert!((29.9..30.1).contains(&found[3]), "{found:?}");
    // Each of Bevy's cascades ends 2.657 times as far off as the one before.
    let [near, far] = [1.6 / 2.657, 30.0_f32];
    let first = 0.9 * 1.6 + 0.1 * (near + (far - near) / 4.0);
    approx::assert_relative_eq!(found[0], first, max_relative = 1e-2);
    // What is set stays set, and what was comes back.
    let set = ParallelSplitShadows {
        far: 80.0,
        ..default()
    };
    app.world_mut().entity_mut(small).insert(set);
    assert_eq!(bounds(&mut app, small)[3], 80.0);
    app.world_mut()
        .entity_mut(small)
        .remove::<ParallelSplitShadows>();
    assert_eq!(bounds(&mut app, small), own(1.6, 30.0).bounds);

    // Bounds that make no range are not followed.
    let odd = sun(&mut app, ());
    let mut config = own(1.6, 30.0);
    config.bounds = vec![5.0, f32::NAN];
    app.world_mut()
        .entity_mut(odd)
        .insert((config, ParallelSplitShadows::default()));
    assert_eq!(bounds(&mut app, odd)[3], 500.0);
}

/// A game can say that a view has jumped, where the view itself does not show it.
#[test]
fn cuts_can_be_told() {
    let mut app = app();
    // Nothing but what is seen.
    let view = app.world_mut().spawn(Camera3d::default()).id();
    let config = ParallelSplitShadows {
        fit: CascadeFit::Tight,
        ..default()
    };
    let light = sun(&mut app, config);
    let thing = caster(&mut app, Vec3::new(0.0, 0.0, -60.0));
    let texel = |app: &mut App| {
        app.update();
        let plans = app.world().get::<ShadowPlans>(light).unwrap();
        let maps = plans.views[&view]
            .iter()
            .filter_map(|plan| plan.map.as_ref());
        maps.map(|map| map.texel.max_element()).next()
    };
    let scale = |app: &mut App, scale: f32| {
        app.world_mut().get_mut::<Transform>(thing).unwrap().scale = Vec3::splat(scale);
    };
    for is_told in [false, true] {
        scale(&mut app, 12.0);
        (0..40).for_each(|_| app.update());
        let large = texel(&mut app);
        scale(&mut app, 9.0);
        texel(&mut app);
        if is_told {
            app.world_mut().trigger(CameraCut { entity: view });
        }
        let small = texel(&mut app);
        assert_eq!(small < large, is_told, "{large:?} {small:?}");
    }
}

/// The side of the first map of each camera (texels).
fn sides(app: &App, light: Entity) -> Vec<u32> {
    let plans = app.world().get::<ShadowPlans>(light).unwrap();
    plans
        .views
        .values()
        .map(|plan| plan[0].map_size.x)
        .collect()
}

/// Two cameras side by side, as eyes are, but so far apart that their maps differ.
fn eyes(app: &mut App) -> [Entity; 2] {
    let eyes = [camera(app), camera(app)];
    let aside = Transform::from_xyz(3.0, 2.0, 0.0);
    app.world_mut().entity_mut(eyes[1]).insert(aside);
    eyes
}

/// The cameras that have maps of their own.
fn planned(app: &App, light: Entity) -> Vec<Entity> {
    let plans = app.world().get::<ShadowPlans>(light).unwrap();
    let mut planned: Vec<Entity> = plans.views.keys().copied().collect();
    planned.sort_unstable_by_key(|camera| camera.index_u32());
    planned
}

#[test]
fn eyes_share_maps_made_for_both() {
    let mut app = app();
    let light = sun(&mut app, ParallelSplitShadows::default());
    let [left, right] = eyes(&mut app);
    let block = caster(&mut app, Vec3::new(0.0, 0.0, -5.0));
    app.update();
    assert_eq!(planned(&app, light), [left, right]);
    let widths = |app: &App| {
        let plans = app.world().get::<ShadowPlans>(light).unwrap();
        plans.views[&left]
            .iter()
            .map(|plan| plan.map.as_ref().unwrap().texel.x)
            .sum::<f64>()
    };
    let alone = widths(&app);

    app.world_mut()
        .entity_mut(right)
        .insert(SharesShadowsWith(left));
    app.update();
    assert_eq!(planned(&app, light), [left]);
    assert!(widths(&app) > alone, "as wide for two as for one");
    let published = app.world().get::<Cascades>(light).unwrap();
    let matrices = |eye| published.cascades[&eye].iter().map(|it| it.clip_from_world);
    assert!(matrices(left).eq(matrices(right)));
    let lists = &app
        .world()
        .get::<CascadesVisibleEntities>(light)
        .unwrap()
        .entities;
    assert!(
        lists[&left]
            .iter()
            .any(|list| list.entities.contains(&block))
    );
    assert!(lists[&right].iter().all(|list| list.entities.is_empty()));
    assert_eq!(lists[&right].len(), lists[&left].len());

    app.world_mut()
        .entity_mut(right)
        .remove::<SharesShadowsWith>();
    app.update();
    assert_eq!(planned(&app, light), [left, right]);
    assert_eq!(widths(&app), alone);
}

#[test]
fn cameras_share_maps_only_with_those_that_have_some() {
    let inactive = |app: &mut App, [left, _]: [Entity; 2]| {
        app.world_mut().get_mut::<Camera>(left).unwrap().is_active = false;
    };
    let layered = |app: &mut App, [_, right]: [Entity; 2]| {
        let layers = RenderLayers::from_layers(&[0, 1]);
        app.world_mut().entity_mut(right).insert(layers);
    };
    let turned = |app: &mut App, [_, right]: [Entity; 2]| {
        app.world_mut()
            .entity_mut(right)
            .insert(Transform::from_rotation(Quat::from_rotation_y(2.0)));
    };
    let mutual = |app: &mut App, [left, right]: [Entity; 2]| {
        app.world_mut()
            .entity_mut(left)
            .insert(SharesShadowsWith(right));
    };
    let oneself = |app: &mut App, [_, right]: [Entity; 2]| {
        app.world_mut()
            .entity_mut(right)
            .insert(SharesShadowsWith(right));
    };
    let gone = |app: &mut App, [left, _]: [Entity; 2]| {
        app.world_mut().despawn(left);
    };
    let canted = |app: &mut App, [_, right]: [Entity; 2]| {
        let canted =
            Transform::from_xyz(3.0, 2.0, 0.0).looking_to(Vec3::new(0.1, 0.0, -1.0), Vec3::Y);
        app.world_mut().entity_mut(right).insert(canted);
    };
    // As into a minimized window.
    let undrawn = |app: &mut App, [_, right]: [Entity; 2]| {
        let mut camera = app.world_mut().get_mut::<Camera>(right).unwrap();
        camera.computed.target_info = Some(RenderTargetInfo {
            physical_size: UVec2::splat(100),
            scale_factor: 1.0,
        });
    };
    let cases: [(&str, fn(&mut App, [Entity; 2]), usize); 8] = [
        ("canted", canted, 2),
        ("undrawn", undrawn, 2),
        ("inactive", inactive, 1),
        ("layered", layered, 2),
        ("turned", turned, 2),
        ("mutual", mutual, 2),
        ("oneself", oneself, 2),
        ("gone", gone, 1),
    ];
    for (name, change, count) in cases {
        let mut app = app();
        let light = sun(&mut app, ParallelSplitShadows::default());
        let [left, right] = eyes(&mut app);
        app.world_mut()
            .entity_mut(right)
            .insert(SharesShadowsWith(left));
        change(&mut app, [left, right]);
        app.update();
        let planned = planned(&app, light);
        assert!(
            planned.len() == count && planned.contains(&right),
            "{name}: {planned:?}"
        );
    }

    // What a host shared with has gone.
    let mut app = app();
    let light = sun(&mut app, ParallelSplitShadows::default());
    let [left, right] = eyes(&mut app);
    let gone = app.world_mut().spawn_empty().id();
    app.world_mut().despawn(gone);
    for (guest, host) in [(left, gone), (right, left)] {
        let share = SharesShadowsWith(host);
        app.world_mut().entity_mut(guest).insert(share);
    }
    app.update();
    assert_eq!(planned(&app, light), [left]);
}

#[test]
fn cameras_that_see_the_same_share_maps() {
    let mut app = app();
    let light = sun(&mut app, ParallelSplitShadows::default());
    let cameras = [camera(&mut app), camera(&mut app)];
    app.update();
    assert_eq!(planned(&app, light).len(), 1);
    let zoomed = Projection::Perspective(PerspectiveProjection {
        fov: 0.5,
        ..default()
    });
    app.world_mut().entity_mut(cameras[1]).insert(zoomed);
    app.update();
    assert_eq!(planned(&app, light), cameras);

    // Where one shares a third one's, made for more, the other needs its own.
    let eye = camera(&mut app);
    let aside = Transform::from_xyz(3.0, 2.0, 0.0);
    app.world_mut().entity_mut(eye).insert(aside);
    app.world_mut()
        .entity_mut(cameras[0])
        .insert(SharesShadowsWith(eye));
    let same = camera(&mut app);
    // So that it comes last.
    let layers = RenderLayers::default();
    app.world_mut().entity_mut(same).insert(layers);
    app.update();
    assert_eq!(planned(&app, light), [cameras[1], eye, same]);
}

#[test]
fn spot_lights_and_other_suns_count_towards_the_memory_limit() {
    for (spots, suns, theirs, side) in [
        (0, 0, 1024, 2048),
        (1, 0, 1024, 1024),
        (0, 1, 1024, 1024),
        // Layers would be as large all the same.
        (1, 0, 2048, 2048),
    ] {
        let mut app = app();
        app.insert_resource(ShadowMemoryLimit(4 * 4 * 2048 * 2048))
            .insert_resource(DirectionalLightShadowMap { size: theirs });
        let light = sun(&mut app, ParallelSplitShadows::default());
        for _ in 0..spots {
            app.world_mut().spawn(SpotLight {
                shadow_maps_enabled: true,
                ..default()
            });
        }
        for _ in 0..suns {
            app.world_mut().spawn(DirectionalLight {
                shadow_maps_enabled: true,
                ..default()
            });
        }
        camera_of(&mut app, UVec2::new(1920, 1080));
        app.update();
        assert_eq!(
            sides(&app, light),
            [side],
            "{spots} spot lights, {suns} suns, {theirs} texels"
        );
    }
}

/// A camera whose picture has a size (pixels), somewhere else than others.
fn camera_of(app: &mut App, physical_size: UVec2) {
    let camera = camera(app);
    let aside = Transform::from_xyz(10.0 * camera.index_u32() as f32, 2.0, 0.0);
    app.world_mut().entity_mut(camera).insert(aside);
    app.world_mut().get_mut::<Camera>(camera).unwrap().viewport = Some(Viewport {
        physical_size,
        ..default()
    });
}

#[test]
fn many_cameras_share_what_memory_there_is() {
    let mut app = app();
    app.insert_resource(ShadowMemoryLimit(256 << 20));
    let light = sun(&mut app, ParallelSplitShadows::default());
    for (count, side) in [(4, 2048), (5, 1024), (16, 1024), (17, 512)] {
        while app
            .world_mut()
            .query::<&Camera3d>()
            .iter(app.world())
            .count()
            < count
        {
            camera_of(&mut app, UVec2::new(1920, 1080));
        }
        app.update();
        assert_eq!(sides(&app, light), vec![side; count], "{count}");
    }
}

#[test]
fn a_lack_of_memory_is_told_once() {
    warnings::capture();
    let mut app = app();
    // Other tests with less memory than they ask for must not be heard here: none has so little.
    app.insert_resource(ShadowMemoryLimit(3 << 20));
    let light = sun(&mut app, ParallelSplitShadows::default());
    camera_of(&mut app, UVec2::new(1920, 1080));
    for _ in 0..3 {
        app.update();
        assert_eq!(sides(&app, light), [256]);
    }
    let lines = warnings::peek();
    let told = lines
        .iter()
        .filter(|line| line.contains("more than 3 MiB together"));
    assert_eq!(told.count(), 1, "{lines:#?}");
}

#[test]
fn small_pictures_have_small_maps() {
    for (height, side) in [(1080, 2048), (240, 2048), (120, 1024), (48, 512), (1, 2048)] {
        let mut app = app();
        let light = sun(&mut app, ParallelSplitShadows::default());
        camera_of(&mut app, UVec2::new(64, height));
        app.update();
        assert_eq!(sides(&app, light), [side], "{height}");
    }
}
