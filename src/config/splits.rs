//! Where cascades end.

use bevy::reflect::{Reflect, ReflectDeserialize, ReflectSerialize, std_traits::ReflectDefault};
use serde::{Deserialize, Serialize};

use super::{ConfigError, ParallelSplitShadows};

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
        #[reflect(@0.0..=1.0_f32)]
        lambda: f32,
    },
    /// `min(n + (f − n)/gamma^(m−i) + bias, f)`: slices grow geometrically (Zhang et al. 2006,
    /// Eq. 3 as printed).
    Geometric {
        /// Growth from one plane's distance to the next, above 1. Below 2 the second slice is
        /// *shorter* than the first.
        gamma: f32,
        /// Pushes every inner plane out (meters, 0 to far). At `(f − n)(1 − 1/gamma)` or
        /// more the last planes fall together and their cascades stay empty.
        bias: f32,
    },
    /// `min(n + gamma^(i−1) ((f − n)/gamma^(m−1) + bias), f)`: what Eqs. 1 and 2 of the same
    /// paper imply, the bias growing with the slices.
    GeometricScaled {
        /// Growth from one plane's distance to the next, above 1.
        gamma: f32,
        /// Length added to the first slice (meters, 0 to far).
        bias: f32,
    },
    /// Inner planes by hand (meters of depth): one fewer than cascades, strictly growing,
    /// between near and far.
    Manual(Vec<f32>),
}

impl Default for SplitScheme {
    fn default() -> Self {
        Self::Practical { lambda: 0.9 }
    }
}

impl SplitScheme {
    pub(super) fn validate(&self, config: &ParallelSplitShadows) -> Result<(), ConfigError> {
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
