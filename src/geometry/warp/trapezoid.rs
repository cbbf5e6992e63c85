//! Trapezoidal shadow maps (Martin and Tan 2004): what lies nearer than a focus gets a fixed share of
//! the map.

use super::WarpFrame;
use crate::geometry::slice::{BodyVertex, ViewVolume};

/// Share of the map for what lies nearer than the focus.
const LINE: f64 = 0.8;

impl WarpFrame {
    /// The strength that maps what lies nearer than a focus to four fifths of the map (1/meters). The
    /// focus lies on the view's axis, at the share `focus` of the depths from `near` to `far`; from
    /// 0.8 on there is no warp. No stronger than perspective shadow maps
    /// ([`WarpFrame::lloyd_strength`] of 1). Expects `0 < near < far`.
    pub fn trapezoid_strength(
        &self,
        view: &ViewVolume,
        body: &[BodyVertex],
        near: f64,
        far: f64,
        focus: f64,
    ) -> f64 {
        let (near_line, far_line) = self.lines(body);
        let length = far_line - near_line;
        let depth = near + focus * (far - near);
        let forward = view.forward().map_or(0.0, |forward| forward.dot(self.y));
        let to_focus = depth * forward - near_line;
        // Where it lands is s (η + λ) / (λ (η + s)); here solved for 1/η.
        let strength =
            (LINE * length - to_focus) / ((1.0 - LINE) * length * to_focus.max(f64::MIN_POSITIVE));
        strength.clamp(0.0, self.lloyd_strength(1.0, near, far))
    }
}
