//! Overlays for finding out what the shadows are doing; off by default.

use bevy::{
    ecs::{reflect::ReflectResource, resource::Resource},
    reflect::{Reflect, std_traits::ReflectDefault},
};

/// What is drawn over the picture.
#[derive(Resource, Reflect, Debug, Default, Clone, Copy, PartialEq, Eq)]
#[reflect(Resource, Default, Debug, Clone, PartialEq)]
pub struct ShadowOverlay {
    /// Colours the light of managed lights by cascade: red, green, blue, yellow, and grey where
    /// shadows have ended.
    pub cascade_tint: bool,
}
