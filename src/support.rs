//! What this GPU and this Bevy allow: the one decision whether the plugin may take over.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::OnceLock;

use bevy::{ecs::resource::Resource, log::warn, platform::sync::Arc};

use crate::config::MAX_CASCADES;

/// Bytes of a light in Bevy's uniform (std140; `GpuDirectionalLight` of `bevy_pbr` 0.20).
pub(crate) const LIGHT_BYTES: usize = 400;

/// What the plugin counts on: tests ask for more.
#[derive(Resource, Debug, Clone, Copy)]
pub struct Requirements {
    /// Layers that array textures must be able to have.
    pub array_layers: u32,
    /// The size that a light in Bevy's uniform must have (bytes).
    pub light_bytes: u64,
}

impl Default for Requirements {
    fn default() -> Self {
        Self {
            array_layers: MAX_CASCADES as u32,
            light_bytes: LIGHT_BYTES as u64,
        }
    }
}

/// Why Bevy's own shadows stay in force.
#[derive(thiserror::Error, Debug, Clone, PartialEq, Eq)]
pub enum Obstacle {
    /// An array texture has no room for one light's cascades (WebGL2 has none).
    #[error("the GPU's array textures have {found} layers, but one light needs {needed}")]
    ArrayLayers {
        /// What the GPU allows.
        found: u32,
        /// What one light's cascades take.
        needed: u32,
    },
    /// Shaders cannot load depths texel by texel (OpenGL).
    #[error("shaders cannot load texels of depth textures on {0}")]
    DepthLoads(String),
    /// The light uniform has no room for a light and its data.
    #[error("Bevy's light uniform has room for {lights} lights of {cascades} cascades")]
    LightSlots {
        /// Lights in the uniform.
        lights: usize,
        /// Cascades of a light.
        cascades: usize,
    },
    /// The light uniform is laid out in another way.
    #[error("a light takes {found} bytes of Bevy's light uniform instead of {expected}")]
    LightBytes {
        /// What Bevy's takes.
        found: u64,
        /// What the plugin writes.
        expected: u64,
    },
    /// Bevy's shadow module lacks what the plugin renames or redirects.
    #[error("Bevy's shader module {path} has no `{missing}`")]
    ShaderModule {
        /// Where Bevy keeps it.
        path: &'static str,
        /// What was looked for.
        missing: String,
    },
    /// The position of a light in the uniform cannot be read from its pass' label.
    #[error("Bevy labels a shadow pass `{0}`, from which no light's index can be read")]
    PassLabel(String),
}

/// What the GPU and Bevy allow, shared by both worlds and the preset loader.
#[derive(Resource, Debug, Clone)]
pub struct ShadowSupport(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    max_map_size: Arc<AtomicU32>,
    draws_warps: AtomicBool,
    obstacle: OnceLock<Obstacle>,
    is_out_of_room: AtomicBool,
}

impl Default for ShadowSupport {
    fn default() -> Self {
        // Without a renderer (servers, tests) planning goes on as though there were one, that allows
        // what every desktop GPU of the last decade does.
        Self(Arc::new(Inner {
            max_map_size: Arc::new(AtomicU32::new(16384)),
            draws_warps: AtomicBool::new(true),
            obstacle: OnceLock::new(),
            is_out_of_room: AtomicBool::new(false),
        }))
    }
}

impl ShadowSupport {
    /// Whether the plugin may draw and look up the shadows of managed lights.
    pub fn may_take_over(&self) -> bool {
        self.0.obstacle.get().is_none()
    }

    /// Leaves all lights to Bevy from now on, and says why once.
    pub fn refuse(&self, obstacle: Obstacle) {
        if self.0.obstacle.set(obstacle.clone()).is_ok() {
            warn!("Bevy's own shadows stay in force: {obstacle}");
        }
    }

    /// The longest side of a map (texels).
    pub fn max_map_size(&self) -> &Arc<AtomicU32> {
        &self.0.max_map_size
    }

    /// Whether maps in perspective can be drawn: Bevy's stand-in for unclipped depth does not
    /// divide by w.
    pub fn draws_warps(&self) -> bool {
        self.0.draws_warps.load(Ordering::Relaxed)
    }

    pub fn set_device(&self, max_map_size: u32, draws_warps: bool) {
        self.0.max_map_size.store(max_map_size, Ordering::Relaxed);
        self.0.draws_warps.store(draws_warps, Ordering::Relaxed);
    }

    /// Whether layers or slots have run out, so that Bevy's pass draws the cascades for now.
    pub fn is_out_of_room(&self) -> bool {
        self.0.is_out_of_room.load(Ordering::Relaxed)
    }

    /// Whether the plugin draws all cascades.
    pub fn draws_maps(&self) -> bool {
        self.may_take_over() && !self.is_out_of_room()
    }

    pub fn set_out_of_room(&self, is_out_of_room: bool) {
        self.0
            .is_out_of_room
            .store(is_out_of_room, Ordering::Relaxed);
    }
}
