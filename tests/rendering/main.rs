//! Pictures rendered headless and read back.

#[path = "../../examples/explore/app/mod.rs"]
mod explore;
#[path = "../../examples/common/headless.rs"]
mod headless;
#[path = "../../examples/common/measure.rs"]
mod measure;
#[path = "../../examples/tradeoff/pareto.rs"]
mod pareto;
#[path = "../../examples/scenes/mod.rs"]
mod scene;
#[path = "../../examples/common/scene_stage.rs"]
mod scene_stage;
#[path = "../../examples/tradeoff/study/mod.rs"]
mod study;
#[path = "../../examples/truth/mod.rs"]
mod truth;
#[path = "../../examples/common/warnings.rs"]
mod warnings;

mod bias;
mod casters;
mod compare;
mod drop_in;
mod explorer;
mod far;
mod guests;
mod hold;
mod life_cycle;
mod maps;
mod obstacles;
mod scenes;
mod shader_module;
mod soak;
mod soft;
mod stability;
mod stage;
mod suns;
mod tradeoff;
