//! Everything that needs no GPU: mathematics, configuration, ECS behaviour.

mod culling;
mod lights;
mod presets;
mod splits;
mod stability;
mod views;
