//! Pictures are whole while the shader's parts change.

use bevy::{
    ecs::{
        change_detection::DetectChangesMut,
        resource::Resource,
        system::{Local, Res, ResMut},
    },
    render::{
        Extract,
        render_resource::{CachedRenderPipelineId, PipelineCache},
    },
};

use crate::shaders::{ShaderFeatures, ShadowModules};

/// The features that are compiled into the modules of this frame.
#[derive(Resource, Debug, Default, PartialEq)]
pub(super) struct CompiledFeatures(Option<ShaderFeatures>);

pub(super) fn extract_features(
    mut features: ResMut<CompiledFeatures>,
    modules: Extract<Res<ShadowModules>>,
) {
    features.set_if_neq(CompiledFeatures(modules.compiled()));
}

/// Once features change, all pipelines that look shadows up are made anew, and what they draw would
/// be missing until they are.
pub(super) fn wait_for_pipelines(
    mut cache: ResMut<PipelineCache>,
    features: Res<CompiledFeatures>,
    mut drawn_with: Local<Option<ShaderFeatures>>,
) {
    let before = core::mem::replace(&mut *drawn_with, features.0);
    if before.is_none() || before == features.0 {
        return;
    }
    let waiting: Vec<_> = cache.waiting_pipelines().collect();
    // All at once, by the pool's threads.
    cache.process_queue();
    for pipeline in waiting {
        cache.block_on_render_pipeline(CachedRenderPipelineId::new(pipeline));
    }
}
