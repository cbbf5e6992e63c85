//! Pictures rendered headless and read back.

#[path = "../../examples/common/headless.rs"]
mod headless;

mod compare;
mod drop_in;
mod life_cycle;
mod maps;
mod stage;
