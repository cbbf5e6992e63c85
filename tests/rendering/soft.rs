//! Soft shadows' pattern changes from frame to frame where temporal antialiasing evens it out.

use bevy::{
    core_pipeline::prepass::{DeferredPrepass, DepthPrepass},
    light::ShadowFilteringMethod,
    pbr::DefaultOpaqueRendererMethod,
    prelude::*,
    render::camera::TemporalJitter,
};
use bevy_pssm::prelude::*;

use crate::{
    compare::share_differing,
    stage::{Stage, shadows},
};

/// Whether two frames of a scene at rest differ.
fn changes(is_deferred: bool, of_camera: impl Bundle) -> bool {
    let mut stage = Stage::new();
    let camera = stage.camera();
    let world = stage.world();
    world.entity_mut(camera).insert(of_camera);
    if is_deferred {
        world.insert_resource(DefaultOpaqueRendererMethod::deferred());
        world
            .entity_mut(camera)
            .insert((DepthPrepass, DeferredPrepass));
    }
    let sun = stage.sun();
    stage.world().entity_mut(sun).insert(ParallelSplitShadows {
        filter: ShadowFilter::Soft { sun_degrees: 3.0 },
        ..shadows()
    });
    let before = stage.picture();
    let after = stage.picture();
    share_differing(&before, &after, 0) > 0.0
}

#[test]
fn patterns_follow_temporal_antialiasing() {
    let jitter = || TemporalJitter {
        offset: Vec2::new(0.3, -0.2),
    };
    for is_deferred in [false, true] {
        assert!(!changes(is_deferred, ()), "{is_deferred}");
        assert!(changes(is_deferred, jitter()), "{is_deferred}");
        assert!(
            changes(is_deferred, ShadowFilteringMethod::Temporal),
            "{is_deferred}"
        );
    }
}
