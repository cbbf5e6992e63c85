//! Overlays for finding out what the shadows are doing; off by default.

use bevy::{
    ecs::{reflect::ReflectResource, resource::Resource},
    reflect::{Reflect, std_traits::ReflectDefault},
};

/// What managed lights show in the picture.
///
/// All but [`ShadowOverlay::CascadeTint`] take the place of the light's own light, whatever the
/// material: surfaces that receive shadows show a color, on top of what other lights add.
/// Numbers are grays of linear light, read off pictures in float formats as they are.
#[derive(Resource, Reflect, Debug, Default, Clone, Copy, PartialEq, Eq)]
#[reflect(Resource, Default, Debug, Clone, PartialEq)]
pub enum ShadowOverlay {
    /// Nothing but its light.
    #[default]
    None,
    /// Its light in the color of the cascade: red, green, blue, yellow, and gray where shadows
    /// have ended. Of cascades that share a slice, the first one's.
    CascadeTint,
    /// The share of its light that arrives: white where all does.
    Light,
    /// The cascade by the same colors.
    Cascade,
    /// The most by which a texel next to the point may be nearer to the light and still be the surface
    /// itself, in texels: 0.1 (linear) is one. What goes along the normal instead, where planes rise by
    /// more than 16, is not shown.
    Bias,
    /// Texels of the map across a pixel, where they are fewest: below 0.5 (linear), which is
    /// one, texels show.
    TexelsPerPixel,
    /// The texels of the map, as a checkerboard of squares of 32 a side in the cascade's
    /// color; darker in shadow (as Lloyd et al. 2006, Figs. 2 and 15).
    TexelGrid,
    /// For how many frames the map has been held since what rests was drawn into it: 0.1 (linear) are 60.
    Age,
}

/// Frames that [`ShadowOverlay::Age`] shows as white.
pub const OLDEST: u32 = 600;

/// Texels along the sides of the squares of [`ShadowOverlay::TexelGrid`].
pub const GRID_TEXELS: u32 = 32;
