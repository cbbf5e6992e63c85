//! The depths between cascades, by the scheme that is set.

use crate::{config::SplitScheme, geometry::split};

/// The depths of all split planes, `cascades + 1` of them, in meters from the eye along the view.
///
/// The first is `near` and the last is `far`, exactly. Planes never decrease; a scheme whose
/// planes run into `far` early (geometric growth with a large bias) yields coinciding planes,
/// which stand for empty cascades.
///
/// Expects `0 < near < far`, at least one cascade and scheme parameters inside their documented
/// ranges, all of which [`ParallelSplitShadows::validate`](crate::ParallelSplitShadows::validate)
/// guarantees.
pub fn split_planes(scheme: &SplitScheme, near: f64, far: f64, cascades: usize) -> Vec<f64> {
    let inner_plane = |index: usize| match scheme {
        SplitScheme::Uniform => split::uniform(near, far, index, cascades),
        SplitScheme::Logarithmic => split::logarithmic(near, far, index, cascades),
        SplitScheme::Practical { lambda } => {
            split::practical(f64::from(*lambda), near, far, index, cascades)
        }
        SplitScheme::Geometric { gamma, bias } => {
            let (gamma, bias) = (f64::from(*gamma), f64::from(*bias));
            split::geometric(gamma, bias, near, far, index, cascades)
        }
        SplitScheme::GeometricScaled { gamma, bias } => {
            let (gamma, bias) = (f64::from(*gamma), f64::from(*bias));
            split::geometric_scaled(gamma, bias, near, far, index, cascades)
        }
        SplitScheme::Manual(planes) => f64::from(planes[index - 1]),
    };
    (0..=cascades)
        .map(|index| match index {
            0 => near,
            _ if index == cascades => far,
            _ => inner_plane(index),
        })
        .collect()
}
