//! What counts as receiving shadows, in an app.

use core::time::Duration;
use std::thread;

use bevy::{
    asset::RenderAssetUsages,
    camera::{
        primitives::Aabb,
        visibility::{NoAutoAabb, NoCpuCulling, NoFrustumCulling, RenderLayers, VisibilityRange},
    },
    light::{NotShadowCaster, NotShadowReceiver, VolumetricFog, VolumetricLight},
    math::DVec3,
    mesh::VertexAttributeValues,
    prelude::*,
};
use bevy_pssm::{
    CasterCascades, ShadowPlans,
    geometry::hysteresis::SHRINK_DELAY,
    plan::CascadePlan,
    prelude::*,
    systems::{DisplacedMeshes, MeshBoxes},
};

use crate::lights::{app, sun};

/// A camera that looks along −z, a sun that fits maps, and perhaps a box of a meter.
struct Setting {
    app: App,
    view: Entity,
    light: Entity,
}

impl Setting {
    fn new(extra: impl Bundle) -> Self {
        let mut app = app();
        let view = app.world_mut().spawn(Camera3d::default()).id();
        let config = ParallelSplitShadows {
            fit: CascadeFit::Tight,
            slack: 0.0,
            ..default()
        };
        let light = sun(&mut app, config);
        app.world_mut().spawn((
            Mesh3d::default(),
            NotShadowCaster,
            Aabb::from_min_max(Vec3::splat(-0.5), Vec3::splat(0.5)),
            Transform::from_xyz(0.0, 0.0, -40.0),
            Visibility::default(),
            Extra,
        ));
        let mut setting = Self { app, view, light };
        setting.extra().insert(extra);
        setting
    }

    fn extra(&mut self) -> EntityWorldMut<'_> {
        let world = self.app.world_mut();
        let mut extras = world.query_filtered::<Entity, With<Extra>>();
        let entity = extras.single(world).expect("one");
        world.entity_mut(entity)
    }

    fn plans(&mut self) -> Vec<CascadePlan> {
        self.app.update();
        let plans = self.app.world().get::<ShadowPlans>(self.light).unwrap();
        plans.views[&self.view].clone()
    }

    /// Half the greatest extent of all maps (meters), and which there are.
    fn maps(&mut self) -> (f64, usize) {
        let plans = self.plans();
        let maps = plans.iter().filter_map(|plan| plan.map.as_ref());
        let half = maps.clone().map(|map| 1024.0 * map.texel.max_element());
        (half.fold(0.0, f64::max), maps.count())
    }
}

#[derive(Component)]
struct Extra;

/// Lights that reach less far take nothing from one that sees it.
#[test]
fn each_light_has_what_is_in_its_range() {
    let mut setting = Setting::new(());
    let near = ParallelSplitShadows {
        far: 20.0,
        ..default()
    };
    let near = sun(&mut setting.app, near);
    assert_eq!(setting.maps().1, 1);
    let plans = setting.app.world().get::<ShadowPlans>(near).unwrap();
    let mut of_near = plans.views[&setting.view].iter();
    assert!(of_near.all(|plan| plan.map.is_none()));
}

/// As large as it is, it may reach from beside a receiver to over it.
#[test]
fn casters_that_a_vertex_shader_moves_are_culled_with_room() {
    let mut setting = Setting::new(());
    let caster = (
        Mesh3d::default(),
        NotShadowReceiver,
        Aabb::from_min_max(Vec3::splat(-50.0), Vec3::splat(50.0)),
        Transform::from_xyz(0.0, 0.0, -139.0),
        Visibility::default(),
    );
    let caster = setting.app.world_mut().spawn(caster).id();
    // What moves is not culled with the others where it is drawn over them.
    for (moves, updates) in [
        (false, MapUpdates::WhenNeeded),
        (true, MapUpdates::WhenNeeded),
        (true, MapUpdates::EveryFrame),
        (false, MapUpdates::EveryFrame),
    ] {
        let mut light = setting.app.world_mut().entity_mut(setting.light);
        let mut config = light.get_mut::<ParallelSplitShadows>().unwrap();
        config.comparison.updates = updates;
        let displaced = setting.app.world().resource::<DisplacedMeshes>();
        displaced.update(|known| {
            if moves {
                known.insert(caster);
            } else {
                known.clear();
            }
        });
        setting.plans();
        let casters = setting.app.world().get::<CasterCascades>(setting.light);
        let casters = casters.unwrap();
        let (views, moving) = (
            &casters.views[&setting.view],
            casters.moving.get(&setting.view),
        );
        let mut held = views.iter().chain(moving.into_iter().flatten());
        assert_eq!(held.any(|(held, _)| *held == caster), moves);
    }
}

#[test]
fn maps_are_fitted_to_what_is_seen() {
    let mut setting = Setting::new(());
    let (half, count) = setting.maps();
    assert!(count >= 1 && half < 2.0, "{half} {count}");
    // Its meter is not worth more than one map.
    assert_eq!(count, 1);
    let covers = |plans: &[CascadePlan], z: f64| {
        let map = plans[0].map.as_ref().expect("something is seen");
        let ndc = map.clip_from_world.project_point3(DVec3::new(0.0, 0.0, z));
        ndc.truncate().abs().max_element() < 1.0
    };
    let plans = setting.plans();
    assert_eq!(plans[0].far, 500.0);
    assert!(covers(&plans, -40.0) && !covers(&plans, -90.0));

    // It moves, and so do they.
    setting
        .extra()
        .get_mut::<Transform>()
        .unwrap()
        .translation
        .z = -90.0;
    let plans = setting.plans();
    assert!(covers(&plans, -90.0) && !covers(&plans, -40.0));
}

#[test]
fn what_is_not_seen_or_receives_nothing_needs_no_map() {
    let away = Transform::from_xyz(0.0, 0.0, 40.0);
    assert_eq!(Setting::new(Visibility::Hidden).maps().1, 0);
    assert_eq!(Setting::new(RenderLayers::layer(3)).maps().1, 0);
    assert_eq!(Setting::new(NotShadowReceiver).maps().1, 0);
    assert_eq!(
        Setting::new(VisibilityRange::abrupt(50.0, 90.0)).maps().1,
        0
    );
    assert_eq!(Setting::new(away).maps().1, 0);
    assert_eq!(
        Setting::new(Transform::from_xyz(f32::NAN, 0.0, 0.0))
            .maps()
            .1,
        0
    );
    assert!(Setting::new(VisibilityRange::abrupt(10.0, 90.0)).maps().1 > 0);
}

#[test]
fn what_has_no_bounds_is_everywhere() {
    let everywhere = |setting: &mut Setting| {
        let (half, count) = setting.maps();
        half > 100.0 && count == 4 && setting.plans()[3].far == 500.0
    };
    assert!(everywhere(&mut Setting::new(NoFrustumCulling)));
    let mut setting = Setting::new(());
    setting.extra().remove::<Aabb>();
    assert_eq!(
        setting.maps().1,
        0,
        "a mesh that has not loaded is not drawn"
    );
    setting.extra().insert(NoAutoAabb);
    assert!(everywhere(&mut setting));

    // What only the GPU culls is known by its bounds.
    let mut setting = Setting::new(NoCpuCulling);
    assert!(!everywhere(&mut setting));
    assert!(setting.maps().1 > 0);
}

#[test]
fn fog_receives_shadows_everywhere() {
    let mut setting = Setting::new(());
    let (view, light) = (setting.view, setting.light);
    let world = setting.app.world_mut();
    world.entity_mut(view).insert(VolumetricFog::default());
    assert!(setting.maps().0 < 2.0, "the light is not in the fog");
    setting
        .app
        .world_mut()
        .entity_mut(light)
        .insert(VolumetricLight);
    let (half, count) = setting.maps();
    assert!(half > 100.0 && count == 4);
}

#[test]
fn focus_can_be_switched_off() {
    let mut setting = Setting::new(());
    let light = setting.light;
    let mut entity = setting.app.world_mut().entity_mut(light);
    entity
        .get_mut::<ParallelSplitShadows>()
        .unwrap()
        .comparison
        .focus = ShadowFocus::Off;
    let (half, count) = setting.maps();
    assert!(half > 100.0 && count == 4);
}

/// Ground of one piece, flat but for a peak behind the camera, which stands over it and looks down.
fn terrain(subdivisions: u32) -> Mesh {
    let mut mesh = Plane3d::default()
        .mesh()
        .size(400.0, 400.0)
        .subdivisions(subdivisions)
        .build();
    if let Some(VertexAttributeValues::Float32x3(places)) =
        mesh.attribute_mut(Mesh::ATTRIBUTE_POSITION)
    {
        places[0][1] = 300.0;
    }
    mesh
}

/// The parts of a huge mesh are worked out beside the game; until they are known its own box counts, and nothing
/// stalls.
#[test]
fn parts_of_huge_meshes_are_worked_out_beside_the_game() {
    for usage in [RenderAssetUsages::all(), RenderAssetUsages::RENDER_WORLD] {
        parts_are_known_some_time_later(usage);
    }
}

fn parts_are_known_some_time_later(usage: RenderAssetUsages) {
    let mut setting = Setting::new(NotShadowReceiver);
    let (view, world) = (setting.view, setting.app.world_mut());
    let down = Transform::from_xyz(0.0, 60.0, 0.0).looking_to(Vec3::new(0.0, -1.0, -1.0), Vec3::Y);
    world.entity_mut(view).insert(down);
    let first_far = |setting: &mut Setting| setting.plans()[0].far;
    let add = |setting: &mut Setting, subdivisions: u32| {
        let world = setting.app.world_mut();
        let mut mesh = terrain(subdivisions);
        mesh.asset_usage = usage;
        let mesh = world.resource_mut::<Assets<Mesh>>().add(mesh);
        world.spawn(Mesh3d(mesh)).id()
    };
    let small = add(&mut setting, 40);
    let by_parts = first_far(&mut setting);
    setting.app.world_mut().despawn(small);
    // Some 400,000 triangles.
    add(&mut setting, 450);
    let at_first = first_far(&mut setting);
    assert!(at_first < by_parts, "{at_first} {by_parts}");
    if usage == RenderAssetUsages::RENDER_WORLD {
        // As a renderer does.
        let mut meshes = setting.app.world_mut().resource_mut::<Assets<Mesh>>();
        let huge = meshes
            .iter()
            .find(|(_, mesh)| mesh.count_vertices() > 100_000);
        let huge = huge.expect("it is there").0;
        let taken = meshes.get_mut_untracked(huge).map(Mesh::take_gpu_data);
        assert!(matches!(taken, Some(Ok(_))));
    }
    let are_known = (0..1000).any(|_| {
        thread::sleep(Duration::from_millis(10));
        first_far(&mut setting) > 60.0
    });
    assert!(are_known, "parts are known in the end");
}

/// However flat or sheared a mesh is, and however large its margin, it receives shadows.
/// Meshes whose parts nobody has asked for may change in every frame.
#[test]
fn meshes_that_change_elsewhere_unsettle_nothing() {
    let mut setting = Setting::new(());
    let mut meshes = setting.app.world_mut().resource_mut::<Assets<Mesh>>();
    let cloth = meshes.add(terrain(60));
    for _ in 0..3 {
        let mut meshes = setting.app.world_mut().resource_mut::<Assets<Mesh>>();
        meshes.get_mut(&cloth).unwrap().compute_smooth_normals();
        setting.app.update();
        assert!(setting.app.world().resource::<MeshBoxes>().are_settled());
    }
    // One that the eye is in is asked for.
    setting.app.world_mut().spawn(Mesh3d(cloth.clone()));
    for _ in 0..3 {
        setting.app.update();
    }
    let mut meshes = setting.app.world_mut().resource_mut::<Assets<Mesh>>();
    meshes.get_mut(&cloth).unwrap().compute_smooth_normals();
    setting.app.update();
    setting.app.update();
    assert!(!setting.app.world().resource::<MeshBoxes>().are_settled());
}

#[test]
fn any_mesh_may_have_a_margin() {
    for (scale, margin) in [
        (Vec3::new(1.0, 0.0, 1.0), 6.0),
        (Vec3::new(4.0, 1.0, 1.0), 6.0),
        (Vec3::ONE, f32::INFINITY),
    ] {
        let is_seen = || {
            let mut setting = Setting::new(NotShadowReceiver);
            let world = setting.app.world_mut();
            let parent = world
                .spawn((
                    Transform::from_xyz(0.0, -5.0, -30.0).with_scale(scale),
                    Visibility::default(),
                ))
                .id();
            let mesh = world
                .resource_mut::<Assets<Mesh>>()
                .add(Cuboid::from_length(1.0));
            let turned = Transform::from_rotation(Quat::from_rotation_z(0.7));
            world.spawn((Mesh3d(mesh), turned, ChildOf(parent), BoundsMargin(margin)));
            setting.plans().iter().any(|plan| plan.map.is_some())
        };
        assert!(is_seen(), "{scale} {margin}");
    }
}

#[test]
fn large_meshes_are_known_by_their_parts() {
    let mut setting = Setting::new(NotShadowReceiver);
    let (view, world) = (setting.view, setting.app.world_mut());
    let down = Transform::from_xyz(0.0, 60.0, 0.0).looking_to(Vec3::new(0.0, -1.0, -1.0), Vec3::Y);
    world.entity_mut(view).insert(down);
    let mesh = world.resource_mut::<Assets<Mesh>>().add(terrain(40));
    let ground = world
        .spawn((Mesh3d(mesh.clone()), Transform::default()))
        .id();
    let starts = |setting: &mut Setting| {
        let plans = setting.plans();
        let first = plans[0].clone();
        (first.map.is_some(), first.far)
    };
    let by_parts = starts(&mut setting);
    assert!(by_parts.0 && by_parts.1 > 60.0, "{by_parts:?}");

    // It changes.
    let change = |setting: &mut Setting, height: f32| {
        let mut meshes = setting.app.world_mut().resource_mut::<Assets<Mesh>>();
        let mut mesh = meshes.get_mut(&mesh).unwrap();
        let places = mesh.attribute_mut(Mesh::ATTRIBUTE_POSITION);
        if let Some(VertexAttributeValues::Float32x3(places)) = places {
            // In the middle, below the camera, and a little before it.
            places[21 * 42 + 20][1] = height;
            places[18 * 42 + 20][1] = height;
        }
    };
    let rest = |setting: &mut Setting| (0..=SHRINK_DELAY).for_each(|_| setting.app.update());
    change(&mut setting, 50.0);
    rest(&mut setting);
    assert!(starts(&mut setting).1 < by_parts.1);
    change(&mut setting, 0.0);
    // While it changes it has none.
    assert!(starts(&mut setting).1 < by_parts.1);
    rest(&mut setting);
    assert_eq!(starts(&mut setting), by_parts);

    // A box of its own says that something else moves it.
    let world = setting.app.world_mut();
    let larger = Aabb::from_min_max(
        Vec3::new(-200.0, -1.0, -200.0),
        Vec3::new(200.0, 301.0, 200.0),
    );
    world.entity_mut(ground).insert((larger, NoAutoAabb));
    assert!(starts(&mut setting).1 < by_parts.1);
}
