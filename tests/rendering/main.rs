//! Pictures rendered headless and read back.

#[path = "../../examples/common/headless.rs"]
mod headless;

mod compare;
mod drop_in;
mod life_cycle;
mod maps;
mod shader_module;
mod stability;
mod stage;
