//! Pictures rendered headless and read back.

#[path = "../../examples/common/headless.rs"]
mod headless;
mod stage;

use bevy::prelude::*;
use bevy_pssm::prelude::*;
use stage::Stage;

#[test]
fn first_light() {
    let mut stage = Stage::new();
    let sun = stage.sun();
    let stock = stage.picture();
    stock.save("/tmp/stock.png").unwrap();
    stage.world().entity_mut(sun).insert(stage::shadows());
    let ours = stage.picture();
    ours.save("/tmp/ours.png").unwrap();
    eprintln!("{:#?}", headless::take_warnings());
}
