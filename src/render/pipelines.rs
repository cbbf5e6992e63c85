//! Pictures are whole, and maps up to date, while shaders change.

use bevy::{
    asset::AssetEvent,
    ecs::{
        change_detection::DetectChangesMut,
        message::MessageReader,
        resource::Resource,
        system::{Local, Res, ResMut},
    },
    render::{
        Extract,
        render_resource::{CachedRenderPipelineId, PipelineCache},
    },
    shader::Shader,
};

use super::hold::DrawnMaps;
use crate::shaders::{ShaderFeatures, ShadowModules};

/// The features that are compiled into the modules of this frame.
#[derive(Resource, Debug, Default, PartialEq)]
pub(super) struct CompiledFeatures(Option<ShaderFeatures>);

pub(super) fn have_shaders_changed(
    features: Res<CompiledFeatures>,
    modules: Extract<Res<ShadowModules>>,
    mut shaders: Extract<MessageReader<AssetEvent<Shader>>>,
) -> bool {
    // Messages are read in every frame, or they would be found later.
    let are_any_loaded = shaders.read().count() > 0;
    are_any_loaded || features.0 != modules.compiled()
}

/// Takes over what is compiled: other shaders draw other maps.
pub(super) fn extract_shaders(
    mut features: ResMut<CompiledFeatures>,
    mut drawn: ResMut<DrawnMaps>,
    modules: Extract<Res<ShadowModules>>,
) {
    features.set_if_neq(CompiledFeatures(modules.compiled()));
    drawn.forget();
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
