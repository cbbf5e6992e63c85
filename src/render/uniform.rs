//! What the shader needs of each light and cascade, and the overlay, in the unused slots of Bevy's light uniform.
//!
//! Slots of the `directional_lights` array past the lights in use are not read by Bevy. From
//! the last slot downwards each managed light takes one; `shaders/slot.wesl` reads them.

use bevy::{
    ecs::{
        entity::Entity,
        query::With,
        system::{Query, Res},
    },
    pbr::{LightMeta, MAX_DIRECTIONAL_LIGHTS, Shadow, ViewLightsUniformOffset},
    render::{
        render_phase::ViewBinnedRenderPhases, render_resource::Buffer, renderer::RenderQueue,
        view::ExtractedView,
    },
};

use crate::{
    config::MAX_CASCADES,
    debug::{OLDEST, ShadowOverlay},
    shaders::{SLOT_MARK, code},
};

use super::{
    ExtractedShadows,
    hold::DrawnMaps,
    layout::{AdoptedLight, AdoptedLights},
    moving::MovingViews,
    options::LookupOptions,
    target::ShadowTarget,
};

/// Bytes of a light in the uniform, and where its fields lie (std140; `GpuDirectionalLight` of
/// `bevy_pbr` 0.20 keeps its fields private).
mod layout {
    pub(super) use crate::support::LIGHT_BYTES as LIGHT;
    pub const CASCADE: usize = 80;
    /// A column of a cascade's matrix, which comes first in it.
    pub const COLUMN: usize = 16;
    pub const TEXEL_SIZE: usize = 64;
    pub const FAR_BOUND: usize = 68;
    /// Planes through the view's edges, in columns that are free.
    pub const EDGES: [usize; 4] = [
        CASCADE + 3 * COLUMN,
        2 * CASCADE + 2 * COLUMN,
        2 * CASCADE + 3 * COLUMN,
        3 * CASCADE + 2 * COLUMN,
    ];
    pub const COLOR: usize = 320;
    pub const DIR_TO_LIGHT: usize = 336;
    /// Followed by the other bias.
    pub const SHADOW_DEPTH_BIAS: usize = 356;
    /// Followed by the first of its layers.
    pub const OVERLAP: usize = 368;
    pub const BASE_INDEX: usize = 372;
}

pub(super) fn write_uniforms(
    queue: Res<RenderQueue>,
    light_meta: Res<LightMeta>,
    target: Res<ShadowTarget>,
    extracted: Res<ExtractedShadows>,
    phases: Res<ViewBinnedRenderPhases<Shadow>>,
    drawn: Res<DrawnMaps>,
    moving: Res<MovingViews>,
    cameras: Query<(&ViewLightsUniformOffset, &AdoptedLights), With<ExtractedView>>,
    views: Query<&ExtractedView>,
) {
    let (Some(buffer), true) = (light_meta.view_gpu_lights.buffer(), target.size.x > 0) else {
        return;
    };
    let is_drawn = |view| {
        let drawn_now = views.get(view).ok();
        drawn.holds_casters(view)
            || moving.hold_casters(view)
            || drawn_now
                .and_then(|view| phases.get(&view.retained_view_entity))
                .is_some_and(|phase| !phase.is_empty())
    };
    for (offset, adopted) in &cameras {
        let lights = Lights {
            queue: &queue,
            buffer,
            offset: u64::from(offset.offset),
        };
        let last = MAX_DIRECTIONAL_LIGHTS - 1;
        let mut slots = vec![[0_f32; layout::LIGHT / 4]];
        write_at(
            &mut slots[0],
            layout::DIR_TO_LIGHT,
            &[
                SLOT_MARK as f32,
                target.built_in_size as f32,
                overlay_code(extracted.overlay) as f32,
            ],
        );
        let uv_per_texel = target.size.as_vec2().recip().to_array();
        write_at(&mut slots[0], layout::SHADOW_DEPTH_BIAS, &uv_per_texel);
        let mut managed = 0;
        for light in &adopted.lights {
            let index = light.index as usize;
            let base_layer = light.base_layer.to_ne_bytes();
            if !light.is_managed() {
                lights.write(index, layout::BASE_INDEX, &base_layer);
                continue;
            }
            if managed == slots.len() {
                slots.push([0.0; layout::LIGHT / 4]);
            }
            fill_slot(&mut slots[managed], light, is_drawn, &drawn);
            // What is no share tells the shader whose light it is, and where its slot is.
            let overlap = -1.0 - (last - managed) as f32;
            let fields = [overlap.to_ne_bytes(), base_layer];
            lights.write(index, layout::OVERLAP, fields.as_flattened());
            managed += 1;
        }
        for (position, slot) in slots.iter().enumerate() {
            let bytes: Vec<u8> = slot.iter().flat_map(|value| value.to_ne_bytes()).collect();
            lights.write(last - position, 0, &bytes);
        }
    }
}

/// The `lights` uniform of one camera.
struct Lights<'a> {
    queue: &'a RenderQueue,
    buffer: &'a Buffer,
    offset: u64,
}

impl Lights<'_> {
    fn write(&self, light: usize, field: usize, bytes: &[u8]) {
        let at = self.offset + (light * layout::LIGHT + field) as u64;
        self.queue.write_buffer(self.buffer, at, bytes);
    }
}

fn fill_slot(
    slot: &mut [f32; layout::LIGHT / 4],
    light: &AdoptedLight,
    is_drawn: impl Fn(Entity) -> bool,
    drawn: &DrawnMaps,
) {
    let mut ends = [f32::MAX; MAX_CASCADES];
    for (index, (view, cascade)) in light.cascades.iter().enumerate() {
        let Some(cascade) = cascade else {
            continue;
        };
        ends[index] = cascade.far;
        let is_drawn = cascade.has_map && (cascade.is_drawn_always || is_drawn(*view));
        let field = index * layout::CASCADE;
        write_at(
            slot,
            field,
            &[
                cascade.map_size.x as f32,
                cascade.map_size.y as f32,
                f32::from(u8::from(cascade.has_map)) + f32::from(u8::from(is_drawn)),
                light.options.border,
            ],
        );
        let age = drawn.age(*view) as f32 / OLDEST as f32;
        write_at(slot, field + layout::FAR_BOUND, &[age]);
        let [width, height] = cascade.texel;
        write_at(
            slot,
            field + layout::COLUMN,
            &[cascade.blend_start, width, height, cascade.depth_per_meter],
        );
        if let Some(wedge) = cascade.wedge {
            write_at(slot, field + layout::TEXEL_SIZE, &[1.0 + wedge.side as f32]);
            let [first, second] = wedge.normals;
            // Of neighboring sides, one lies where the other does not.
            write_at(slot, layout::EDGES[wedge.side], &first.to_array());
            write_at(
                slot,
                layout::EDGES[(wedge.side + 1) % 4],
                &(-second).to_array(),
            );
        }
    }
    write_at(slot, layout::COLOR, &ends);
    let LookupOptions { filter, bias, .. } = &light.options;
    write_at(slot, 2 * layout::COLUMN, filter);
    write_at(slot, 3 * layout::COLUMN, bias);
    write_at(
        slot,
        layout::CASCADE + 2 * layout::COLUMN,
        &light.options.bias_scale,
    );
}

fn overlay_code(overlay: ShadowOverlay) -> u32 {
    match overlay {
        ShadowOverlay::None => 0,
        ShadowOverlay::CascadeTint => code::OVERLAY_TINT,
        ShadowOverlay::Light => code::OVERLAY_LIGHT,
        ShadowOverlay::Cascade => code::OVERLAY_CASCADE,
        ShadowOverlay::Bias => code::OVERLAY_BIAS,
        ShadowOverlay::TexelsPerPixel => code::OVERLAY_TEXELS,
        ShadowOverlay::TexelGrid => code::OVERLAY_GRID,
        ShadowOverlay::Age => code::OVERLAY_AGE,
    }
}

fn write_at(slot: &mut [f32; layout::LIGHT / 4], byte: usize, values: &[f32]) {
    slot[byte / 4..byte / 4 + values.len()].copy_from_slice(values);
}
