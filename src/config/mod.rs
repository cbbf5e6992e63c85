//! The component that holds a light's whole shadow configuration, its checks and its RON form.

mod budget;
mod comparison;
mod error;
mod filter;
mod fit;
mod map_size;
mod preset;
mod splits;

pub use budget::UpdateBudget;
pub use comparison::{
    CasterCulling, CasterFaces, Comparison, DepthDistribution, MapUpdates, ShadowBias, ShadowFocus,
    WarpAxis,
};
pub use error::ConfigError;
pub use filter::{CascadeTransition, FilterRadius, MAX_FILTER_TEXELS, ShadowFilter};
pub use fit::{CascadeFit, MapFit, MapWarp, TexelGrid};
pub use map_size::{MIN_MAP_SIZE, MapSize};
pub use preset::{ShadowPreset, ShadowPresetError, ShadowPresetLoader};
pub use splits::SplitScheme;

pub(crate) use filter::{GAUSSIAN_TEXELS, MAX_SUN_DEGREES, TEMPORAL_TEXELS};

use bevy::{
    asset::Asset,
    ecs::{component::Component, reflect::ReflectComponent},
    reflect::{Reflect, ReflectDeserialize, ReflectSerialize, std_traits::ReflectDefault},
};
use serde::{Deserialize, Serialize};

use error::MAX_DISTANCE;

/// The most cascades a light can have: the length of Bevy's uniform array.
pub const MAX_CASCADES: usize = 4;

/// A map that waits for longer (frames) is none.
const MAX_DELAY: u32 = 60;

/// Gives a [`DirectionalLight`](bevy::light::DirectionalLight) parallel-split shadow maps.
///
/// Adding the component is enough: it switches the light's shadow maps on and takes their place
/// on every active 3D camera. `shadow_maps_enabled = false` afterwards means no shadows, until it
/// is `true` again, also if the component goes and comes back in between. Removing the component
/// brings Bevy's own shadows back exactly as they were configured. `CascadeShadowConfig` is
/// overwritten while it is present; a saved world keeps what the game had set in
/// [`ManagedLight`](crate::ManagedLight).
///
/// The cameras' `ShadowFilteringMethod`, `NotShadowCaster` and `NotShadowReceiver` keep their
/// meaning. The light's own `shadow_depth_bias` and `shadow_normal_bias` raise
/// [`ShadowBias::Automatic`] only above Bevy's defaults (0.02 and 1.8): twice the first doubles what
/// walls and rounded positions get, twice the second adds what the surface rises over a texel. The
/// other biases follow them in proportion, below the defaults, too: what depends on the surface's
/// slope the second, the rest the first. Leave both, unless feet of walls that the sun grazes are
/// gray; then double `shadow_depth_bias`.
///
/// A value outside its range is reported once, and the last good configuration stays in force, or
/// until there is one Bevy's own shadows.
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
pub struct ParallelSplitShadows {
    /// Number of cascades, 1 to 4. Each costs one shadow pass; too few show as blocky shadows
    /// near the camera. Default 4.
    #[reflect(@1..=4_u32)]
    pub cascades: u32,
    /// Where the split scheme starts (meters along the view, at least a micrometer). Surfaces nearer than
    /// this are still shadowed: the first cascade reaches to the eye at no cost. Too small
    /// wastes the first cascades on the ground at the camera's feet. Default 1 m; see
    /// [`far`](Self::far).
    #[reflect(@0.0..=MAX_DISTANCE)]
    pub near: f32,
    /// Where shadows end (meters along the view, above [`near`](Self::near)). Farther costs
    /// sharpness in every cascade and draws more casters; nearer makes shadows fade out in
    /// plain sight. Default 500 m, and if both are at their defaults, the range that the light's own
    /// `CascadeShadowConfig` had when the component was added, where the game had set one. Unless a map
    /// is `Stable`, splits are `Manual` or focus is off, cascades are spread over the part of the range
    /// in which something is seen.
    #[reflect(@0.0..=MAX_DISTANCE)]
    pub far: f32,
    /// Where cascades end in between, at no cost. Too little near the eye shows as blocky shadows
    /// there, too much as blurry ones far away. Default `Practical { lambda: 0.9 }`, with the first
    /// split at 17 m where something is seen over the whole range.
    pub splits: SplitScheme,
    /// Share of each slice, at its far end, over which one cascade is blended into the next
    /// (0 to 0.5). Pixels there sample two maps; 0 shows a hard line where sharpness changes.
    /// Default 0.1.
    #[reflect(@0.0..=0.5_f32)]
    pub blend: f32,
    /// Share of the last slice over which shadows fade to light (0 to 1). Free; 0 shows a hard
    /// line that travels with the camera. Default 0.2.
    #[reflect(@0.0..=1.0_f32)]
    pub fade: f32,
    /// How maps are laid over their slices. Sharper fits take longer to plan, and edges of shadows
    /// move now and then, or crawl. Default [`CascadeFit::Steady`]: as sharp as can be for maps that
    /// keep still while the camera walks and turns.
    pub fit: CascadeFit,
    /// How much larger than needed fitted maps, the boxes that they are fitted to and the range of
    /// depths that is split may be, so as not to change with every frame (share, 0 to 1). 0 is
    /// sharpest and crawls whenever anything moves. Zooms change
    /// [`CascadeFit::Stable`] maps in steps of the root of `1 + slack`. Default 0.1.
    #[reflect(@0.0..=1.0_f32)]
    pub slack: f32,
    /// Texels of each cascade's map. Default `Same(2048)`: 16 MiB and one clear each, for every
    /// camera. Too few show as blocks and blurred edges; memory grows with the square.
    pub map_size: MapSize,
    /// How soft the edges of shadows are. Too narrow shows texels, too wide moves edges off the
    /// truth; costs grow with the taps. Default [`ShadowFilter::Camera`].
    pub filter: ShadowFilter,
    /// What texels are fixed to, for suns that move. Default [`TexelGrid::Light`].
    pub grid: TexelGrid,
    /// In what steps maps follow a sun that moves (degrees, 0 to 1), one map after the other; what
    /// is lit is shaded by the true sun meanwhile, whose shadows are off by six tenths of a step, or a whole one if it
    /// is so fast that all maps are due. Maps of coarse texels go in larger steps, up to four times as large, that move
    /// the shadow of what is 10 m away by a texel at most. 0 draws all maps in every frame in which the sun moves, and
    /// every edge creeps, as with `Faces`, whatever the step; too much shows as shadows that tick like a clock's hand.
    /// Default 0.05: a tenth of the sun's width, less than the edge of any shadow is soft.
    #[reflect(@0.0..=1.0_f32)]
    pub sun_step: f32,
    /// For how many frames a map that is due may wait while another is drawn (0 to 60): who has waited longest
    /// goes first, or else the nearest. What comes into view meanwhile is shadowed by a coarser map or not at
    /// all; but of a camera's maps no more than [`update_budget`](Self::update_budget) are drawn in a frame, unless they
    /// are new, a sun has jumped, a caster has begun to move, come to rest or gone, or they have waited so long; with
    /// `Faces` none waits. Default 0: none waits.
    #[reflect(@0..=MAX_DELAY)]
    pub delay: u32,
    /// What is drawn in a frame of those maps that may wait: more has fewer of them wait. Default `Maps(1)`, which means
    /// nothing unless there is a [`delay`](Self::delay).
    pub update_budget: UpdateBudget,
    /// How one cascade gives way to the next: two lookups in the band, or one and grain where
    /// there is no temporal antialiasing. Default [`CascadeTransition::CrossFade`].
    pub transition: CascadeTransition,
    /// What hardly any game needs to change.
    pub comparison: Comparison,
}

impl Default for ParallelSplitShadows {
    fn default() -> Self {
        Self {
            cascades: MAX_CASCADES as u32,
            near: 1.0,
            far: 500.0,
            splits: SplitScheme::default(),
            blend: 0.1,
            fade: 0.2,
            fit: CascadeFit::default(),
            slack: 0.1,
            map_size: MapSize::default(),
            filter: ShadowFilter::default(),
            grid: TexelGrid::default(),
            sun_step: 0.05,
            delay: 0,
            update_budget: UpdateBudget::default(),
            transition: CascadeTransition::default(),
            comparison: Comparison::default(),
        }
    }
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
        ConfigError::check_distance("near", self.near)?;
        ConfigError::check_distance("far", self.far)?;
        if self.far <= self.near {
            // The one that was set.
            let (near, far) = (self.near, self.far);
            return Err(if far == Self::default().far {
                ConfigError::out_of_range("near", near, format_args!("below `far` ({far})"))
            } else {
                ConfigError::out_of_range("far", far, format_args!("above `near` ({near})"))
            });
        }
        self.splits.validate(self)?;
        ConfigError::check_range("blend", self.blend, 0.0..=0.5)?;
        ConfigError::check_range("fade", self.fade, 0.0..=1.0)?;
        self.fit.validate(self.cascades, &self.splits)?;
        ConfigError::check_range("slack", self.slack, 0.0..=1.0)?;
        self.map_size.validate(self.cascades, max_map_size)?;
        self.filter.validate()?;
        ConfigError::check_range("sun_step", self.sun_step, 0.0..=1.0)?;
        ConfigError::check_range("delay", self.delay, 0..=MAX_DELAY)?;
        self.update_budget.validate()?;
        self.comparison.bias.validate()
    }

    /// Whether all maps have texels with equal sides.
    pub fn has_square_texels(&self) -> bool {
        !self.fit.any(|fit| fit != MapFit::Stable) && self.map_size.is_square()
    }
}
