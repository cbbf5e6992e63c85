//! How maps are laid over their slices.

use bevy::reflect::{Reflect, ReflectDeserialize, ReflectSerialize, std_traits::ReflectDefault};
use serde::{Deserialize, Serialize};

use super::{ConfigError, SplitScheme};

/// How maps are laid over their slices.
#[derive(Reflect, Serialize, Deserialize, Debug, Default, Clone, PartialEq)]
#[reflect(Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum CascadeFit {
    /// Constant size, fixed orientation, moved in whole texels: edges of resting shadows never
    /// crawl, however the camera moves or turns.
    Stable,
    /// The box of an upright cylinder around what can receive shadows, in the light's own frame, moved
    /// in whole texels: nearly as sharp as `Tight`. While the camera walks and turns edges stay; they
    /// move by less than a texel every now and then, when what is seen becomes much nearer,
    /// farther or wider.
    #[default]
    Steady,
    /// The smallest box around what can receive shadows, in the light's own frame: several times
    /// the texels per area. Edges stay while [`slack`](super::ParallelSplitShadows::slack) lasts
    /// and jump when it does not.
    Tight,
    /// The smallest box in the view's frame, in perspective, with more texels near the eye:
    /// sharpest, and edges crawl while the camera moves. `Minimax` gives way, cascade by cascade, to
    /// `Tight` where that has clearly smaller texels on average over what is seen. Kilometers from the
    /// origin all warps are weaker near the eye, where `f32` does not tell such small texels apart.
    Warped(MapWarp),
    /// One for each cascade, from the nearest on: stable near and warped far, or the reverse.
    PerCascade(Vec<MapFit>),
    /// A map of its own for every face of the view that light enters or leaves it by, warped from
    /// edge to edge (Lloyd et al. 2006, 5.1): for light along the view, where no other warp gains
    /// anything. One to four faces share four maps, but for those that the light sees nearly edge-on,
    /// and slices get what is left, as few as they have been within the last 600 frames: with so few
    /// maps, slices alone are sharper at most angles. Needs four cascades; for cameras in perspective.
    Faces,
    /// Chosen for each cascade from what a fit is predicted to gain, and no more cascades than gain
    /// anything. Choices are held until another is clearly better.
    Auto {
        /// How much sharpness is worth (0 to 1). 0: all maps stable. 1: what is sharpest, by however
        /// little. At 0.5 a warped map must have twice the texels across a pixel that a stable one
        /// has, a tight one 1.4 times; at 0.25 four times, and twice.
        #[reflect(@0.0..=1.0_f32)]
        sharpness: f32,
    },
}

/// How one map is laid over its slice.
#[derive(Reflect, Serialize, Deserialize, Debug, Default, Clone, Copy, PartialEq)]
#[reflect(Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum MapFit {
    /// As [`CascadeFit::Stable`].
    #[default]
    Stable,
    /// As [`CascadeFit::Steady`].
    Steady,
    /// As [`CascadeFit::Tight`].
    Tight,
    /// As [`CascadeFit::Warped`].
    Warped(MapWarp),
}

/// What the texels of maps that are not warped are fixed to.
#[derive(Reflect, Serialize, Deserialize, Debug, Default, Clone, Copy, PartialEq, Eq, Hash)]
#[reflect(Default, Debug, Clone, PartialEq, Hash, Serialize, Deserialize)]
pub enum TexelGrid {
    /// The light's own frame, which turns with a sun that moves, and all edges with it.
    #[default]
    Light,
    /// The world's ground: texels stay where they are on level ground however the sun moves, and only
    /// shadows do. Maps are sheared, lookups cost a little more, and on walls texels are longer while
    /// the sun is low; below 6° the light's own frame takes over, until the sun is 8° high again.
    Ground,
}

/// How strongly a map is warped.
#[derive(Reflect, Serialize, Deserialize, Debug, Default, Clone, Copy, PartialEq)]
#[reflect(Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum MapWarp {
    /// As makes the worst error along the warp least, and predicted to need at most a hundredth more
    /// texels than no warp; fades to nothing as view and light align.
    #[default]
    Minimax,
    /// Light-space perspective shadow maps (Scherzer and Wimmer, Eq. 1): equal errors at the near
    /// and the far end. Where view and light are almost aligned many times worse than no warp.
    Lispsm,
    /// The family of Lloyd et al. 2006 (Eq. 11).
    Lloyd {
        /// From −1, no warp, over 0, as [`MapWarp::Lispsm`], to 1, perspective shadow maps.
        #[reflect(@-1.0..=1.0_f32)]
        eta: f32,
    },
    /// Trapezoidal shadow maps: four fifths of the map for what lies nearer than the focus.
    Trapezoid {
        /// Where the focus lies between the near and the far end (share of depth, above 0 to 0.8,
        /// which is no warp).
        #[reflect(@0.0..=0.8_f32)]
        focus: f32,
    },
    /// So much of the strength of perspective shadow maps (share, 0 to 1).
    Strength(#[reflect(@0.0..=1.0_f32)] f32),
}

impl CascadeFit {
    /// The fits that cascade `index` may have: one, or those to choose from.
    pub fn of_cascade(&self, index: usize) -> impl Iterator<Item = MapFit> + use<> {
        const CHOICE: [MapFit; 3] = [
            MapFit::Stable,
            MapFit::Tight,
            MapFit::Warped(MapWarp::Minimax),
        ];
        let (fits, count) = match self {
            Self::Stable => ([MapFit::Stable; 3], 1),
            Self::Steady => ([MapFit::Steady; 3], 1),
            Self::Tight => ([MapFit::Tight; 3], 1),
            Self::Faces => ([MapFit::Warped(MapWarp::Minimax); 3], 1),
            Self::Warped(warp) => ([MapFit::Warped(*warp); 3], 1),
            Self::PerCascade(fits) => ([fits.get(index).copied().unwrap_or_default(); 3], 1),
            Self::Auto { sharpness } if *sharpness <= 0.0 => (CHOICE, 1),
            Self::Auto { .. } => (CHOICE, 3),
        };
        fits.into_iter().take(count)
    }

    /// The nearest to it without perspective, for GPUs that cannot draw that.
    pub(crate) fn unwarped(&self) -> Self {
        match self {
            Self::Warped(_) | Self::Faces => Self::Tight,
            Self::Auto { sharpness } if *sharpness > 0.0 => Self::Tight,
            Self::PerCascade(fits) => Self::PerCascade(
                fits.iter()
                    .map(|fit| match fit {
                        MapFit::Warped(_) => MapFit::Tight,
                        MapFit::Stable | MapFit::Steady | MapFit::Tight => *fit,
                    })
                    .collect(),
            ),
            Self::Stable | Self::Steady | Self::Tight | Self::Auto { .. } => self.clone(),
        }
    }

    /// Whether there is a choice.
    pub(crate) fn chooses(&self) -> bool {
        matches!(self, Self::Auto { sharpness } if *sharpness > 0.0)
    }

    /// Whether a map may be laid as a predicate says.
    pub(crate) fn any(&self, predicate: impl FnMut(MapFit) -> bool) -> bool {
        let count = match self {
            Self::PerCascade(fits) => fits.len(),
            _ => 1,
        };
        (0..count)
            .flat_map(|index| self.of_cascade(index))
            .any(predicate)
    }

    pub(super) fn validate(&self, cascades: u32, splits: &SplitScheme) -> Result<(), ConfigError> {
        if let Self::PerCascade(fits) = self
            && fits.len() != cascades as usize
        {
            return Err(ConfigError::WrongCount {
                field: "fit",
                count: fits.len(),
                expected: cascades as usize,
                reason: "one fit per cascade",
            });
        }
        if *self == Self::Faces && cascades != 4 {
            return Err(ConfigError::out_of_range(
                "cascades",
                cascades,
                "4 with `fit: Faces`",
            ));
        }
        if *self == Self::Faces && matches!(splits, SplitScheme::Manual(_)) {
            return Err(ConfigError::out_of_range(
                "splits",
                "Manual",
                "another scheme with `fit: Faces`, which has fewer slices than cascades",
            ));
        }
        if let Self::Auto { sharpness } = self {
            ConfigError::check_range("sharpness", *sharpness, 0.0..=1.0)?;
        }
        (0..cascades as usize)
            .flat_map(|index| self.of_cascade(index))
            .try_for_each(|fit| match fit {
                MapFit::Warped(warp) => warp.validate(),
                MapFit::Stable | MapFit::Steady | MapFit::Tight => Ok(()),
            })
    }
}

impl MapWarp {
    fn validate(self) -> Result<(), ConfigError> {
        match self {
            Self::Minimax | Self::Lispsm => Ok(()),
            Self::Lloyd { eta } => ConfigError::check_range("eta", eta, -1.0..=1.0),
            Self::Trapezoid { focus } if focus == 0.0 => {
                Err(ConfigError::out_of_range("focus", focus, "above 0"))
            }
            Self::Trapezoid { focus } => ConfigError::check_range("focus", focus, 0.0..=0.8),
            Self::Strength(share) => ConfigError::check_range("Strength", share, 0.0..=1.0),
        }
    }
}
