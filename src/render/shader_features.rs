//! Which features of the shader the lights in the scene need.

use bevy::{
    ecs::{
        change_detection::DetectChangesMut,
        system::{Query, Res, ResMut},
    },
    light::DirectionalLight,
};

use crate::{
    debug::ShadowOverlay, plan::filter_of, shaders::ShaderFeatures, support::ShadowSupport,
    systems::ManagedLight,
};

/// Adds what this frame's lights need.
pub(super) fn add_needed(
    mut features: ResMut<ShaderFeatures>,
    overlay: Res<ShadowOverlay>,
    support: Res<ShadowSupport>,
    lights: Query<(&DirectionalLight, Option<&ManagedLight>)>,
) {
    let mut needed = *features;
    needed.overlays |= *overlay != ShadowOverlay::None;
    needed.built_in |= support.is_out_of_room();
    for (light, managed) in &lights {
        match managed.and_then(ManagedLight::config) {
            Some(config) => {
                let filter = filter_of(config, light);
                needed = needed.union(ShaderFeatures::needed_by(config, filter));
            }
            None => needed.built_in |= light.shadow_maps_enabled,
        }
    }
    features.set_if_neq(needed);
}
