//! What is predicted for each cascade.

use bevy::light::DirectionalLight;
use bevy_pssm::{
    ParallelSplitShadows, SplitScheme,
    geometry::{
        aliasing::Aliasing,
        fit,
        hysteresis::Slack,
        light_frame::LightFrame,
        slice::{BodyVertex, Slice, ViewVolume},
        warp::WarpFrame,
    },
    plan::lookup_reach,
};
use glam::{DMat4, DVec2, DVec3, UVec2};
use serde::Serialize;

/// View, light and maps.
pub struct Setup {
    pub view: ViewVolume,
    /// Unit vector.
    pub to_light: DVec3,
    /// Split planes, the first and last included (meters from the eye).
    pub planes: Vec<f64>,
    /// What they come from.
    pub splits: SplitScheme,
    pub fit: Fit,
    /// Texels per side of a map.
    pub map_size: u32,
    /// In pixels.
    pub image_height: f64,
    /// Width of the image over its height.
    pub aspect: f64,
}

/// How a map is laid over its slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fit {
    /// Tightly, in the view's frame.
    Body(Warp),
    /// As the plugin does by default.
    Stable,
}

/// How a map is warped.
#[derive(clap::ValueEnum, Debug, Clone, Copy, PartialEq, Eq)]
pub enum Warp {
    /// Orthographic.
    None,
    /// As strongly as light-space perspective shadow maps are: made for light from the side,
    /// worse than none for light almost along the view.
    Lispsm,
    /// As strongly as makes the worst error along the warp least; across it, it can cost up to
    /// 19 % more texels than none.
    Minimax,
}

/// One row of the report. Cascades without a map, because their planes fall together, have no
/// figures.
#[derive(Serialize, Debug, Clone, Copy)]
pub struct Cascade {
    /// From 1.
    pub cascade: usize,
    /// Where it begins and ends (meters from the eye).
    pub near: f64,
    pub far: f64,
    /// The worst over the cascade, along the map's axes.
    pub pixels_per_texel_x: Option<f64>,
    pub pixels_per_texel_y: Option<f64>,
    pub texels_per_pixel_x: Option<f64>,
    pub texels_per_pixel_y: Option<f64>,
    /// Texels that the map needs so that none shows, per pixel of the image.
    pub storage_factor: Option<f64>,
    /// Error just beyond over error just before the plane where the cascade begins.
    pub seam_x: Option<f64>,
    pub seam_y: Option<f64>,
}

impl Setup {
    /// Predicts all cascades, nearest first.
    pub fn cascades(&self) -> Vec<Cascade> {
        let depths = || self.planes.windows(2).map(|pair| (pair[0], pair[1]));
        let slices: Vec<_> = depths().map(|(a, b)| self.view.slice(a, b)).collect();
        let maps: Vec<_> = slices
            .iter()
            .zip(depths())
            .map(|(slice, (near, far))| self.map(slice.as_ref()?, near, far))
            .collect();
        (0..slices.len())
            .map(|index| {
                let slice = slices[index].as_ref();
                let map = maps[index].as_ref();
                let worst = slice.and_then(|slice| {
                    let map = map?;
                    Aliasing::over(&map.clip_from_world, map.axes, &slice.vertices())
                });
                let pixels = worst.map(|w| {
                    w.pixels_per_texel(DVec2::splat(f64::from(self.map_size)), self.image_height)
                });
                let seam = slice.filter(|_| index > 0).and_then(|slice| {
                    let [a, b, c, d, ..] = slice.vertices();
                    seam(maps[index - 1].as_ref()?, map?, [a, b, c, d])
                });
                Cascade {
                    cascade: index + 1,
                    near: self.planes[index],
                    far: self.planes[index + 1],
                    pixels_per_texel_x: pixels.map(|p| p.x),
                    pixels_per_texel_y: pixels.map(|p| p.y),
                    texels_per_pixel_x: pixels.map(|p| p.x.recip()),
                    texels_per_pixel_y: pixels.map(|p| p.y.recip()),
                    storage_factor: worst.map(|worst| worst.storage() / self.aspect),
                    seam_x: seam.map(|s| s.x),
                    seam_y: seam.map(|s| s.y),
                }
            })
            .collect()
    }

    fn map(&self, slice: &Slice, near: f64, far: f64) -> Option<Map> {
        match self.fit {
            Fit::Body(warp) => {
                let frame = WarpFrame::of_view(&self.view, self.to_light)?;
                let body = slice.vertices();
                let strength = match warp {
                    Warp::None => 0.0,
                    Warp::Lispsm => frame.lispsm_strength(near, far),
                    Warp::Minimax => frame.minimax_strength(&body),
                };
                Some(Map {
                    clip_from_world: frame.clip_from_world(&body, strength),
                    axes: [frame.x, frame.y],
                })
            }
            Fit::Stable => {
                let light = LightFrame::new(self.to_light)?;
                let reach = lookup_reach(
                    &ParallelSplitShadows::default(),
                    &DirectionalLight::default(),
                );
                let map = fit::stable(
                    slice,
                    &light,
                    UVec2::splat(self.map_size),
                    reach,
                    Slack(0.0),
                );
                Some(Map {
                    clip_from_world: map.clip_from_world(&light),
                    axes: [light.x, light.y],
                })
            }
        }
    }
}

/// A map and the directions in world space of its axes.
struct Map {
    clip_from_world: DMat4,
    axes: [DVec3; 2],
}

impl Map {
    fn aliasing(&self, vertex: BodyVertex) -> Option<Aliasing> {
        Aliasing::at(
            &self.clip_from_world,
            self.axes,
            vertex.position,
            vertex.image_height,
        )
    }
}

/// The ratio of two maps' errors that is farthest from one, axis by axis. Ratios are extreme at
/// the corners of the plane: they are affine functions' ratios, or the square of such.
fn seam(before: &Map, beyond: &Map, plane: [BodyVertex; 4]) -> Option<DVec2> {
    let farther = |a: f64, b: f64| if b.ln().abs() > a.ln().abs() { b } else { a };
    plane
        .map(|vertex| {
            let (before, beyond) = (before.aliasing(vertex)?, beyond.aliasing(vertex)?);
            Some(DVec2::new(beyond.x / before.x, beyond.z / before.z))
        })
        .into_iter()
        .reduce(|a, b| {
            let (a, b) = (a?, b?);
            Some(DVec2::new(farther(a.x, b.x), farther(a.y, b.y)))
        })
        .flatten()
}
