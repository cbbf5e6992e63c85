//! Everything that needs no GPU: mathematics, configuration, ECS behavior.

#[path = "../../examples/common/server.rs"]
mod server;
#[path = "../../examples/common/warnings.rs"]
mod warnings;

mod aliasing;
mod bias;
mod body;
mod casters;
mod culling;
mod faces;
mod fitted;
mod fuzz;
mod held;
mod layers;
mod lights;
mod motion;
mod predict;
mod presets;
mod receivers;
mod reload;
mod rest;
mod rounding;
mod saved;
mod splits;
mod stability;
mod streets;
mod stress;
mod sun;
mod updates;
mod views;
mod warp;
