//! Where cascades end: formulas for the depth `C_i` of split plane `i` of `count`, between `near`
//! and `far`.
//!
//! All expect `0 < near < far` and `0 < index < count`; `C_0` is `near` and `C_count` is `far`.

/// `n + (f − n) i/m`: equal slices.
pub fn uniform(near: f64, far: f64, index: usize, count: usize) -> f64 {
    near + (far - near) * (index as f64 / count as f64)
}

/// `n (f/n)^(i/m)`: equal perspective error in every slice (Zhang et al. 2006).
pub fn logarithmic(near: f64, far: f64, index: usize, count: usize) -> f64 {
    near * ((far / near).ln() * (index as f64 / count as f64)).exp()
}

/// `lambda` parts logarithmic, `1 − lambda` parts uniform (GPU Gems 3 ch. 10, NVIDIA 2007).
pub fn practical(lambda: f64, near: f64, far: f64, index: usize, count: usize) -> f64 {
    lambda * logarithmic(near, far, index, count)
        + (1.0 - lambda) * uniform(near, far, index, count)
}

/// `min(n + (f − n)/gamma^(m−i) + bias, f)` (Zhang et al. 2006, Eq. 3 as printed).
pub fn geometric(gamma: f64, bias: f64, near: f64, far: f64, index: usize, count: usize) -> f64 {
    let growth = gamma.powi((count - index) as i32);
    (near + (far - near) / growth + bias).min(far)
}

/// `min(n + gamma^(i−1) ((f − n)/gamma^(m−1) + bias), f)`: what Eqs. 1 and 2 of the same paper
/// imply, the bias growing with the slices.
pub fn geometric_scaled(
    gamma: f64,
    bias: f64,
    near: f64,
    far: f64,
    index: usize,
    count: usize,
) -> f64 {
    let first = (far - near) / gamma.powi(count as i32 - 1) + bias;
    (near + gamma.powi(index as i32 - 1) * first).min(far)
}
