//! A value over time.

extern crate alloc;

use alloc::collections::VecDeque;

use bevy::{
    asset::RenderAssetUsages,
    prelude::*,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};

/// Pixels of a plot; there is a value in each column.
pub const PLOT_SIZE: UVec2 = UVec2::new(150, 36);

/// A value over time, frame by frame.
#[derive(Debug)]
pub struct Plot {
    /// What it shows.
    pub title: &'static str,
    /// [`PLOT_SIZE`] pixels.
    pub image: Handle<Image>,
    /// The last ones, in order: one for each column at most.
    pub values: VecDeque<f32>,
    color: [u8; 3],
}

const GROUND: [u8; 4] = [18, 20, 26, 255];

/// An empty plot.
pub(super) fn ground() -> Image {
    let size = Extent3d {
        width: PLOT_SIZE.x,
        height: PLOT_SIZE.y,
        depth_or_array_layers: 1,
    };
    Image::new_fill(
        size,
        TextureDimension::D2,
        &GROUND,
        TextureFormat::Rgba8UnormSrgb,
        RenderAssetUsages::default(),
    )
}

impl Plot {
    pub(super) fn new(title: &'static str, color: [u8; 3], image: Handle<Image>) -> Self {
        Self {
            title,
            image,
            values: VecDeque::with_capacity(PLOT_SIZE.x as usize + 1),
            color,
        }
    }

    /// The value at its upper edge: the largest that it shows.
    pub fn top(&self) -> f32 {
        self.values.iter().copied().fold(0.0, f32::max)
    }

    pub(super) fn push(&mut self, value: f64) {
        self.values.push_back(value as f32);
        if self.values.len() > PLOT_SIZE.x as usize {
            self.values.pop_front();
        }
    }

    /// Bars, the last of them at the right edge.
    pub(super) fn paint(&self, images: &mut Assets<Image>) {
        let Some(mut image) = images.get_mut(&self.image) else {
            return;
        };
        let Some(data) = image.data.as_mut() else {
            return;
        };
        let [width, height] = PLOT_SIZE.to_array().map(|side| side as usize);
        let per_pixel = self.top().max(f32::MIN_POSITIVE) / PLOT_SIZE.y as f32;
        let empty = width - self.values.len().min(width);
        let [red, green, blue] = self.color;
        for (index, pixel) in data.chunks_exact_mut(4).enumerate() {
            let (column, row) = (index % width, index / width);
            let value = column.checked_sub(empty);
            let value = value.and_then(|column| self.values.get(column));
            let bar = value.map_or(0.0, |value| value / per_pixel);
            // From the middle of the pixel on.
            let is_bar = (height - row) as f32 <= bar + 0.5;
            let color = if is_bar {
                [red, green, blue, 255]
            } else {
                GROUND
            };
            pixel.copy_from_slice(&color);
        }
    }
}
