//! What is true, and where a picture differs from it.

use image::{Rgb, RgbImage};

use super::accuracy::{Fault, Truth};

/// Where the sun does not shine anyway.
const NOTHING: Rgb<u8> = Rgb([70, 84, 110]);

/// The share by rays.
pub fn truth(truth: &Truth) -> RgbImage {
    paint(truth, |i| truth.shares[i].map(gray))
}

/// The truth, faded, with faults in colors: acne red, leaks blue, stains yellow.
pub fn difference(truth: &Truth, shares: &[Option<f32>]) -> RgbImage {
    paint(truth, |i| {
        let color = match truth.fault(i, shares[i]?)? {
            Fault::Acne => Rgb([225, 40, 30]),
            Fault::Leak => Rgb([30, 90, 230]),
            Fault::Stain => Rgb([240, 180, 20]),
            Fault::None => {
                let faded = truth.shares[i].unwrap_or(1.0) * 0.25 + 0.65;
                gray(faded)
            }
        };
        Some(color)
    })
}

fn gray(share: f32) -> Rgb<u8> {
    Rgb([(255.0 * share).round() as u8; 3])
}

fn paint(truth: &Truth, color: impl Fn(usize) -> Option<Rgb<u8>>) -> RgbImage {
    let size = truth.size();
    RgbImage::from_fn(size.x, size.y, |x, y| {
        color((y * size.x + x) as usize).unwrap_or(NOTHING)
    })
}
