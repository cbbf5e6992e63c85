//! The strength with the least worst error.

use super::{BodyVertex, WarpFrame};

/// Storage that a warp may cost, over that of no warp. A little more than 1, so that where one
/// strength after another is equally good none is far from its neighbours.
const MOST_STORAGE: f64 = 1.01;

/// A vertex as the warp sees it.
struct Seen {
    /// Across the warp and along it from the nearest line (metres).
    u: f64,
    q: f64,
    image_height: f64,
}

impl WarpFrame {
    /// The strength with the least worst error along the warp (1/metres): that of Lloyd et al.
    /// 2006 for a light from above, zero for one from behind, and continuous in between.
    ///
    /// Along the warp the error is never worse than without one. Across it, it can be: the
    /// storage factor of the view volume's slices stays within 32/27 of the best that any
    /// strength has (observed, not proven).
    pub fn minimax_strength(&self, body: &[BodyVertex]) -> f64 {
        let (near_line, far_line) = self.lines(body);
        let d = far_line - near_line;
        // Error at a vertex, up to a factor: (slope · strength + offset)² / (1 + strength · d).
        let roots: Vec<[f64; 2]> = body
            .iter()
            .map(|vertex| {
                let offset = vertex.image_height.sqrt().recip();
                [(self.along(vertex) - near_line) * offset, offset]
            })
            .collect();
        let worst = |strength: f64| {
            let root = roots
                .iter()
                .map(|[slope, offset]| slope * strength + offset)
                .fold(0.0, f64::max);
            root * root / (1.0 + strength * d)
        };
        // The worst error is convex, with its minimum where one vertex has its own or where two
        // are equally bad.
        let lowest = roots
            .iter()
            .map(|[slope, offset]| (d * offset - 2.0 * slope) / (d * slope));
        let equal = roots
            .iter()
            .flat_map(|a| roots.iter().map(|b| (b[1] - a[1]) / (a[0] - b[0])));
        lowest
            .chain(equal)
            .filter(|strength| *strength > 0.0 && strength.is_finite())
            .fold(0.0, |best, strength| {
                if worst(strength) < worst(best) {
                    strength
                } else {
                    best
                }
            })
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
