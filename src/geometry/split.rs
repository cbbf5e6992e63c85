//! Where cascades end: the split planes `C_0 = near < C_1 < … < C_m = far`.

use crate::config::SplitScheme;

/// The depths of all split planes, `cascades + 1` of them, in meters from the eye.
///
/// The first is `near` and the last is `far`, exactly. Planes never decrease; a scheme whose
/// planes run into `far` early (geometric growth with a large bias) yields coinciding planes,
/// which stand for empty cascades.
///
/// Expects `0 < near < far`, at least one cascade and scheme parameters inside their documented
/// ranges, all of which [`ParallelSplitShadows::validate`](crate::ParallelSplitShadows::validate)
/// guarantees.
pub fn split_planes(scheme: &SplitScheme, near: f64, far: f64, cascades: usize) -> Vec<f64> {
    (0..=cascades)
        .map(|index| {
            if index == 0 {
                near
            } else if index == cascades {
                far
            } else {
                inner_plane(scheme, near, far, cascades, index)
            }
        })
        .collect()
}

fn inner_plane(scheme: &SplitScheme, near: f64, far: f64, cascades: usize, index: usize) -> f64 {
    let fraction = index as f64 / cascades as f64;
    let remaining = (cascades - index) as i32;
    match scheme {
        SplitScheme::Uniform => uniform(near, far, fraction),
        SplitScheme::Logarithmic => logarithmic(near, far, fraction),
        SplitScheme::Practical { lambda } => {
            lambda * logarithmic(near, far, fraction)
                + (1.0 - lambda) * uniform(near, far, fraction)
        }
        SplitScheme::Geometric { gamma, bias } => {
            let growth = gamma.powi(remaining);
            (near + (far - near) / growth + *bias).min(far)
        }
        SplitScheme::GeometricScaled { gamma, bias } => {
            let first = (far - near) / gamma.powi(cascades as i32 - 1) + *bias;
            (near + gamma.powi(index as i32 - 1) * first).min(far)
        }
        SplitScheme::Manual(planes) => planes[index - 1],
    }
}

fn uniform(near: f64, far: f64, fraction: f64) -> f64 {
    near + (far - near) * fraction
}

fn logarithmic(near: f64, far: f64, fraction: f64) -> f64 {
    near * ((far / near).ln() * fraction).exp()
}
