//! What the GPU did, side by side, and what memory maps take.

use bevy::{
    diagnostic::{Diagnostic, DiagnosticsStore},
    pbr::{LightEntity, ViewShadowBindings},
    platform::{
        sync::{Arc, Mutex},
        time::Instant,
    },
    prelude::*,
    render::render_resource::Texture,
};
use bevy_pssm::{AdoptedMap, config::MAX_CASCADES, render::SHADOW_PASS_SPAN};

use super::super::{maps::SideMaps, sides::Side};
use super::PassFigures;

/// The plugin's span for what moves in a map, whose name it does not export.
const MOVING_PASS_SPAN: &str = "pssm_moving_casters";
/// Bevy's spans for what cameras see. All cameras have the same ones, so that their sum is all there is to know.
const MAIN_SPANS: [&str; 2] = ["main_opaque_pass_3d", "main_transparent_pass_3d"];
const CPU_TIME: &str = "elapsed_cpu";
const GPU_TIME: &str = "elapsed_gpu";
const VERTICES: &str = "vertex_shader_invocations";
const PRIMITIVES: &str = "clipper_invocations";

/// What the render world tells.
#[derive(Resource, Clone, Default)]
pub(super) struct Heard(Arc<Mutex<Maps>>);

impl Heard {
    /// The latest; none if a thread has died over it.
    pub fn maps(&self) -> Option<Maps> {
        Some(*self.0.lock().ok()?)
    }
}

/// Layers of the plugin's array, by side and cascade.
pub(super) type Layers = [[Option<u32>; MAX_CASCADES]; 2];

/// The sides' maps, and all.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Maps {
    pub layers: Layers,
    /// What all maps take.
    pub bytes: u64,
}

/// Runs in the render world, once maps have their layers.
pub(super) fn listen(
    heard: Res<Heard>,
    maps: Res<SideMaps>,
    bindings: Query<&ViewShadowBindings>,
    views: Query<(&LightEntity, Has<AdoptedMap>)>,
) {
    if let Ok(mut heard) = heard.0.lock() {
        *heard = Maps {
            layers: maps.maps.map(|side| side.map(|map| Some(map?.layer))),
            bytes: bytes_of_maps(&bindings, &views),
        };
    }
}

/// All cameras' maps lie in one array, or, where Bevy draws them, each camera has its own or shares it.
fn bytes_of_maps(
    bindings: &Query<&ViewShadowBindings>,
    views: &Query<(&LightEntity, Has<AdoptedMap>)>,
) -> u64 {
    let mut arrays: Vec<&Texture> = Vec::new();
    for it in bindings {
        let array = &it.directional_light_depth_texture;
        if arrays.iter().all(|known| known.id() != array.id()) {
            arrays.push(array);
        }
    }
    let layer = |array: &Texture| {
        let texel = array.format().block_copy_size(None).unwrap_or(4);
        u64::from(texel) * u64::from(array.width()) * u64::from(array.height())
    };
    let layers = arrays
        .iter()
        .map(|array| layer(array) * u64::from(array.depth_or_array_layers()));
    let largest = arrays.iter().map(|array| layer(array)).max();
    layers.sum::<u64>() + copies(views) * largest.unwrap_or(0)
}

/// Maps in which something moves have a copy of what rests. Such a map has two views, of which the plugin marks
/// one only; while it draws no maps, it marks none.
fn copies(views: &Query<(&LightEntity, Has<AdoptedMap>)>) -> u64 {
    let of_suns = views
        .iter()
        .filter(|(light, _)| matches!(light, LightEntity::Directional { .. }));
    let (own, over): (Vec<_>, Vec<_>) = of_suns.partition(|(_, is_adopted)| *is_adopted);
    if own.is_empty() { 0 } else { over.len() as u64 }
}

/// What the GPU did in a frame.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct GpuReport {
    main: f64,
    passes: [PassSums; 2],
    is_timed: bool,
    is_counted: bool,
}

#[derive(Debug, Clone, Copy, Default)]
struct PassSums {
    vertices: f64,
    primitives: f64,
    milliseconds: f64,
}

impl GpuReport {
    /// Of the last frame that the GPU has reported, unless that is known: some frames after it was drawn.
    pub fn of_latest(
        store: &DiagnosticsStore,
        layers: &Layers,
        known: &mut Option<Instant>,
    ) -> Option<Self> {
        let time_of = |it: &Diagnostic| {
            span_and_field(it.path().as_str())?;
            Some(it.measurement()?.time)
        };
        // All that is of one frame has the same time.
        let latest = store.iter().filter_map(time_of).max()?;
        if known.replace(latest) == Some(latest) {
            return None;
        }
        let mut report = Self::default();
        for diagnostic in store.iter().filter(|it| time_of(it) == Some(latest)) {
            if let Some((span, field)) = span_and_field(diagnostic.path().as_str()) {
                // Of cameras that have a span in common, each has added its own.
                let measured = diagnostic.measurements();
                let of_frame = measured.filter(|it| it.time == latest);
                report.add(span, field, of_frame.map(|it| it.value).sum(), layers);
            }
        }
        Some(report)
    }

    fn add(&mut self, span: &str, field: &str, value: f64, layers: &Layers) {
        self.is_timed |= field == GPU_TIME;
        self.is_counted |= field == VERTICES;
        if field == GPU_TIME && MAIN_SPANS.contains(&span) {
            self.main += value;
        }
        let Some(layer) = layer_of(span) else {
            return;
        };
        let side = layers.iter().position(|side| side.contains(&Some(layer)));
        if let Some(sums) = side.and_then(|side| self.passes.get_mut(side)) {
            match field {
                GPU_TIME => sums.milliseconds += value,
                VERTICES => sums.vertices += value,
                PRIMITIVES => sums.primitives += value,
                _ => {}
            }
        }
    }

    /// Both frames' sum.
    pub fn plus(self, other: Self) -> Self {
        let plus = |a: PassSums, b: PassSums| PassSums {
            vertices: a.vertices + b.vertices,
            primitives: a.primitives + b.primitives,
            milliseconds: a.milliseconds + b.milliseconds,
        };
        Self {
            main: self.main + other.main,
            passes: [0, 1].map(|side| plus(self.passes[side], other.passes[side])),
            is_timed: self.is_timed || other.is_timed,
            is_counted: self.is_counted || other.is_counted,
        }
    }

    /// Of so many frames' sum.
    pub fn main_of(&self, frames: f64) -> Option<f64> {
        self.is_timed.then_some(self.main / frames)
    }

    /// A side's share of that.
    pub fn passes_of(&self, side: Side, frames: f64) -> PassFigures {
        let sums = self.passes[side.index()];
        let counted = |sum: f64| self.is_counted.then_some(sum / frames);
        PassFigures {
            vertices: counted(sums.vertices),
            primitives: counted(sums.primitives),
            milliseconds: self.is_timed.then_some(sums.milliseconds / frames),
        }
    }
}

/// Which pass of the renderer a diagnostic is of, and what of it. Passes of views without a camera are within
/// another span, or not, as threads have it.
fn span_and_field(path: &str) -> Option<(&str, &str)> {
    let (spans, field) = path.strip_prefix("render/")?.rsplit_once('/')?;
    let is_known = [CPU_TIME, GPU_TIME, VERTICES, PRIMITIVES].contains(&field);
    is_known.then_some((spans.rsplit('/').next()?, field))
}

/// The layer that a shadow pass draws into.
fn layer_of(span: &str) -> Option<u32> {
    [SHADOW_PASS_SPAN, MOVING_PASS_SPAN]
        .into_iter()
        .find_map(|name| span.strip_prefix(name)?.strip_prefix('_')?.parse().ok())
}
