//! The strength with the least worst error.

use super::WarpFrame;
use crate::geometry::slice::BodyVertex;

/// Storage that a warp may cost, over that of no warp. A little more than 1, so that where one
/// strength after another is equally good none is far from its neighbors.
const MOST_STORAGE: f64 = 1.01;

/// A vertex as the warp sees it.
struct Seen {
    /// Across the warp and along it from the nearest line (meters).
    u: f64,
    q: f64,
    image_height: f64,
}

impl WarpFrame {
    /// The strength with the least worst error along the warp (1/meters): that of Lloyd et al.
    /// 2006 for a light from above, zero for one from behind, and continuous in between.
    ///
    /// Along the warp the error is never worse than without one. Across it, it can be: the
    /// storage factor of the view volume's slices stays within 32/27 of the best that any
    /// strength has (observed, not proven).
    pub fn minimax_strength(&self, body: &[BodyVertex]) -> f64 {
        let (near_line, far_line) = self.lines(body);
        let d = far_line - near_line;
        // Error at a vertex, up to a factor: (slope · strength + offset)² / (1 + strength · d).
        let roots = body.iter().map(|vertex| {
            let offset = vertex.image_height.sqrt().recip();
            [(self.along(vertex) - near_line) * offset, offset]
        });
        let roots: Vec<[f64; 2]> = roots.collect();
        // The worst error is convex: follow the vertex that has it, and where another takes over
        // that one, until it no longer falls.
        let worse = |a: &[f64; 2], b: &[f64; 2]| a[1].total_cmp(&b[1]).then(a[0].total_cmp(&b[0]));
        let Some(mut worst) = roots.iter().copied().max_by(worse) else {
            return 0.0;
        };
        let mut strength = 0.0;
        loop {
            let [slope, offset] = worst;
            let lowest = (d * offset - 2.0 * slope) / (d * slope);
            // No vertex falls for ever: the farthest rises.
            if lowest.is_nan() || lowest <= strength {
                return strength;
            }
            let crossing = |other: &[f64; 2]| (offset - other[1]) / (other[0] - slope);
            let next = roots
                .iter()
                .filter(|other| other[0] > slope)
                .map(|other| (crossing(other), *other))
                .min_by(|a, b| a.0.total_cmp(&b.0).then(b.1[0].total_cmp(&a.1[0])));
            match next {
                Some((crossing, other)) if crossing < lowest => {
                    strength = crossing.max(strength);
                    worst = other;
                }
                _ => return lowest,
            }
        }
    }

    /// That strength, or the greatest below it whose storage factor is no more than a hundredth
    /// above that of no warp: one in sixty slices of random views and lights needs it.
    ///
    /// Up to [`WarpFrame::minimax_strength`] the storage factor falls and then rises, or does one of
    /// both (observed, not proven): where it crosses the bound moves continuously with the body.
    pub fn guarded_minimax_strength(&self, body: &[BodyVertex]) -> f64 {
        let strength = self.minimax_strength(body);
        let (near_line, far_line) = self.lines(body);
        let seen: Vec<Seen> = body
            .iter()
            .map(|vertex| {
                let local = self.local(vertex);
                Seen {
                    u: local.x,
                    q: local.y - near_line,
                    image_height: vertex.image_height,
                }
            })
            .collect();
        let most = MOST_STORAGE * storage(&seen, far_line - near_line, 0.0);
        let is_too_much = |strength: f64| storage(&seen, far_line - near_line, strength) > most;
        if !is_too_much(strength) {
            return strength;
        }
        let (mut low, mut high) = (0.0, strength);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if is_too_much(middle) {
                high = middle;
            } else {
                low = middle;
            }
        }
        low
    }
}

/// The storage factor, up to a factor (Lloyd et al. 2006, Eq. 12).
fn storage(seen: &[Seen], length: f64, strength: f64) -> f64 {
    let [mut left, mut right] = [f64::INFINITY, f64::NEG_INFINITY];
    let [mut across, mut along] = [0.0_f64; 2];
    for vertex in seen {
        let w = 1.0 + strength * vertex.q;
        left = left.min(vertex.u / w);
        right = right.max(vertex.u / w);
        across = across.max(w / vertex.image_height);
        along = along.max(w * w / vertex.image_height);
    }
    (right - left) * across * along / (1.0 + strength * length)
}
