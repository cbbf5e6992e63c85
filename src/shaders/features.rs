//! Features of the shader library that not every game needs.

use bevy::{
    ecs::{reflect::ReflectResource, resource::Resource},
    reflect::{Reflect, std_traits::ReflectDefault},
    shader::ShaderDefVal,
};

use crate::config::{
    CascadeFit, DepthDistribution, MapFit, ParallelSplitShadows, ShadowBias, ShadowFilter,
    TexelGrid,
};

/// Parts of the shader that are compiled in, for code that never runs costs registers all the
/// same.
///
/// A part is added when something first asks for it, and stays. All materials' pipelines are then
/// compiled anew, and the frame waits for them: nothing is missing from any picture, but one frame
/// takes long. A game that changes such settings while it is played can insert what it will
/// need beforehand, [`ShaderFeatures::ALL`] or less.
#[derive(Resource, Reflect, Debug, Default, Clone, Copy, PartialEq, Eq)]
#[reflect(Resource, Default, Debug, Clone, PartialEq)]
pub struct ShaderFeatures {
    /// Bevy's own lookups, for directional lights that cast shadows without the plugin.
    pub built_in: bool,
    /// All of [`ShadowBias`] but `Automatic`, and [`DepthDistribution::Linear`].
    pub biases: bool,
    /// [`ShadowFilter::Tent`] and `Hardware2x2`.
    pub tents: bool,
    /// [`ShadowFilter::Temporal`].
    pub temporal: bool,
    /// [`ShadowFilter::Soft`].
    pub soft: bool,
    /// [`CascadeFit::Warped`], `Faces` and `Auto`.
    pub warps: bool,
    /// [`CascadeFit::Faces`].
    pub faces: bool,
    /// [`TexelGrid::Ground`].
    pub sheared: bool,
    /// [`ShadowOverlay`](crate::ShadowOverlay).
    pub overlays: bool,
    /// Lookups in vertex and compute shaders, as a game's own materials may have: they have no derivatives, so
    /// that none is used, surfaces are taken for what their shading normals say, and smooth-shaded meshes
    /// may have teeth where light runs out. Only a game can ask for it.
    pub any_stage: bool,
}

impl ShaderFeatures {
    /// Everything that settings can ask for, and nothing else.
    pub const ALL: Self = Self {
        built_in: true,
        biases: true,
        tents: true,
        temporal: true,
        soft: true,
        warps: true,
        faces: true,
        sheared: true,
        overlays: true,
        any_stage: false,
    };

    /// What a light's settings and its filter need.
    pub(crate) fn needed_by(config: &ParallelSplitShadows, filter: ShadowFilter) -> Self {
        Self {
            biases: config.comparison.bias != ShadowBias::Automatic
                || config.comparison.depth == DepthDistribution::Linear,
            tents: matches!(filter, ShadowFilter::Tent(_) | ShadowFilter::Hardware2x2),
            temporal: matches!(filter, ShadowFilter::Temporal(_)),
            soft: matches!(filter, ShadowFilter::Soft { .. }),
            warps: config.fit.any(|fit| matches!(fit, MapFit::Warped(_))),
            faces: config.fit == CascadeFit::Faces,
            sheared: config.grid == TexelGrid::Ground,
            ..Self::default()
        }
    }

    pub(crate) fn union(self, other: Self) -> Self {
        Self {
            built_in: self.built_in || other.built_in,
            biases: self.biases || other.biases,
            tents: self.tents || other.tents,
            temporal: self.temporal || other.temporal,
            soft: self.soft || other.soft,
            warps: self.warps || other.warps,
            faces: self.faces || other.faces,
            sheared: self.sheared || other.sheared,
            overlays: self.overlays || other.overlays,
            any_stage: self.any_stage || other.any_stage,
        }
    }

    /// The switches of the shader library that leave all else out.
    pub fn defs(self) -> [ShaderDefVal; 10] {
        // Browsers reject derivatives where control flow may differ between pixels.
        let has_derivatives = !self.any_stage && cfg!(not(target_family = "wasm"));
        [
            ("PSSM_BUILT_IN", self.built_in),
            ("PSSM_BIASES", self.biases),
            ("PSSM_TENTS", self.tents),
            ("PSSM_TEMPORAL", self.temporal),
            ("PSSM_SOFT", self.soft),
            ("PSSM_WARPS", self.warps),
            ("PSSM_FACES", self.faces),
            ("PSSM_SHEARED", self.sheared),
            ("PSSM_OVERLAYS", self.overlays),
            ("PSSM_DERIVATIVES", has_derivatives),
        ]
        .map(|(name, set)| ShaderDefVal::Bool(name.into(), set))
    }
}
