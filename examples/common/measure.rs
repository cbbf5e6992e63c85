//! Counts of shadow passes. Bevy's own pass records none, and rebuilds its draws view by view,
//! so that nothing can be drawn after it: its views are drawn as root views instead, into the
//! same maps, with a span that counts. For one camera only, since
//! cameras share Bevy's maps in turn.

#![allow(dead_code, reason = "shared by several binaries")]

use bevy::{
    core_pipeline::schedule::{Core3d, Core3dSystems, RootNonCameraView},
    diagnostic::{DiagnosticPath, DiagnosticsStore},
    ecs::schedule::ScheduleLabel,
    pbr::{Shadow, ShadowView, ViewLightEntities, main_build_indirect_parameters, prepare_lights},
    platform::time::Instant,
    prelude::*,
    render::{
        Render, RenderApp, RenderSystems,
        diagnostic::{RecordDiagnostics, RenderDiagnosticsPlugin},
        render_phase::ViewBinnedRenderPhases,
        render_resource::{RenderPassDescriptor, StoreOp},
        renderer::{RenderContext, ViewQuery},
        texture::DepthStencilViewAttachment,
        view::ExtractedView,
    },
};
use bevy_pssm::render::{PssmRenderSystems, SHADOW_PASS_SPAN};

const STOCK_SPAN: &str = "builtin_shadow_map";
/// Bevy's name for opaque and masked surfaces' pass.
const MAIN_SPAN: &str = "main_opaque_pass_3d";

/// Makes both passes' counts available.
pub struct MeasurePlugin;

/// A view of Bevy's that is drawn with a span: its number and its map.
#[derive(Component)]
struct Counted(usize, DepthStencilViewAttachment);

impl Plugin for MeasurePlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(RenderDiagnosticsPlugin);
        if let Some(render_app) = app.get_sub_app_mut(RenderApp) {
            render_app
                .add_systems(
                    Render,
                    take_stock_views
                        .in_set(RenderSystems::PrepareViews)
                        .after(prepare_lights)
                        .after(PssmRenderSystems::AdoptViews),
                )
                .add_systems(
                    Core3d,
                    draw_view
                        .after(main_build_indirect_parameters)
                        .before(Core3dSystems::MainPass),
                );
        }
    }
}

fn take_stock_views(
    mut commands: Commands,
    mut cameras: Query<&mut ViewLightEntities>,
    views: Query<&ShadowView>,
    counted: Query<Entity, With<Counted>>,
) {
    // The plugin may have taken them over.
    for view in &counted {
        commands
            .entity(view)
            .remove::<(Counted, RootNonCameraView)>();
    }
    for mut camera in &mut cameras {
        for (index, view) in camera.lights.drain(..).enumerate() {
            if let Ok(shadow_view) = views.get(view) {
                let map = shadow_view.depth_attachment.clone();
                commands
                    .entity(view)
                    .remove::<ShadowView>()
                    .insert((Counted(index, map), RootNonCameraView(Core3d.intern())));
            }
        }
    }
}

fn draw_view(
    world: &World,
    view: ViewQuery<(Entity, &Counted, &ExtractedView)>,
    phases: Res<ViewBinnedRenderPhases<Shadow>>,
    mut ctx: RenderContext,
) {
    let (entity, Counted(index, map), view) = view.into_inner();
    let Some(phase) = phases.get(&view.retained_view_entity) else {
        return;
    };
    let diagnostics = ctx.diagnostic_recorder();
    let diagnostics = diagnostics.as_deref();
    let mut pass = ctx.begin_tracked_render_pass(RenderPassDescriptor {
        label: Some(STOCK_SPAN),
        depth_stencil_attachment: Some(map.get_attachment(StoreOp::Store)),
        ..default()
    });
    let span = diagnostics.pass_span(&mut pass, format!("{STOCK_SPAN}_{index}"));
    if let Err(err) = phase.render(&mut pass, world, entity) {
        error!("Could not draw shadow casters: {err:?}");
    }
    span.end(&mut pass);
}

/// What the GPU did in a frame, all shadow maps together.
#[derive(Debug, Default, Clone, Copy)]
pub struct Counts {
    /// Vertex shader invocations of the shadow passes.
    pub vertices: f64,
    /// Primitives that reached their clipper.
    pub primitives: f64,
    /// Their fragment shader invocations.
    pub fragments: f64,
    /// Their time (milliseconds).
    pub milliseconds: f64,
    /// Vertex shader invocations of the main pass.
    pub main_vertices: f64,
    /// Primitives that reached its clipper.
    pub main_primitives: f64,
    /// Its fragment shader invocations.
    pub main_fragments: f64,
    /// Its time (milliseconds).
    pub main_milliseconds: f64,
}

/// The counts measured after `since`: the plugin's shadow passes, or Bevy's.
pub fn counts(store: &DiagnosticsStore, ours: bool, since: Instant) -> Counts {
    let span = if ours { SHADOW_PASS_SPAN } else { STOCK_SPAN };
    let value = |span: &str, what: &str| -> f64 {
        let path = DiagnosticPath::new(format!("render/{span}/{what}"));
        let measured = store.get_measurement(&path);
        measured.filter(|m| m.time > since).map_or(0.0, |m| m.value)
    };
    let total = |what: &str| -> f64 {
        (0..8)
            .map(|map| value(&format!("{span}_{map}"), what))
            .sum()
    };
    Counts {
        vertices: total("vertex_shader_invocations"),
        primitives: total("clipper_invocations"),
        fragments: total("fragment_shader_invocations"),
        milliseconds: total("elapsed_gpu"),
        main_vertices: value(MAIN_SPAN, "vertex_shader_invocations"),
        main_primitives: value(MAIN_SPAN, "clipper_invocations"),
        main_fragments: value(MAIN_SPAN, "fragment_shader_invocations"),
        main_milliseconds: value(MAIN_SPAN, "elapsed_gpu"),
    }
}
