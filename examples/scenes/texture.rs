//! A fine grain for grounds, whose vertices are meters apart.

use bevy::{
    asset::RenderAssetUsages,
    image::{ImageAddressMode, ImageFilterMode, ImageSampler, ImageSamplerDescriptor},
    prelude::*,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};

use super::noise::random;

/// Side of the texture (texels).
const SIZE: u32 = 512;

/// A tiling gray grain with its smaller versions, 1 on average (as far as that can be held).
pub(super) fn grain(seed: u64, contrast: f32) -> Image {
    let mut level: Vec<f32> = (0..SIZE * SIZE)
        .map(|k| {
            let (x, y) = (
                (k % SIZE) as f32 / SIZE as f32,
                (k / SIZE) as f32 / SIZE as f32,
            );
            let mut sum = 0.0;
            // No coarse features: they would show the repetition.
            for (octave, cells) in [31_u32, 67, 140, 256].into_iter().enumerate() {
                let weight = 0.8_f32.powi(octave as i32);
                sum += weight * tiling_noise(x, y, cells, seed + octave as u64);
            }
            0.8 + 0.2 * (contrast * sum).clamp(-1.0, 1.0)
        })
        .collect();
    let mut data = Vec::new();
    let mut levels = 0;
    let mut size = SIZE;
    loop {
        for value in &level {
            let byte = (value * 255.0) as u8;
            data.extend([byte, byte, byte, 255]);
        }
        levels += 1;
        if size == 1 {
            break;
        }
        let half = size / 2;
        let at = |x: u32, y: u32| level[(y * size + x) as usize];
        let smaller = (0..half * half)
            .map(|k| {
                let (x, y) = (2 * (k % half), 2 * (k / half));
                0.25 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1))
            })
            .collect();
        level = smaller;
        size = half;
    }
    let extent = Extent3d {
        width: SIZE,
        height: SIZE,
        depth_or_array_layers: 1,
    };
    // `Image::new` would insist on a single level's data.
    let mut image = Image::new_uninit(
        extent,
        TextureDimension::D2,
        TextureFormat::Rgba8UnormSrgb,
        RenderAssetUsages::RENDER_WORLD,
    );
    image.data = Some(data);
    image.texture_descriptor.mip_level_count = levels;
    image.sampler = ImageSampler::Descriptor(ImageSamplerDescriptor {
        address_mode_u: ImageAddressMode::Repeat,
        address_mode_v: ImageAddressMode::Repeat,
        mag_filter: ImageFilterMode::Linear,
        min_filter: ImageFilterMode::Linear,
        // Not anisotropic: with multisampling that hangs Mesa's software device.
        mipmap_filter: ImageFilterMode::Linear,
        ..default()
    });
    image
}

/// Value noise on [0, 1)² that tiles.
fn tiling_noise(x: f32, y: f32, cells: u32, seed: u64) -> f32 {
    let (x, y) = (x * cells as f32, y * cells as f32);
    let (i, j) = (x as u32, y as u32);
    let fade = |t: f32| t * t * (3.0 - 2.0 * t);
    let (tx, ty) = (fade(x.fract()), fade(y.fract()));
    let at =
        |i: u32, j: u32| random(seed, u64::from((i % cells) + (j % cells) * cells)) * 2.0 - 1.0;
    let top = at(i, j) * (1.0 - tx) + at(i + 1, j) * tx;
    let bottom = at(i, j + 1) * (1.0 - tx) + at(i + 1, j + 1) * tx;
    top * (1.0 - ty) + bottom * ty
}
