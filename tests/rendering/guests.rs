//! Other crates' systems draw into the maps of managed lights.

use bevy::{
    prelude::*,
    render::{
        RenderApp,
        render_resource::{
            LoadOp, Operations, RenderPassDepthStencilAttachment, RenderPassDescriptor, StoreOp,
        },
        renderer::{RenderContext, ViewQuery},
        settings::WgpuSettings,
    },
};
use bevy_pssm::{AdoptedMap, DrawShadowMap, PssmRenderSystems, ShadowTarget, prelude::*};

use crate::{
    compare::share_differing,
    stage::{Stage, shadows},
};

/// As though there were something between the sun and all there is.
fn draw_lid(view: ViewQuery<&AdoptedMap>, target: Res<ShadowTarget>, mut ctx: RenderContext) {
    let Some(layer) = target.layer(view.into_inner().layer) else {
        return;
    };
    ctx.begin_tracked_render_pass(RenderPassDescriptor {
        label: Some("lid"),
        depth_stencil_attachment: Some(RenderPassDepthStencilAttachment {
            view: layer,
            depth_ops: Some(Operations {
                load: LoadOp::Clear(1.0),
                store: StoreOp::Store,
            }),
            stencil_ops: None,
        }),
        ..default()
    });
}

#[test]
fn what_others_draw_into_maps_throws_shadows() {
    let picture = |has_lid: bool| {
        let mut stage = Stage::with_app(WgpuSettings::default(), |app| {
            if let (true, Some(render_app)) = (has_lid, app.get_sub_app_mut(RenderApp)) {
                let lid = draw_lid.after(PssmRenderSystems::DrawMaps);
                render_app.add_systems(DrawShadowMap, lid);
            }
        });
        let sun = stage.sun();
        // Of the meshes none casts.
        stage.clear_casters();
        stage.ground_that_casts_nothing();
        stage
            .world()
            .entity_mut(sun)
            .insert((shadows(), ShadowUpdates::Always));
        let picture = stage.picture();
        // Nor is anything lost later, as at rest.
        for _ in 0..10 {
            stage.step();
        }
        let later = stage.picture();
        assert_eq!(share_differing(&picture, &later, 0), 0.0);
        picture
    };
    let (plain, lidded) = (picture(false), picture(true));
    assert!(share_differing(&plain, &lidded, 12) > 0.3);
}
