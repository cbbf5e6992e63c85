//! How large maps are.

use bevy::reflect::{Reflect, ReflectDeserialize, ReflectSerialize, std_traits::ReflectDefault};
use glam::UVec2;
use serde::{Deserialize, Serialize};

use super::ConfigError;

/// The smallest map that still leaves room for the filter's guard texels.
pub const MIN_MAP_SIZE: u32 = 64;
/// What editors offer at most; the GPU's own limit may be lower or higher.
const OFFERED_MAP_SIZE: u32 = 16384;
const OFFERED_BUDGETS: core::ops::RangeInclusive<u32> = (1 << 16)..=(1 << 28);

/// Texels per side of each cascade's map: any whole number from 64 to what the
/// GPU allows, powers of two or not.
///
/// All maps live in one array texture whose layers are as wide and as high as the widest and the
/// highest map: smaller maps save drawing, not memory, which is `4 bytes × width × height × maps`,
/// spot lights' maps and every camera's included. A small picture gets smaller maps, halved as long as they keep
/// eight times as many texels along a side as it is high; and so do all if they would take more than
/// [`ShadowMemoryLimit`](crate::ShadowMemoryLimit) together.
#[derive(Reflect, Serialize, Deserialize, Debug, Clone, PartialEq, Eq)]
#[reflect(Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum MapSize {
    /// One size for all.
    Same(#[reflect(@MIN_MAP_SIZE..=OFFERED_MAP_SIZE)] u32),
    /// The first cascade's size, halved for each one after (Zhang et al. 2006): a third more
    /// texels are drawn than in the first map alone, but each border shows a jump in sharpness, and
    /// it takes as much memory as `Same` of the first size. No map is smaller than 64², so the first of four is no
    /// smaller than 512².
    Halving(#[reflect(@MIN_MAP_SIZE..=OFFERED_MAP_SIZE)] u32),
    /// One width and height per cascade.
    PerCascade(Vec<[u32; 2]>),
    /// So many texels for all maps together, shared so that all are predicted to be equally sharp,
    /// along both axes (Lloyd et al. 2006, Eqs. 13–14). Sizes change, if seldom, and with them the
    /// texels of stable maps. Layers are as large as the largest map, whose sides are at most √2 times
    /// those of an even share: at most twice the budget is allocated. For each cascade, from 128² to the square of half
    /// of the GPU's largest side.
    Budget(#[reflect(@OFFERED_BUDGETS)] u32),
}

impl Default for MapSize {
    fn default() -> Self {
        Self::Same(2048)
    }
}

impl MapSize {
    /// Texels along the axes of cascade `index`; `None` if they depend on the plan.
    pub fn of_cascade(&self, index: usize) -> Option<UVec2> {
        let sides = match self {
            Self::Same(size) => [*size; 2],
            Self::Halving(first) => [(first >> index).max(MIN_MAP_SIZE); 2],
            Self::PerCascade(sizes) => sizes.get(index).copied().unwrap_or([MIN_MAP_SIZE; 2]),
            Self::Budget(_) => return None,
        };
        Some(sides.into())
    }

    /// The same, with sides halved so many times; no smaller than maps can be.
    pub(crate) fn halved(&self, times: u32, cascades: u32) -> Self {
        let half =
            |side: u32, least: u32| side.checked_shr(times).unwrap_or(0).max(least.min(side));
        match self {
            Self::Same(size) => Self::Same(half(*size, MIN_MAP_SIZE)),
            Self::Halving(size) => Self::Halving(half(*size, MIN_MAP_SIZE << (cascades - 1))),
            Self::PerCascade(sizes) => {
                let halved = |sides: &[u32; 2]| sides.map(|side| half(side, MIN_MAP_SIZE));
                Self::PerCascade(sizes.iter().map(halved).collect())
            }
            Self::Budget(texels) => {
                let least = cascades * (2 * MIN_MAP_SIZE).pow(2);
                let quarters = texels.checked_shr(2 * times).unwrap_or(0);
                Self::Budget(quarters.max(least.min(*texels)))
            }
        }
    }

    /// The longest side of a map from a budget (texels).
    pub(crate) fn largest_of_budget(&self, cascades: u32) -> u32 {
        match self {
            Self::Budget(texels) => (2.0 * f64::from(*texels) / f64::from(cascades)).sqrt() as u32,
            Self::Same(_) | Self::Halving(_) | Self::PerCascade(_) => 0,
        }
    }

    /// Whether all maps are as wide as high.
    pub fn is_square(&self) -> bool {
        match self {
            Self::Same(_) | Self::Halving(_) => true,
            Self::PerCascade(sizes) => sizes.iter().all(|[width, height]| width == height),
            Self::Budget(_) => false,
        }
    }
}

impl MapSize {
    pub(super) fn validate(&self, cascades: u32, max: u32) -> Result<(), ConfigError> {
        let range = MIN_MAP_SIZE..=max;
        match self {
            Self::Same(size) => ConfigError::check_range("map_size", *size, range),
            Self::Halving(size) => {
                ConfigError::check_range("map_size", *size, (MIN_MAP_SIZE << (cascades - 1))..=max)
            }
            Self::PerCascade(sizes) => {
                Self::check_count(sizes.len(), cascades)?;
                sizes
                    .iter()
                    .flatten()
                    .try_for_each(|size| ConfigError::check_range("map_size", *size, range.clone()))
            }
            // Even the smallest share leaves a map, and the largest is one that the GPU has.
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
