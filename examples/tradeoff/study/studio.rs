//! A scene before a camera, photographed in linear light.

use bevy::{
    core_pipeline::tonemapping::{DebandDither, Tonemapping},
    diagnostic::DiagnosticsStore,
    light::{CascadeShadowConfig, DirectionalLightShadowMap},
    math::DVec3,
    pbr::DistanceFog,
    platform::time::Instant,
    prelude::*,
    render::{render_resource::TextureFormat, settings::WgpuSettings},
};
use bevy_pssm::prelude::*;

use super::{
    cost::{Frame, time_systems},
    flicker::NudgePlugin,
    light::{Picture, Reference},
    settings::{Setting, Technique},
    trace::Lens,
};
use crate::{
    headless::Headless,
    measure::{MeasurePlugin, counts},
};

/// What the camera must have for pictures to be linear in the sun's light.
pub fn linear_camera() -> impl Bundle {
    (Tonemapping::None, DebandDither::Disabled, Msaa::Off)
}

/// An app with the plugin, whose pictures can be measured.
pub fn measurable_app(size: UVec2, setup: impl FnOnce(&mut App)) -> Headless {
    bevys_app(size, |app| {
        app.add_plugins(PssmPlugin);
        setup(app);
    })
}

/// The same without the plugin.
pub fn bevys_app(size: UVec2, setup: impl FnOnce(&mut App)) -> Headless {
    Headless::with_format(
        size,
        TextureFormat::Rgba16Float,
        WgpuSettings::default(),
        |app| {
            let height = size.y as f32;
            app.add_plugins((MeasurePlugin, NudgePlugin { height }));
            setup(app);
        },
    )
}

/// A scene before a camera. Nothing in it moves by itself.
pub struct Studio {
    /// The app.
    pub headless: Headless,
    /// The camera, with [`linear_camera`]'s components.
    pub camera: Entity,
    /// The sun, which has `ParallelSplitShadows`.
    pub sun: Entity,
    /// Pixels.
    pub size: UVec2,
    /// What the last frame cost; what it says of the GPU is two frames old.
    pub cost: Frame,
    ours: bool,
}

impl Studio {
    /// Takes over an app of [`measurable_app`].
    pub fn new(headless: Headless, camera: Entity, sun: Entity, size: UVec2) -> Self {
        let mut studio = Self {
            headless,
            camera,
            sun,
            size,
            cost: Frame::default(),
            ours: true,
        };
        let world = studio.world();
        world
            .entity_mut(camera)
            .insert(linear_camera())
            .remove::<DistanceFog>();
        studio
    }

    /// The app's world.
    pub fn world(&mut self) -> &mut World {
        self.headless.app.world_mut()
    }

    /// Puts the camera somewhere, with a lens, under a sun.
    pub fn place(&mut self, stance: &Stance) {
        let (camera, sun, stance) = (self.camera, self.sun, stance.clone());
        let world = self.world();
        world
            .entity_mut(camera)
            .insert((stance.camera, stance.projection));
        world.entity_mut(sun).insert(stance.sun);
    }

    /// How the camera and the sun stand.
    pub fn stance(&mut self) -> Stance {
        let (camera, sun) = (self.camera, self.sun);
        let world = self.world();
        let of = |entity| world.get::<Transform>(entity).copied().unwrap_or_default();
        Stance {
            camera: of(camera),
            projection: world.get::<Projection>(camera).cloned().unwrap_or_default(),
            sun: of(sun),
        }
    }

    /// The lens of the last frame.
    pub fn lens(&mut self) -> Lens {
        let (camera, size) = (self.camera, self.size);
        let world = self.world();
        let transform = world.get::<GlobalTransform>(camera).copied();
        let projection = world.get::<Projection>(camera).cloned();
        Lens::of(
            &transform.unwrap_or_default(),
            &projection.unwrap_or_default(),
            size,
        )
    }

    /// Unit vector to the sun, in world space, of the last frame.
    pub fn sun_direction(&mut self) -> DVec3 {
        let sun = self.sun;
        let transform = self.world().get::<GlobalTransform>(sun).copied();
        transform.unwrap_or_default().back().as_dvec3().normalize()
    }

    /// The next frame.
    pub fn shoot(&mut self) -> Picture {
        let since = Instant::now();
        self.headless.step();
        let (ours, camera, sun) = (self.ours, self.camera, self.sun);
        let world = self.world();
        let gpu = counts(world.resource::<DiagnosticsStore>(), ours, since);
        let mut cost = Frame::of(world, gpu, camera, sun, ours);
        cost.cpu = time_systems(world, ours);
        self.cost = cost;
        self.develop()
    }

    /// The next frame, and no costs: systems run once.
    pub fn expose(&mut self) -> Picture {
        self.headless.step();
        self.develop()
    }

    /// A frame that is not drawn, but in which maps are laid.
    pub fn pass(&mut self, stance: &Stance) {
        self.place(stance);
        self.headless.app.main_mut().update();
    }

    fn develop(&self) -> Picture {
        Picture::from_bytes(&self.headless.read_back())
    }

    /// The picture with and without the sun, where the camera stands.
    pub fn reference(&mut self) -> Reference {
        let sun = self.sun;
        let set = |studio: &mut Self, maps: bool, lux: f32| {
            if let Some(mut light) = studio.world().get_mut::<DirectionalLight>(sun) {
                light.shadow_maps_enabled = maps;
                light.illuminance = lux;
            }
        };
        let lux = self
            .world()
            .get::<DirectionalLight>(sun)
            .map_or(0.0, |light| light.illuminance);
        set(self, false, lux);
        let lit = self.shoot();
        set(self, false, 0.0);
        let dark = self.shoot();
        set(self, true, lux);
        Reference { lit, dark }
    }

    /// Whether the plugin's shadows are in force.
    pub fn is_ours(&self) -> bool {
        self.ours
    }

    /// Brings a setting into force.
    pub fn apply(&mut self, setting: &Setting) {
        let sun = self.sun;
        self.ours = matches!(setting.technique, Technique::Pssm(_));
        // Settings before this one have not left their parts in the shader.
        if let Some(mut parts) = self.world().get_resource_mut::<ShaderFeatures>() {
            *parts = ShaderFeatures::default();
        }
        match &setting.technique {
            Technique::Pssm(config) => {
                let mut config = config.clone();
                // What is measured is what maps cost that are drawn.
                config.comparison.updates = MapUpdates::EveryFrame;
                let world = self.world();
                world.entity_mut(sun).insert(config);
                if let Some(mut light) = world.get_mut::<DirectionalLight>(sun) {
                    light.shadow_depth_bias = DirectionalLight::DEFAULT_SHADOW_DEPTH_BIAS;
                    light.shadow_normal_bias = DirectionalLight::DEFAULT_SHADOW_NORMAL_BIAS;
                }
            }
            Technique::Bevy(stock) => {
                let mut sun_entity = self.world().entity_mut(sun);
                if sun_entity.take::<ParallelSplitShadows>().is_some() {
                    // The plugin restores what it found before Bevy's own can be changed.
                    self.headless.step();
                }
                let world = self.world();
                world.insert_resource(DirectionalLightShadowMap {
                    size: stock.map_size as usize,
                });
                let cascades: CascadeShadowConfig = stock.cascades();
                world.entity_mut(sun).insert(cascades);
                if let Some(mut light) = world.get_mut::<DirectionalLight>(sun) {
                    light.shadow_maps_enabled = true;
                    light.shadow_depth_bias = stock.depth_bias;
                    light.shadow_normal_bias = stock.normal_bias;
                }
            }
        }
    }
}

/// How camera and sun stand.
#[derive(Clone, Debug)]
pub struct Stance {
    /// The camera's place.
    pub camera: Transform,
    /// Its lens.
    pub projection: Projection,
    /// The sun's direction.
    pub sun: Transform,
}
