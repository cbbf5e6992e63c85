//! What counts as receiving shadows, in an app.

use bevy::{
    camera::{
        primitives::Aabb,
        visibility::{NoAutoAabb, NoCpuCulling, NoFrustumCulling, RenderLayers, VisibilityRange},
    },
    light::{NotShadowCaster, NotShadowReceiver, VolumetricFog, VolumetricLight},
    prelude::*,
};
use bevy_pssm::{ShadowPlans, plan::CascadePlan, prelude::*};

use crate::lights::{app, sun};

/// A camera that looks along −z, a sun that fits maps, and perhaps a box of a metre.
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

    /// Half the greatest extent of all maps (metres), and which there are.
    fn maps(&mut self) -> (f64, usize) {
        let plans = self.plans();
        let maps = plans.iter().filter_map(|plan| plan.map.as_ref());
        let half = maps.clone().map(|map| 1024.0 * map.texel.max_element());
        (half.fold(0.0, f64::max), maps.count())
    }
}

#[derive(Component)]
struct Extra;

#[test]
fn maps_are_fitted_to_what_is_seen() {
    let mut setting = Setting::new(());
    let (half, count) = setting.maps();
    assert!(count >= 1 && half < 2.0, "{half} {count}");
    // Splits are spread over its metre; the last slice reaches on.
    let plans = setting.plans();
    let inner = |plans: &[CascadePlan]| [0, 1, 2].map(|index| plans[index].far);
    assert!(inner(&plans).iter().all(|far| (39.4..40.6).contains(far)));
    assert_eq!(plans[3].far, 500.0);

    // It moves, and so do they.
    setting
        .extra()
        .get_mut::<Transform>()
        .unwrap()
        .translation
        .z = -90.0;
    let plans = setting.plans();
    assert!(inner(&plans).iter().all(|far| (89.4..90.6).contains(far)));
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
    entity.get_mut::<ParallelSplitShadows>().unwrap().focus = ShadowFocus::Off;
    let (half, count) = setting.maps();
    assert!(half > 100.0 && count == 4);
}
