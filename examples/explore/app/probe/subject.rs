//! What is seen, and all that its pictures depend on.

use bevy::{
    ecs::system::SystemParam,
    light::{
        CascadeShadowConfig, DirectionalLightShadowMap, NotShadowCaster, NotShadowReceiver,
        ShadowFilteringMethod,
    },
    math::{DMat4, DVec3},
    prelude::*,
};
use bevy_pssm::prelude::*;

use super::{
    super::sides::{
        Compare, DARK_LAYER, LIT_LAYER, Pictures, Side, SideCamera, SideSun, Technique,
    },
    SHOTS,
};
use crate::truth::trace::Lens;

/// From where something is seen, and under which sun.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// The camera's lens.
    pub lens: Lens,
    /// In world space (meters).
    pub eye: DVec3,
    /// A unit vector in world space.
    pub to_sun: DVec3,
    /// From the sky's own space to world space; none without a sky.
    pub sky: Option<DMat4>,
}

/// All that the sides' pictures depend on while the scene stands still.
#[derive(Debug, Clone, PartialEq)]
pub struct Subject {
    /// From where.
    pub view: View,
    techniques: [Option<Technique>; 2],
    suns: [Option<SunSettings>; 2],
    filter: ShadowFilteringMethod,
    overlay: ShadowOverlay,
    built_in_size: usize,
}

/// A sun's light, and either technique's settings.
#[derive(Debug, Clone, PartialEq)]
struct SunSettings {
    shadows: Option<ParallelSplitShadows>,
    bounds: Vec<f32>,
    has_maps: bool,
    biases: [f32; 2],
    illuminance: f32,
    color: Color,
}

impl Subject {
    /// Whose shadows a side shows; none if it is not shown, or something else in place of light.
    pub fn technique(&self, side: Side) -> Option<Technique> {
        let technique = self.techniques[side.index()];
        technique.filter(|_| self.shows_light())
    }

    /// Whether there is no overlay.
    pub fn shows_light(&self) -> bool {
        self.overlay == ShadowOverlay::None
    }

    /// Whether the same sides are shown with the same techniques.
    pub fn is_as(&self, compare: &Compare) -> bool {
        self.techniques == techniques(compare)
    }

    pub(super) fn layers(&self) -> [Option<usize>; SHOTS] {
        let [left, right] = Side::BOTH.map(|side| self.technique(side).map(|_| side.layer()));
        [left, right, Some(LIT_LAYER), Some(DARK_LAYER)]
    }
}

/// Of the sides that are shown.
fn techniques(compare: &Compare) -> [Option<Technique>; 2] {
    let [left, right] = compare.techniques;
    [Some(left), compare.wipe.map(|_| right)]
}

/// What is needed to know the [`Subject`].
#[derive(SystemParam)]
pub struct Scenery<'w, 's> {
    compare: Res<'w, Compare>,
    overlay: Res<'w, ShadowOverlay>,
    built_in: Res<'w, DirectionalLightShadowMap>,
    pictures: Option<Res<'w, Pictures>>,
    cameras: Query<
        'w,
        's,
        (
            &'static SideCamera,
            &'static GlobalTransform,
            &'static Projection,
            &'static ShadowFilteringMethod,
        ),
    >,
    suns: Query<
        'w,
        's,
        (
            &'static SideSun,
            &'static GlobalTransform,
            &'static DirectionalLight,
            &'static CascadeShadowConfig,
            Option<&'static ParallelSplitShadows>,
        ),
    >,
    skies: Query<
        'w,
        's,
        &'static GlobalTransform,
        (With<Mesh3d>, With<NotShadowCaster>, With<NotShadowReceiver>),
    >,
}

impl Scenery<'_, '_> {
    /// What is shown now; none while there is nothing.
    pub fn subject(&self) -> Option<Subject> {
        let size = self.pictures.as_ref()?.size;
        if size.min_element() == 0 {
            return None;
        }
        let mut cameras = self.cameras.iter();
        let (_, camera, projection, filter) = cameras.find(|(it, ..)| it.0 == Side::Left)?;
        let mut suns = self.suns.iter();
        let (_, sun, ..) = suns.find(|(it, ..)| it.0 == Side::Left)?;
        let sky = self.skies.single().ok();
        Some(Subject {
            view: View {
                lens: Lens::of(camera, projection, size),
                eye: camera.translation().as_dvec3(),
                to_sun: sun.back().as_dvec3().normalize(),
                sky: sky.map(|sky| sky.to_matrix().as_dmat4()),
            },
            techniques: techniques(&self.compare),
            suns: Side::BOTH.map(|side| self.sun_settings(side)),
            filter: *filter,
            overlay: *self.overlay,
            built_in_size: self.built_in.size,
        })
    }

    fn sun_settings(&self, side: Side) -> Option<SunSettings> {
        if side == Side::Right && self.compare.wipe.is_none() {
            return None;
        }
        let mut suns = self.suns.iter();
        let (_, _, light, config, shadows) = suns.find(|(it, ..)| it.0 == side)?;
        Some(SunSettings {
            shadows: shadows.cloned(),
            bounds: config.bounds.clone(),
            has_maps: light.shadow_maps_enabled,
            biases: [light.shadow_depth_bias, light.shadow_normal_bias],
            illuminance: light.illuminance,
            color: light.color,
        })
    }
}
