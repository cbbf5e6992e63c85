//! Lights that are saved while they are managed, and loaded again.

use bevy::{
    ecs::entity::EntityHashMap, light::CascadeShadowConfig, prelude::*,
    world_serialization::serde::WorldDeserializer,
};
use bevy_pssm::{ManagedLight, prelude::*};
use serde::de::DeserializeSeed;

use crate::lights::{app, sun};

/// What the game has set itself.
fn own() -> CascadeShadowConfig {
    CascadeShadowConfig {
        bounds: vec![5.0, 50.0],
        overlap_proportion: 0.3,
        minimum_distance: 0.2,
    }
}

/// A managed light, as a scene's text.
fn save(app: &App, light: Entity) -> String {
    let registry = app.world().resource::<AppTypeRegistry>().read();
    DynamicWorldBuilder::from_world(app.world(), &registry)
        .allow_component::<DirectionalLight>()
        .allow_component::<CascadeShadowConfig>()
        .allow_component::<ParallelSplitShadows>()
        .allow_component::<ManagedLight>()
        .extract_entity(light)
        .build()
        .serialize(&registry)
        .expect("a light can be saved")
}

/// The light of a scene, in an app that does not know it.
fn load(text: &str, saved: Entity) -> (App, Entity) {
    let mut app = app();
    let world = {
        let mut assets = app.world().resource::<AssetServer>().clone();
        let registry = app.world().resource::<AppTypeRegistry>().read();
        let loader = WorldDeserializer {
            type_registry: &registry,
            load_from_path: &mut assets,
        };
        let mut text = ron::de::Deserializer::from_str(text).expect("a scene is RON");
        loader.deserialize(&mut text).expect("a light can be read")
    };
    let mut loaded = EntityHashMap::default();
    world
        .write_to_world(app.world_mut(), &mut loaded)
        .expect("a light can be loaded");
    (app, loaded[&saved])
}

fn settings(app: &App, light: Entity) -> (bool, Vec<f32>) {
    let light = app.world().entity(light);
    let maps = light.get::<DirectionalLight>().expect("a light");
    let config = light.get::<CascadeShadowConfig>().expect("required");
    (maps.shadow_maps_enabled, config.bounds.clone())
}

#[test]
fn loaded_lights_get_back_what_they_were_before() {
    let mut saving = app();
    let saved = sun(&mut saving, (own(), ParallelSplitShadows::default()));
    saving.update();
    let managed = settings(&saving, saved);
    assert!(managed.0 && managed.1.len() == 4, "{managed:?}");

    let (mut app, light) = load(&save(&saving, saved), saved);
    app.update();
    assert_eq!(settings(&app, light), managed);
    app.world_mut()
        .entity_mut(light)
        .remove::<ParallelSplitShadows>();
    app.update();
    assert_eq!(settings(&app, light), (false, own().bounds));
}

/// Where the configuration is not good, Bevy's own shadows are as the game had set them.
#[test]
fn loaded_lights_that_cannot_be_managed_are_bevys() {
    let mut saving = app();
    let saved = sun(&mut saving, (own(), ParallelSplitShadows::default()));
    saving.update();
    let (mut app, light) = load(&save(&saving, saved), saved);
    let mut shadows = app.world_mut().get_mut::<ParallelSplitShadows>(light);
    shadows.as_mut().expect("loaded").far = f32::NAN;
    app.update();
    assert_eq!(settings(&app, light), (false, own().bounds));
}
