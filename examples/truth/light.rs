//! The share of the sun's light that pictures show.

use bevy::prelude::*;
use half::f16;
use image::RgbImage;

/// A sun whose light is less than this at a pixel cannot be told from none.
const LEAST_LIGHT: f32 = 1e-3;
/// … nor one that adds less than this share to what is there anyway.
const LEAST_SHARE: f32 = 0.05;

/// What the camera sees with and without the sun, all shadows off.
pub struct Reference {
    /// With the sun, none of whose light is held back.
    pub lit: Picture,
    /// Without the sun.
    pub dark: Picture,
}

/// A frame in linear light, row by row.
pub struct Picture(Vec<[f32; 3]>);

impl Picture {
    /// From a texture's bytes: four `f16` a pixel.
    pub fn from_bytes(bytes: &[u8]) -> Self {
        let channel = |pair: [u8; 2]| f16::from_le_bytes(pair).to_f32();
        let pixels = bytes.as_chunks::<8>().0.iter();
        let pixels = pixels
            .map(|[r0, r1, g0, g1, b0, b1, ..]| [[*r0, *r1], [*g0, *g1], [*b0, *b1]].map(channel));
        Self(pixels.collect())
    }

    /// A pixel's linear light.
    pub fn pixel(&self, index: usize) -> [f32; 3] {
        self.0[index]
    }

    fn brightness(&self) -> impl Iterator<Item = f32> {
        self.0.iter().map(|[r, g, b]| r + g + b)
    }

    /// As on a screen.
    pub fn to_image(&self, size: UVec2) -> RgbImage {
        RgbImage::from_fn(size.x, size.y, |x, y| {
            let [r, g, b] = self.0[(y * size.x + x) as usize];
            let color = Color::linear_rgb(r, g, b).to_srgba();
            image::Rgb(color.to_u8_array_no_alpha())
        })
    }
}

impl Reference {
    /// The share of the sun's light that arrives at each pixel of a picture, 0 to 1; `None`
    /// where none would anyway.
    pub fn shares(&self, picture: &Picture) -> Vec<Option<f32>> {
        let reference = self.lit.brightness().zip(self.dark.brightness());
        let pixels = reference.zip(picture.brightness());
        pixels
            .map(|((lit, dark), seen)| {
                let light = lit - dark;
                let shows = light > LEAST_LIGHT && light > LEAST_SHARE * dark;
                shows.then(|| ((seen - dark) / light).clamp(0.0, 1.0))
            })
            .collect()
    }
}
