//! Pure shadow-map mathematics on `glam` types, in `f64`, free of ECS, assets and GPU.
//!
//! One idea a file: [`split`] says where cascades end, [`mod@slice`] cuts the view volume there,
//! [`light_frame`] is the fixed frame that maps live in, [`fit`] lays a map over a slice,
//! [`hull`] decides which casters can matter and [`aliasing`] tells how good a map is. [`bias`] says
//! how much nearer to the light a lookup must be for a plane not to shadow itself. [`warp`]
//! and [`face`] lay the maps that the literature compares with.

pub mod aliasing;
pub mod bias;
pub mod face;
pub mod fit;
pub mod hull;
pub mod light_frame;
pub mod slice;
pub mod split;
pub mod warp;
