//! Repeatable randomness.

/// A number in [0, 1) from a seed and a counter.
pub fn random(seed: u64, counter: u64) -> f32 {
    let mut x = seed ^ counter.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((x ^ (x >> 31)) >> 40) as f32 / (1_u32 << 24) as f32
}

/// A stream of numbers in [0, 1).
pub struct Stream {
    seed: u64,
    counter: u64,
}

impl Stream {
    /// A stream, the same for the same seed.
    pub fn new(seed: u64) -> Self {
        Self { seed, counter: 0 }
    }

    /// The next number in [0, 1).
    pub fn next(&mut self) -> f32 {
        self.counter += 1;
        random(self.seed, self.counter)
    }

    /// The next number between two.
    pub fn between(&mut self, lo: f32, hi: f32) -> f32 {
        lo + (hi - lo) * self.next()
    }
}

/// Smooth value noise in [−1, 1] with features of size one.
pub fn noise(x: f32, y: f32, seed: u64) -> f32 {
    let (x0, y0) = (x.floor(), y.floor());
    let fade = |t: f32| t * t * t * (t * (6.0 * t - 15.0) + 10.0);
    let (tx, ty) = (fade(x - x0), fade(y - y0));
    let at = |i: f32, j: f32| {
        let key = ((x0 + i) as i64 as u64).wrapping_mul(0x1_0000_01B3) ^ ((y0 + j) as i64 as u64);
        random(seed, key) * 2.0 - 1.0
    };
    let top = at(0.0, 0.0) * (1.0 - tx) + at(1.0, 0.0) * tx;
    let bottom = at(0.0, 1.0) * (1.0 - tx) + at(1.0, 1.0) * tx;
    top * (1.0 - ty) + bottom * ty
}

/// Noise with finer and fainter features added, `octaves` times.
pub fn fractal(x: f32, y: f32, seed: u64, octaves: u32) -> f32 {
    (0..octaves)
        .map(|octave| {
            let scale = 2.03_f32.powi(octave as i32);
            noise(x * scale, y * scale, seed + u64::from(octave)) * 0.5_f32.powi(octave as i32)
        })
        .sum()
}

/// As [`fractal`], in [0, 1] and with sharp ridges.
pub fn ridged(x: f32, y: f32, seed: u64, octaves: u32) -> f32 {
    let mut sum = 0.0;
    let mut weight = 0.5;
    for octave in 0..octaves {
        let scale = 2.07_f32.powi(octave as i32);
        let ridge = 1.0 - noise(x * scale, y * scale, seed + u64::from(octave)).abs();
        sum += ridge * ridge * weight;
        weight *= 0.48;
    }
    sum
}
