//! Pure shadow-map mathematics on `glam` types, in `f64`, free of ECS, assets and GPU.
//!
//! One idea a file: [`split`] says where cascades end, [`mod@slice`] cuts the view volume there,
//! [`receivers`] says where there is anything to shadow, large meshes by their [`mesh_boxes`], and [`body`]
//! clips a slice to it.
//! [`light_frame`] is the fixed frame that maps live in, [`fit`] lays a map there and [`mod@warp`] one
//! in perspective; [`hysteresis`] keeps either from changing its size with every frame. [`hull`] decides
//! which casters can matter, [`coarse`] which can certainly not, and [`aliasing`] tells how good a map
//! is. [`bias`] says how much nearer to the light a lookup must be for a plane not to shadow itself.
//! [`face`] lays maps over the faces of a slice.

pub mod aliasing;
pub mod bias;
pub mod body;
pub mod coarse;
pub mod face;
pub mod fit;
pub mod half_space;
pub mod hull;
pub mod hysteresis;
pub mod light_frame;
pub mod mesh_boxes;
pub mod oriented_box;
pub mod receivers;
pub mod slice;
pub mod split;
pub mod warp;
