//! The component that holds a light's whole shadow configuration, its checks and its RON form.

mod error;
mod filter;
mod fit;
mod preset;

pub use error::ConfigError;
pub use filter::{
    CascadeTransition, CasterFaces, DepthDistribution, FilterRadius, MAX_FILTER_TEXELS, ShadowBias,
    ShadowFilter,
};
pub use fit::{CascadeFit, MapFit, MapWarp, Preference, ShadowFocus, WarpAxis};
pub use preset::{ShadowPreset, ShadowPresetError, ShadowPresetLoader};

pub(crate) use filter::{GAUSSIAN_TEXELS, TEMPORAL_TEXELS, depth_multiplier, normal_multiplier};
pub(crate) use preset::MaxMapSize;

use bevy::{
    asset::Asset,
    ecs::{component::Component, reflect::ReflectComponent},
    reflect::{Reflect, ReflectDeserialize, ReflectSerialize, std_traits::ReflectDefault},
};
use glam::UVec2;
use serde::{Deserialize, Serialize};

use crate::systems::ManagedLight;

/// The most cascades a light can have: the length of Bevy's uniform array.
pub const MAX_CASCADES: usize = 4;

/// The smallest map that still leaves room for the filter's guard texels.
pub const MIN_MAP_SIZE: u32 = 64;

/// Gives a [`DirectionalLight`](bevy::light::DirectionalLight) parallel-split shadow maps.
///
/// Adding the component is enough: it switches the light's shadow maps on and takes their place
/// on every active 3D camera; `shadow_maps_enabled = false` afterwards means no shadows.
/// Removing the component brings Bevy's own shadows back exactly as they were configured.
/// `CascadeShadowConfig` is overwritten while it is present.
///
/// The cameras' `ShadowFilteringMethod`, `NotShadowCaster` and `NotShadowReceiver` keep their
/// meaning. `DirectionalLight::shadow_depth_bias` and `shadow_normal_bias` multiply the bias
/// around Bevy's defaults ([`ShadowBias`]): leave them alone.
///
/// A value outside its range is reported once, and the last good configuration stays in force.
///
/// ```
/// # use bevy_pssm::prelude::*;
/// let shadows = ParallelSplitShadows {
///     far: 800.0,
///     splits: SplitScheme::Logarithmic,
///     map_size: MapSize::Halving(4096),
///     ..Default::default()
/// };
/// assert!(shadows.validate(16384).is_ok());
/// ```
#[derive(Component, Asset, Reflect, Serialize, Deserialize, Debug, Clone, PartialEq)]
#[reflect(Component, Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[require(ManagedLight)]
pub struct ParallelSplitShadows {
    /// `false` hands the light back to Bevy's own shadows until it is `true` again. Costs
    /// nothing while `false`. Default `true`.
    pub enabled: bool,
    /// Number of cascades, 1 to 4. Each costs one shadow pass; too few show as blocky shadows
    /// near the camera. Default 4: with 3 up to two fifths more pixels are wrong in the example
    /// scenes, for a quarter to a third fewer fragments drawn.
    #[reflect(@1..=4_u32)]
    pub cascades: u32,
    /// Where the split scheme starts (meters from the eye, above zero). Surfaces nearer than
    /// this are still shadowed: the first cascade reaches to the eye at no cost. Too small
    /// wastes the first cascades on the ground at the camera's feet. Default 1 m.
    pub near: f64,
    /// Where shadows end (meters from the eye, above [`near`](Self::near)). Farther costs
    /// sharpness in every cascade and draws more casters; nearer makes shadows fade out in
    /// plain sight. Default 500 m.
    pub far: f64,
    /// Where cascades end in between. Default `Practical { lambda: 0.9 }`, with the first
    /// split at 17 m. 0.8 has 11 to 17 % fewer wrong pixels in three of the four example
    /// scenes, but twice the stains in the one that has figures close to the camera; 0.95 and 1
    /// have more wrong pixels.
    pub splits: SplitScheme,
    /// Share of each slice, at its far end, over which one cascade is blended into the next
    /// (0 to 0.5). Pixels there sample two maps; 0 shows a hard line where sharpness changes.
    /// Default 0.1, for which 0.03 % more of the pixels are wrong at most.
    #[reflect(@0.0..=0.5_f64)]
    pub blend: f64,
    /// Share of the last slice over which shadows fade to light (0 to 1). Free; 0 shows a hard
    /// line that travels with the camera. Default 0.2, for which 0.02 % more of the pixels are
    /// wrong at most.
    #[reflect(@0.0..=1.0_f64)]
    pub fade: f64,
    /// How maps are laid over their slices. Default [`CascadeFit::Stable`]: under a slow pan or turn
    /// no pixel ever changes. In the example scenes [`CascadeFit::Tight`] has 43 to 68 % fewer wrong
    /// pixels, and rests but for moments; [`CascadeFit::Warped`] has 52 to 71 % fewer, and 0.04 to
    /// 0.12 % of all pixels change with every third of a pixel.
    pub fit: CascadeFit,
    /// What maps and casters are for: of a slice, the part in which something can receive a shadow,
    /// or all of it. Stable maps are laid over all of it in any case, but have only the casters that
    /// matter, and are not drawn where there is nothing. Default [`ShadowFocus::Receivers`].
    pub focus: ShadowFocus,
    /// How much larger than needed fitted maps, the boxes that they are fitted to and the range of
    /// depths that is split may be, so as not to change with every frame (share, 0 to 1). 0 is
    /// sharpest and crawls whenever anything moves; [`CascadeFit::Stable`] needs none. Default 0.1,
    /// with which edges of tight maps rest in slow motion, for up to a sixth more wrong pixels.
    #[reflect(@0.0..=1.0_f64)]
    pub slack: f64,
    /// Along what maps are warped. Default [`WarpAxis::View`].
    pub warp_axis: WarpAxis,
    /// Texels per side of each cascade's map. Default `Same(2048)`: 16 MiB and one clear each,
    /// for every camera. 1024 leaves 1.6 to 2.3 times as many wrong pixels, 4096 0.4 to 0.6
    /// times, for a quarter and four times the memory.
    pub map_size: MapSize,
    /// Which casters are drawn into a cascade. Default [`CasterCulling::Hull`].
    pub culling: CasterCulling,
    /// What keeps surfaces from shadowing themselves. Too little shows as stripes on lit
    /// surfaces, too much as light at the feet of casters. Default [`ShadowBias::Automatic`],
    /// which needs no number, and with which 17 to 45 % fewer pixels are wrong in the example
    /// scenes than with the best of the others.
    pub bias: ShadowBias,
    /// How soft the edges of shadows are. Too narrow shows texels, too wide moves edges off the
    /// truth; costs grow with the taps. Default [`ShadowFilter::Camera`]: in the example scenes
    /// a tent of 1.5 texels has 11 to 20 % fewer wrong pixels than the Gaussian, one of 4 has
    /// 12 to 32 % more.
    pub filter: ShadowFilter,
    /// How one cascade gives way to the next: two lookups in the band, or one and grain where
    /// there is no temporal antialiasing. Default [`CascadeTransition::CrossFade`]; as many
    /// pixels are wrong with either.
    pub transition: CascadeTransition,
    /// Which faces of casters the maps hold; at no cost. The wrong ones show as light under thin
    /// casters. Default [`CasterFaces::Front`].
    pub caster_faces: CasterFaces,
    /// How depth grows over a warped map; up to four taps instead of one where linear. Default
    /// [`DepthDistribution::Hyperbolic`], over which the automatic bias is exact.
    pub depth: DepthDistribution,
}

impl Default for ParallelSplitShadows {
    fn default() -> Self {
        Self {
            enabled: true,
            cascades: MAX_CASCADES as u32,
            near: 1.0,
            far: 500.0,
            splits: SplitScheme::default(),
            blend: 0.1,
            fade: 0.2,
            fit: CascadeFit::default(),
            focus: ShadowFocus::default(),
            slack: 0.1,
            warp_axis: WarpAxis::default(),
            map_size: MapSize::default(),
            culling: CasterCulling::default(),
            bias: ShadowBias::default(),
            filter: ShadowFilter::default(),
            transition: CascadeTransition::default(),
            caster_faces: CasterFaces::default(),
            depth: DepthDistribution::default(),
        }
    }
}

/// Where cascades end. `C_i` is the depth of split plane `i` of `m`, `n` near and `f` far.
#[derive(Reflect, Serialize, Deserialize, Debug, Clone, PartialEq)]
#[reflect(Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum SplitScheme {
    /// `n + (f − n) i/m`: equal slices. Right for views from high above; blocky at the feet of
    /// a walking camera.
    Uniform,
    /// `n (f/n)^(i/m)`: equal perspective error in every slice. Right when geometry fills all
    /// depths; wastes the first slices when nothing is near.
    Logarithmic,
    /// A mix: `lambda` parts logarithmic, `1 − lambda` parts uniform (GPU Gems 3 ch. 10,
    /// NVIDIA 2007).
    Practical {
        /// Weight of the logarithmic planes, 0 to 1.
        lambda: f64,
    },
    /// `min(n + (f − n)/gamma^(m−i) + bias, f)`: slices grow geometrically (Zhang et al. 2006,
    /// Eq. 3 as printed).
    Geometric {
        /// Growth from one plane's distance to the next, above 1. Below 2 the second slice is
        /// *shorter* than the first.
        gamma: f64,
        /// Pushes every inner plane out (meters, at least 0). At `(f − n)(1 − 1/gamma)` or
        /// more the last planes fall together and their cascades stay empty.
        bias: f64,
    },
    /// `min(n + gamma^(i−1) ((f − n)/gamma^(m−1) + bias), f)`: what Eqs. 1 and 2 of the same
    /// paper imply, the bias growing with the slices.
    GeometricScaled {
        /// Growth from one plane's distance to the next, above 1.
        gamma: f64,
        /// Length added to the first slice (meters, at least 0).
        bias: f64,
    },
    /// Inner planes by hand (meters from the eye): one fewer than cascades, strictly growing,
    /// between near and far.
    Manual(Vec<f64>),
}

impl Default for SplitScheme {
    fn default() -> Self {
        Self::Practical { lambda: 0.9 }
    }
}

/// Texels per side of each cascade's map: any whole number from [`MIN_MAP_SIZE`] to what the
/// GPU allows, powers of two or not.
///
/// All maps live in one array texture whose layers are as wide and as high as the widest and the
/// highest map: smaller maps save drawing, not memory, which is `4 bytes × width × height × maps`,
/// spot lights' maps and every camera's included.
#[derive(Reflect, Serialize, Deserialize, Debug, Clone, PartialEq, Eq)]
#[reflect(Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum MapSize {
    /// One size for all.
    Same(u32),
    /// The first cascade's size, halved for each one after (Zhang et al. 2006): a third more
    /// texels are drawn than in the first map alone, but each border shows a jump in sharpness,
    /// and in all example scenes `Same` of the first size, which takes as much memory, has a
    /// quarter to three fifths of the wrong pixels.
    Halving(u32),
    /// One size per cascade.
    List(Vec<u32>),
    /// One width and height per cascade.
    Sides(Vec<[u32; 2]>),
    /// So many texels for all maps together, shared so that all are predicted to be equally sharp,
    /// along both axes (Lloyd et al. 2006, Eqs. 13–14). Sizes change, if seldom, and with them the
    /// texels of stable maps. No side is longer than twice that of an even share.
    Budget(u32),
}

impl Default for MapSize {
    fn default() -> Self {
        Self::Same(2048)
    }
}

impl MapSize {
    /// Texels along the axes of cascade `index`; `None` if they depend on the plan.
    pub fn of_cascade(&self, index: usize) -> Option<UVec2> {
        let side = match self {
            Self::Same(size) => *size,
            Self::Halving(first) => (first >> index).max(MIN_MAP_SIZE),
            Self::List(sizes) => sizes.get(index).copied().unwrap_or(MIN_MAP_SIZE),
            Self::Sides(sides) => {
                return Some(
                    sides
                        .get(index)
                        .copied()
                        .unwrap_or([MIN_MAP_SIZE; 2])
                        .into(),
                );
            }
            Self::Budget(_) => return None,
        };
        Some(UVec2::splat(side))
    }
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

impl ParallelSplitShadows {
    /// Checks every value against its documented range.
    ///
    /// `max_map_size` is what the GPU allows (`max_texture_dimension_2d`).
    ///
    /// # Errors
    /// Names the first field that is wrong, its value and what is allowed.
    pub fn validate(&self, max_map_size: u32) -> Result<(), ConfigError> {
        ConfigError::check_range("cascades", self.cascades, 1..=MAX_CASCADES as u32)?;
        ConfigError::check_positive("near", self.near)?;
        ConfigError::check_positive("far", self.far)?;
        if self.far <= self.near {
            return Err(ConfigError::out_of_range(
                "far",
                self.far,
                format_args!("above `near` ({})", self.near),
            ));
        }
        self.splits.validate(self)?;
        ConfigError::check_range("blend", self.blend, 0.0..=0.5)?;
        ConfigError::check_range("fade", self.fade, 0.0..=1.0)?;
        self.fit.validate(self.cascades, &self.splits)?;
        ConfigError::check_range("slack", self.slack, 0.0..=1.0)?;
        self.map_size.validate(self.cascades, max_map_size)?;
        self.bias.validate()?;
        self.filter.validate()
    }
}

impl SplitScheme {
    fn validate(&self, config: &ParallelSplitShadows) -> Result<(), ConfigError> {
        match self {
            Self::Uniform | Self::Logarithmic => Ok(()),
            Self::Practical { lambda } => ConfigError::check_range("lambda", *lambda, 0.0..=1.0),
            Self::Geometric { gamma, bias } | Self::GeometricScaled { gamma, bias } => {
                if !(*gamma > 1.0 && gamma.is_finite()) {
                    return Err(ConfigError::out_of_range("gamma", *gamma, "above 1"));
                }
                ConfigError::check_range("bias", *bias, 0.0..=config.far)
            }
            Self::Manual(planes) => {
                let expected = config.cascades as usize - 1;
                if planes.len() != expected {
                    return Err(ConfigError::WrongCount {
                        field: "Manual",
                        count: planes.len(),
                        expected,
                        reason: "one plane fewer than `cascades`",
                    });
                }
                let mut previous = config.near;
                for (index, plane) in planes.iter().enumerate() {
                    if !(*plane > previous && *plane < config.far) {
                        return Err(ConfigError::NotIncreasing {
                            field: "Manual",
                            index,
                            value: *plane,
                            above: previous,
                            below: config.far,
                        });
                    }
                    previous = *plane;
                }
                Ok(())
            }
        }
    }
}

impl MapSize {
    fn validate(&self, cascades: u32, max: u32) -> Result<(), ConfigError> {
        let range = MIN_MAP_SIZE..=max;
        match self {
            Self::Same(size) => ConfigError::check_range("map_size", *size, range),
            Self::Halving(size) => {
                ConfigError::check_range("map_size", *size, (MIN_MAP_SIZE << (cascades - 1))..=max)
            }
            Self::List(sizes) => {
                Self::check_count(sizes.len(), cascades)?;
                sizes
                    .iter()
                    .try_for_each(|size| ConfigError::check_range("map_size", *size, range.clone()))
            }
            Self::Sides(sides) => {
                Self::check_count(sides.len(), cascades)?;
                sides
                    .iter()
                    .flatten()
                    .try_for_each(|size| ConfigError::check_range("map_size", *size, range.clone()))
            }
            // Sides may be twice as long as an even share's, or half as long.
            Self::Budget(texels) => {
                let of_side = |side: u32| cascades.saturating_mul(side.saturating_mul(side));
                let range = of_side(2 * MIN_MAP_SIZE)..=of_side(max / 2);
                ConfigError::check_range("map_size", *texels, range)
            }
        }
    }

    fn check_count(count: usize, cascades: u32) -> Result<(), ConfigError> {
        if count == cascades as usize {
            return Ok(());
        }
        Err(ConfigError::WrongCount {
            field: "map_size",
            count,
            expected: cascades as usize,
            reason: "one size per cascade",
        })
    }
}
