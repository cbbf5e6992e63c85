//! Numbers at their extremes: whatever camera, sun, scene and settings come together, maps are
//! sound, hold all that is seen, and say the same in `f32` as in `f64`.

mod bad_worlds;
mod beside;
mod built_in;
pub mod case;
mod extremes;
mod random;
