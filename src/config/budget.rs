//! How much of what may wait is drawn in a frame.

use bevy::reflect::{Reflect, ReflectDeserialize, ReflectSerialize, std_traits::ReflectDefault};
use glam::UVec2;
use serde::{Deserialize, Serialize};

use super::{ConfigError, MAX_CASCADES};

/// What editors offer.
const OFFERED_TEXELS: core::ops::RangeInclusive<u32> = (1 << 16)..=(1 << 28);

/// What is drawn in a frame of those of a camera's maps that may wait
/// ([`delay`](super::ParallelSplitShadows::delay)). One map is drawn whatever it takes.
#[derive(Reflect, Serialize, Deserialize, Debug, Clone, Copy, PartialEq, Eq)]
#[reflect(Default, Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum UpdateBudget {
    /// So many maps (1 to 4).
    Maps(#[reflect(@1..=MAX_CASCADES as u32)] u32),
    /// Maps of so many texels, all together: for maps of unequal sizes.
    Texels(#[reflect(@OFFERED_TEXELS)] u32),
}

impl Default for UpdateBudget {
    fn default() -> Self {
        Self::Maps(1)
    }
}

impl UpdateBudget {
    pub(super) fn validate(self) -> Result<(), ConfigError> {
        match self {
            Self::Maps(count) => {
                ConfigError::check_range("update_budget", count, 1..=MAX_CASCADES as u32)
            }
            Self::Texels(count) => ConfigError::check_range("update_budget", count, 1..=u32::MAX),
        }
    }

    /// What there is of it in a frame.
    pub(crate) fn whole(self) -> u64 {
        match self {
            Self::Maps(count) | Self::Texels(count) => count.into(),
        }
    }

    /// What a map takes of it.
    pub(crate) fn cost(self, map_size: UVec2) -> u64 {
        match self {
            Self::Maps(_) => 1,
            Self::Texels(_) => u64::from(map_size.x) * u64::from(map_size.y),
        }
    }
}
