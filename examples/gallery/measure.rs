//! Counts of Bevy's own shadow pass, which records none: its phases are drawn once more, into a
//! scratch map, with a span that counts.

use bevy::{
    core_pipeline::schedule::{Core3d, Core3dSystems},
    diagnostic::{DiagnosticPath, DiagnosticsStore},
    pbr::{
        CORE_3D_SHADOW_MAP_FORMAT, LATE_SHADOW_PASS, Shadow, ViewLightEntities,
        per_view_shadow_pass,
    },
    platform::time::Instant,
    prelude::*,
    render::{
        RenderApp,
        diagnostic::{RecordDiagnostics, RenderDiagnosticsPlugin},
        render_phase::ViewBinnedRenderPhases,
        render_resource::{
            Extent3d, LoadOp, Operations, RenderPassDepthStencilAttachment, RenderPassDescriptor,
            StoreOp, TextureDescriptor, TextureDimension, TextureUsages, TextureView,
        },
        renderer::{RenderContext, RenderDevice, ViewQuery},
        view::ExtractedView,
    },
};
use bevy_pssm::render::SHADOW_PASS_SPAN;

const STOCK_SPAN: &str = "builtin_shadow_map";

/// Makes both passes' counts available.
pub struct MeasurePlugin;

impl Plugin for MeasurePlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(RenderDiagnosticsPlugin);
        if let Some(render_app) = app.get_sub_app_mut(RenderApp) {
            render_app.add_systems(
                Core3d,
                draw_again
                    .after(per_view_shadow_pass::<LATE_SHADOW_PASS>)
                    .before(Core3dSystems::MainPass),
            );
        }
    }
}

fn draw_again(
    world: &World,
    camera: ViewQuery<&ViewLightEntities>,
    views: Query<&ExtractedView>,
    phases: Res<ViewBinnedRenderPhases<Shadow>>,
    device: Res<RenderDevice>,
    mut scratch: Local<Option<(u32, TextureView)>>,
    mut ctx: RenderContext,
) {
    for (index, light_view) in camera.into_inner().lights.iter().enumerate() {
        let Ok(view) = views.get(*light_view) else {
            continue;
        };
        let Some(phase) = phases.get(&view.retained_view_entity) else {
            continue;
        };
        let size = view.viewport.z;
        if scratch.as_ref().is_none_or(|(held, _)| *held != size) {
            let texture = device.create_texture(&TextureDescriptor {
                label: Some("scratch_shadow_map"),
                size: Extent3d {
                    width: size,
                    height: size,
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: TextureDimension::D2,
                format: CORE_3D_SHADOW_MAP_FORMAT,
                usage: TextureUsages::RENDER_ATTACHMENT,
                view_formats: &[],
            });
            *scratch = Some((size, texture.create_view(&default())));
        }
        let Some((_, target)) = scratch.as_ref() else {
            continue;
        };
        let diagnostics = ctx.diagnostic_recorder();
        let diagnostics = diagnostics.as_deref();
        let mut pass = ctx.begin_tracked_render_pass(RenderPassDescriptor {
            label: Some(STOCK_SPAN),
            depth_stencil_attachment: Some(RenderPassDepthStencilAttachment {
                view: target,
                depth_ops: Some(Operations {
                    load: LoadOp::Clear(0.0),
                    store: StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..default()
        });
        let span = diagnostics.pass_span(&mut pass, format!("{STOCK_SPAN}_{index}"));
        if let Err(err) = phase.render(&mut pass, world, *light_view) {
            error!("Could not draw shadow casters: {err:?}");
        }
        span.end(&mut pass);
    }
}

/// What shadow passes did in a frame, all maps together.
#[derive(Debug, Default, Clone, Copy)]
pub struct Counts {
    /// Vertex shader invocations.
    pub vertices: f64,
    /// Primitives that reached the clipper.
    pub primitives: f64,
}

/// The counts measured after `since`: the plugin's, or Bevy's.
pub fn counts(store: &DiagnosticsStore, ours: bool, since: Instant) -> Counts {
    let span = if ours { SHADOW_PASS_SPAN } else { STOCK_SPAN };
    let total = |what: &str| -> f64 {
        (0..8)
            .filter_map(|map| {
                let path = DiagnosticPath::new(format!("render/{span}_{map}/{what}"));
                let measured = store.get_measurement(&path)?;
                (measured.time > since).then_some(measured.value)
            })
            .sum()
    };
    Counts {
        vertices: total("vertex_shader_invocations"),
        primitives: total("clipper_invocations"),
    }
}
