//! A scene in a windowless app of its own.

#![allow(dead_code, reason = "shared by several binaries")]

use bevy::{asset::LoadState, light::DirectionalLightShadowMap, prelude::*};
use bevy_pssm::prelude::*;

use crate::{
    headless::Headless,
    scene::{
        CurrentScene, Ground, Imported, SceneCamera, SceneDescription, SceneStats, SceneSun,
        ScenesPlugin,
    },
};

/// Frames after which a scene that has not appeared is given up.
const MAX_STEPS: usize = 5000;

/// A scene with its camera and its sun, which has the scene's shadow preset.
pub struct SceneStage {
    /// The app.
    pub headless: Headless,
    /// The camera.
    pub camera: Entity,
    /// The sun.
    pub sun: Entity,
    /// What the scene was built from.
    pub description: SceneDescription,
    /// What everything stands on.
    pub ground: Ground,
}

/// The plugin's settings while Bevy's own shadows are shown.
#[derive(Component)]
struct KeptShadows(ParallelSplitShadows);

impl SceneStage {
    /// Loads a scene. `setup` adds further plugins; `camera` goes to the camera.
    ///
    /// # Panics
    /// If the scene or its preset does not load.
    pub fn new(name: &str, size: UVec2, setup: impl FnOnce(&mut App), camera: impl Bundle) -> Self {
        let headless = Headless::new(size, |app| {
            app.add_plugins((PssmPlugin, ScenesPlugin));
            setup(app);
        });
        let stage = Self::in_app(headless, camera, |world, current| {
            current.load(name, world.resource::<AssetServer>());
        });
        stage.unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// As [`SceneStage::new`], in an app that has `PssmPlugin` and `ScenesPlugin` already.
    /// `choose` says which scene.
    ///
    /// # Errors
    /// If the scene or its preset does not load.
    pub fn in_app(
        mut headless: Headless,
        camera: impl Bundle,
        choose: impl FnOnce(&mut World, &mut CurrentScene),
    ) -> Result<Self, String> {
        let target = headless.render_target();
        let world = headless.app.world_mut();
        let camera = world
            .spawn((Camera3d::default(), SceneCamera, target, camera))
            .id();
        world.resource_scope(|world, mut current: Mut<CurrentScene>| choose(world, &mut current));
        for _ in 0..MAX_STEPS {
            headless.step();
            let world = headless.app.world_mut();
            let mut suns =
                world.query_filtered::<Entity, (With<SceneSun>, With<ParallelSplitShadows>)>();
            let sun = suns.iter(world).next();
            let handle = &world.resource::<CurrentScene>().handle;
            let presets = world.try_query::<&ShadowPreset>();
            let preset = presets.and_then(|mut presets| Some(presets.iter(world).next()?.0.id()));
            let assets = world.resource::<AssetServer>();
            for asset in [Some(handle.id().untyped()), preset.map(AssetId::untyped)] {
                let state = asset.and_then(|asset| assets.get_load_state(asset));
                if let Some(LoadState::Failed(error)) = state {
                    return Err(error.to_string());
                }
            }
            let Some(sun) = sun else {
                continue;
            };
            let mut waiting = world.query_filtered::<(), (With<Imported>, Without<Children>)>();
            if waiting.iter(world).next().is_some() {
                continue;
            }
            let handle = &world.resource::<CurrentScene>().handle;
            let scenes = world.resource::<Assets<SceneDescription>>();
            let description = scenes.get(handle).cloned();
            let mut stage = Self {
                camera,
                sun,
                description: description.expect("the scene was spawned from it"),
                ground: world.resource::<Ground>().clone(),
                headless,
            };
            // What is counted is what maps cost that are drawn.
            stage.configure(|shadows| shadows.comparison.updates = MapUpdates::EveryFrame);
            return Ok(stage);
        }
        Err("the scene or its preset did not load".to_owned())
    }

    /// The app's world.
    pub fn world(&mut self) -> &mut World {
        self.headless.app.world_mut()
    }

    /// How much there is.
    pub fn stats(&self) -> SceneStats {
        *self.headless.app.world().resource::<SceneStats>()
    }

    /// Height of the ground (meters).
    pub fn ground(&self, x: f32, z: f32) -> f32 {
        self.ground.height(x, z)
    }

    /// Puts the camera at one of the scene's poses.
    pub fn stand_at_pose(&mut self, index: usize) {
        let place = self.pose(index);
        self.stand_at(place);
    }

    /// One of the scene's poses.
    pub fn pose(&self, index: usize) -> Transform {
        let path = &self.description.camera;
        path.pose(index, |x, z| self.ground(x, z))
    }

    /// Puts the camera somewhere.
    pub fn stand_at(&mut self, place: Transform) {
        let camera = self.camera;
        self.world().entity_mut(camera).insert(place);
    }

    /// Chooses between the plugin's shadows and Bevy's own, with maps of `stock_size` texels
    /// per side.
    pub fn use_plugin(&mut self, ours: bool, stock_size: usize) {
        let sun = self.sun;
        let mut sun = self.world().entity_mut(sun);
        if ours {
            let kept = sun.take::<KeptShadows>();
            sun.insert_if_new(kept.map(|kept| kept.0).unwrap_or_default());
        } else if let Some(shadows) = sun.take::<ParallelSplitShadows>() {
            sun.insert(KeptShadows(shadows));
        }
        self.world()
            .insert_resource(DirectionalLightShadowMap { size: stock_size });
    }

    /// Changes the sun's shadows.
    pub fn configure(&mut self, change: impl FnOnce(&mut ParallelSplitShadows)) {
        let sun = self.sun;
        if let Some(mut shadows) = self.world().get_mut::<ParallelSplitShadows>(sun) {
            change(&mut shadows);
        }
    }

    /// Switches the sun's shadow maps.
    pub fn set_shadow_maps(&mut self, enabled: bool) {
        let sun = self.sun;
        if let Some(mut light) = self.world().get_mut::<DirectionalLight>(sun) {
            light.shadow_maps_enabled = enabled;
        }
    }
}
