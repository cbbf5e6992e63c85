//! What exists to compare with the literature, or to find out what is to blame.

use bevy::reflect::{Reflect, ReflectDeserialize, ReflectSerialize, std_traits::ReflectDefault};
use serde::{Deserialize, Serialize};

use super::ConfigError;

/// Choices that hardly any game needs to make: the defaults are right where receivers are meshes, and the
/// others are there to compare them with what the literature describes.
#[derive(Reflect, Serialize, Deserialize, Debug, Default, Clone, Copy, PartialEq)]
#[reflect(Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Comparison {
    /// What keeps surfaces from shadowing themselves. Too little shows as stripes on lit
    /// surfaces, too much as light at the feet of casters. Default [`ShadowBias::Automatic`],
    /// which needs no number.
    pub bias: ShadowBias,
    /// How depth grows over a warped map; at no cost. Default
    /// [`DepthDistribution::Hyperbolic`], over which the automatic bias is exact.
    pub depth: DepthDistribution,
    /// Which faces of casters the maps hold; at no cost. The wrong ones show as light under thin
    /// casters. Default [`CasterFaces::Front`].
    pub caster_faces: CasterFaces,
    /// Along what maps are warped. Default [`WarpAxis::View`].
    pub warp_axis: WarpAxis,
    /// Which casters are drawn into a cascade. The picture is the same; the cost is not. Default
    /// [`CasterCulling::Hull`].
    pub culling: CasterCulling,
    /// What maps and casters are for: of a slice, the part in which something can receive a shadow,
    /// or all of it. Stable maps are laid over all of it in any case, but have only the casters that
    /// matter, and are not drawn where there is nothing. Default [`ShadowFocus::Receivers`].
    pub focus: ShadowFocus,
    /// When maps are drawn. The picture is the same; the cost is not. Default
    /// [`MapUpdates::WhenNeeded`].
    pub updates: MapUpdates,
}

/// More than this many meters or texels is a mistake.
const MAX_BIAS: f32 = 1000.0;

/// How much nearer to the light than a surface texels may be without shadowing it.
///
/// What the light's own `shadow_depth_bias` and `shadow_normal_bias` do to it is said at
/// [`ParallelSplitShadows`](crate::ParallelSplitShadows).
#[derive(Reflect, Serialize, Deserialize, Debug, Default, Clone, Copy, PartialEq)]
#[reflect(Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum ShadowBias {
    /// What suffices and no more, by the map's matrix and the surface's plane: each texel is
    /// compared with the plane at its own center
    /// ([`geometry::bias`](crate::geometry::bias)), so that wide filters need no more than
    /// narrow ones and steep surfaces no more than flat ones.
    #[default]
    Automatic,
    /// The same everywhere. Either it is too little on slopes or too much elsewhere.
    Constant {
        /// Towards the light (meters, at least 0).
        #[reflect(@0.0..=MAX_BIAS)]
        meters: f32,
    },
    /// Grows with the depth's slope over the map, as the rasterizer's slope-scaled bias does
    /// (Scherzer and Wimmer, 4.2).
    SlopeScaled {
        /// Times the greatest change of depth from texel to texel (at least 0). Twice the
        /// filter's reach in texels suffices on planes.
        #[reflect(@0.0..=MAX_BIAS)]
        factor: f32,
        /// On top of that (meters, at least 0).
        #[reflect(@0.0..=MAX_BIAS)]
        meters: f32,
    },
    /// Moves the lookup along the surface's normal, as far as the sine of the angle between
    /// normal and light says. Moves shadows off their casters as well.
    NormalOffset {
        /// At a sine of 1 (texels, at least 0).
        #[reflect(@0.0..=MAX_BIAS)]
        texels: f32,
    },
    /// Compares each texel with the surface's plane at its own center, and moves all by the same.
    ReceiverPlane {
        /// Towards the light (meters, at least 0).
        #[reflect(@0.0..=MAX_BIAS)]
        meters: f32,
    },
}

/// How depth grows over a warped map. Without a warp the two are one.
#[derive(Reflect, Serialize, Deserialize, Debug, Default, Clone, Copy, PartialEq, Eq)]
#[reflect(Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum DepthDistribution {
    /// As the warp's division leaves it: planes stay planes, so the automatic bias is exact.
    #[default]
    Hyperbolic,
    /// As though the map held distances along the light (Scherzer and Wimmer, 4.2): taps are
    /// compared with the plane that faces the light. Of use with
    /// [`ShadowBias::Constant`] and [`ShadowBias::SlopeScaled`], which then need less; the
    /// other biases know better planes.
    Linear,
}

/// Which faces of closed casters the maps hold.
#[derive(Reflect, Serialize, Deserialize, Debug, Default, Clone, Copy, PartialEq, Eq)]
#[reflect(Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum CasterFaces {
    /// Those that materials show.
    #[default]
    Front,
    /// Those that materials cull (Scherzer and Wimmer, 4.2): lit surfaces are not in the map
    /// and cannot shadow themselves, but open meshes and ground cast no shadow, and thin ones
    /// leak. The bias turns around, away from the light, so materials without culling shadow
    /// themselves.
    Back,
}

/// Along what maps are warped.
#[derive(Reflect, Serialize, Deserialize, Debug, Default, Clone, Copy, PartialEq, Eq)]
#[reflect(Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum WarpAxis {
    /// The view's direction (Wimmer et al. 2004).
    #[default]
    View,
    /// The direction to the middle of what can receive shadows (Scherzer and Wimmer's middle
    /// vector, to the center of mass instead of the mean of the corners, which jumps).
    BodyCenter,
}

/// What of a slice fitted maps are laid over.
#[derive(Reflect, Serialize, Deserialize, Debug, Default, Clone, Copy, PartialEq, Eq)]
#[reflect(Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum ShadowFocus {
    /// What lies in the bounds of the meshes (`Mesh3d`) that the camera sees in the slice; and splits are
    /// spread over the depths at which there are any, unless a map is stable. Meshes without
    /// bounds and volumetric fog count as being everywhere. Bounds that are too small cut shadows
    /// off, as they cut off the meshes themselves.
    #[default]
    Receivers,
    /// All of it: for receivers that are no meshes, and for measuring.
    Off,
}

/// Which casters are drawn into a cascade. The picture is the same; the cost is not.
#[derive(Reflect, Serialize, Deserialize, Debug, Default, Clone, Copy, PartialEq, Eq)]
#[reflect(Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum CasterCulling {
    /// Casters whose bounds meet the slice's convex hull swept towards the light.
    #[default]
    Hull,
    /// Every caster in the scene: for measuring, and for finding out whether culling is to
    /// blame.
    Off,
}

/// When maps are drawn. The picture is the same; the cost is not.
#[derive(Reflect, Serialize, Deserialize, Debug, Default, Clone, Copy, PartialEq, Eq)]
#[reflect(Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum MapUpdates {
    /// When what is seen leaves what a map covers, a caster that matters to it has changed
    /// ([`ShadowUpdates`](crate::ShadowUpdates)), or the light or its settings have.
    #[default]
    WhenNeeded,
    /// In every frame: for measuring, and for finding out whether holding is to blame.
    EveryFrame,
}

impl ShadowBias {
    pub(super) fn validate(self) -> Result<(), ConfigError> {
        let check = |field, value| ConfigError::check_range(field, value, 0.0..=MAX_BIAS);
        match self {
            Self::Automatic => Ok(()),
            Self::Constant { meters } | Self::ReceiverPlane { meters } => check("meters", meters),
            Self::SlopeScaled { factor, meters } => {
                check("factor", factor)?;
                check("meters", meters)
            }
            Self::NormalOffset { texels } => check("texels", texels),
        }
    }
}
