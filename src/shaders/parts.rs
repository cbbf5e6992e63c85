//! Parts of the shader library that not every game needs.

use core::sync::atomic::{AtomicBool, Ordering};

use bevy::{
    ecs::{
        change_detection::DetectChangesMut,
        reflect::ReflectResource,
        resource::Resource,
        system::{Query, Res, ResMut},
    },
    light::DirectionalLight,
    platform::sync::Arc,
    reflect::{Reflect, std_traits::ReflectDefault},
    shader::ShaderDefVal,
};

use crate::{
    config::{
        CascadeFit, DepthDistribution, MapFit, ParallelSplitShadows, ShadowBias, ShadowFilter,
    },
    debug::ShadowOverlay,
    systems::ManagedLight,
};

/// Parts of the shader that are compiled in, for code that never runs costs registers all the
/// same.
///
/// A part is added when something first asks for it, and stays. All materials' pipelines are then
/// compiled anew, as when a camera changes its `ShadowFilteringMethod`, and draw nothing until
/// they are. A game that changes such settings while it runs can insert what it will
/// need beforehand, [`ShaderParts::ALL`] or less.
#[derive(Resource, Reflect, Debug, Default, Clone, Copy, PartialEq, Eq)]
#[reflect(Resource, Default, Debug, Clone, PartialEq)]
pub struct ShaderParts {
    /// Bevy's own lookups, for directional lights that cast shadows without the plugin.
    pub stock: bool,
    /// All of [`ShadowBias`] but `Automatic`, and [`DepthDistribution::Linear`].
    pub biases: bool,
    /// [`ShadowFilter::Tent`] and `Hardware2x2`, and what [`CascadeFit`]s other
    /// than `Stable` need, whose texels are not square.
    pub tents: bool,
    /// [`ShadowFilter::Temporal`].
    pub temporal: bool,
    /// [`ShadowFilter::Soft`].
    pub soft: bool,
    /// [`CascadeFit::Warped`], `Faces` and `Auto`.
    pub warps: bool,
    /// [`CascadeFit::Faces`].
    pub faces: bool,
    /// [`ShadowOverlay`].
    pub overlays: bool,
}

impl ShaderParts {
    /// Everything that settings can ask for.
    pub const ALL: Self = Self {
        stock: true,
        biases: true,
        tents: true,
        temporal: true,
        soft: true,
        warps: true,
        faces: true,
        overlays: true,
    };

    fn of_light(config: &ParallelSplitShadows, light: &DirectionalLight) -> Self {
        let filter = config.filter_for(light);
        Self {
            biases: config.bias != ShadowBias::Automatic
                || config.depth == DepthDistribution::Linear,
            tents: matches!(filter, ShadowFilter::Tent(_) | ShadowFilter::Hardware2x2)
                || !config.has_square_texels(),
            temporal: matches!(filter, ShadowFilter::Temporal(_)),
            soft: matches!(filter, ShadowFilter::Soft { .. }),
            warps: config.fit.any(|fit| matches!(fit, MapFit::Warped(_))),
            faces: config.fit == CascadeFit::Faces,
            ..Self::default()
        }
    }

    fn union(self, other: Self) -> Self {
        Self {
            stock: self.stock || other.stock,
            biases: self.biases || other.biases,
            tents: self.tents || other.tents,
            temporal: self.temporal || other.temporal,
            soft: self.soft || other.soft,
            warps: self.warps || other.warps,
            faces: self.faces || other.faces,
            overlays: self.overlays || other.overlays,
        }
    }

    /// The switches of the shader library that leave all else out.
    pub fn defs(self) -> [ShaderDefVal; 8] {
        [
            ("PSSM_STOCK", self.stock),
            ("PSSM_BIASES", self.biases),
            ("PSSM_TENTS", self.tents),
            ("PSSM_TEMPORAL", self.temporal),
            ("PSSM_SOFT", self.soft),
            ("PSSM_WARPS", self.warps),
            ("PSSM_FACES", self.faces),
            ("PSSM_OVERLAYS", self.overlays),
        ]
        .map(|(name, set)| ShaderDefVal::Bool(name.into(), set))
    }
}

/// Set by the render world while it leaves maps of managed lights to Bevy: shared by both worlds.
#[derive(Resource, Debug, Default, Clone)]
pub(crate) struct LeftToBevy(Arc<AtomicBool>);

impl LeftToBevy {
    pub fn set(&self, left: bool) {
        self.0.store(left, Ordering::Relaxed);
    }

    pub fn get(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Adds what this frame's lights need.
pub(crate) fn add_needed_parts(
    mut parts: ResMut<ShaderParts>,
    overlay: Res<ShadowOverlay>,
    left_to_bevy: Res<LeftToBevy>,
    lights: Query<(&DirectionalLight, Option<&ManagedLight>)>,
) {
    let mut needed = *parts;
    needed.overlays |= *overlay != ShadowOverlay::None;
    needed.stock |= left_to_bevy.get();
    for (light, managed) in &lights {
        match managed.and_then(ManagedLight::config) {
            Some(config) => needed = needed.union(ShaderParts::of_light(config, light)),
            None => needed.stock |= light.shadow_maps_enabled,
        }
    }
    parts.set_if_neq(needed);
}
