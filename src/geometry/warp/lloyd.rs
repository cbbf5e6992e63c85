//! The family of Lloyd et al. 2006, from no warp to perspective shadow maps.

use super::WarpFrame;

impl WarpFrame {
    /// The strength for `eta` from −1, no warp, over 0, light-space perspective, to 1, perspective
    /// shadow maps (1/meters; Lloyd et al. 2006, Eq. 11). The greatest error along the warp, for light
    /// from the side, is linear in the size of `eta`. As the paper has it for that light only, it
    /// is taken times the sine of the angle to the light, as in Scherzer and Wimmer, Eq. 1. Expects
    /// `0 < near < far`.
    pub fn lloyd_strength(&self, eta: f64, near: f64, far: f64) -> f64 {
        let ratio = far / near;
        let root = ratio.sqrt();
        let per_near = if eta <= 0.0 {
            (eta + 1.0) / (root + 1.0 - eta * (ratio - 1.0))
        } else {
            (eta * root + 1.0) / (root + 1.0)
        };
        self.sine * per_near / near
    }
}
