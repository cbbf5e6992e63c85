//! Light-space perspective shadow maps (Wimmer et al. 2004; Scherzer and Wimmer, Eq. 1).

use super::WarpFrame;

impl WarpFrame {
    /// The classical strength for what is seen between two depths (1/meters; Scherzer and Wimmer,
    /// Eq. 1): equal errors along the warp at the near and the far end, if the light comes from the
    /// side. For other directions it can be many times worse than no warp at all. Expects
    /// `0 < near < far`.
    pub fn lispsm_strength(&self, near: f64, far: f64) -> f64 {
        self.lloyd_strength(0.0, near, far)
    }
}
