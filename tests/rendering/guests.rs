//! Other crates' systems draw into the maps of managed lights.

use bevy::{
    core_pipeline::schedule::Core3d,
    pbr::{
        LATE_SHADOW_PASS, ShadowView, ViewLightEntities, per_view_shadow_pass, shared_shadow_pass,
    },
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
    warnings,
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
                render_app.add_systems(DrawShadowMap, draw_lid);
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

/// Both draw as though all maps were Bevy's.
fn draw_into_cascades(
    _view: ViewQuery<&ViewLightEntities>,
    maps: Query<&ShadowView>,
    mut found: ResMut<Found>,
) {
    found.0 += maps.iter().count();
}

fn draw_into_spot_lights(_map: ViewQuery<&ShadowView>) {}

#[derive(Resource, Default)]
struct Found(usize);

#[test]
fn what_finds_no_maps_is_warned_of_once() {
    let warned_of = |managed: bool, is_at_home: bool| {
        warnings::capture();
        let mut stage = Stage::with_app(WgpuSettings::default(), |app| {
            let render_app = app.sub_app_mut(RenderApp);
            render_app.init_resource::<Found>().add_systems(
                Core3d,
                (
                    draw_into_cascades.after(per_view_shadow_pass::<LATE_SHADOW_PASS>),
                    draw_into_spot_lights.after(shared_shadow_pass::<LATE_SHADOW_PASS>),
                ),
            );
            if is_at_home {
                let lid = draw_lid.after(PssmRenderSystems::DrawMaps);
                render_app.add_systems(DrawShadowMap, lid);
            }
        });
        stage.camera();
        let sun = stage.sun();
        if managed {
            stage.world().entity_mut(sun).insert(shadows());
        }
        for _ in 0..8 {
            stage.step();
        }
        let found = stage.render_world().resource::<Found>().0;
        assert_eq!(found == 0, managed, "{found} maps are found");
        let lines = warnings::take();
        let about_maps = lines.iter().filter(|line| line.contains("`ShadowView`s"));
        about_maps.count()
    };
    assert_eq!(warned_of(false, false), 0);
    assert_eq!(warned_of(true, false), 2);
    // It knows both ways.
    assert_eq!(warned_of(true, true), 0);
}
