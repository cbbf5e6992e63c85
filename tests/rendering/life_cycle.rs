//! The component added, changed, disabled and removed at run time; cameras and lights that come
//! and go.

use bevy::{
    core_pipeline::prepass::DepthPrepass,
    prelude::*,
    render::{
        RenderApp, RenderPlugin,
        batching::gpu_preprocessing::{GpuPreprocessingMode, GpuPreprocessingSupport},
        error_handler::{RenderErrorHandler, RenderErrorPolicy},
        occlusion_culling::OcclusionCulling,
        render_resource::{PollType, WgpuFeatures, WgpuLimits},
        renderer::RenderDevice,
        settings::{RenderCreation, WgpuSettings, WgpuSettingsPriority},
    },
};
use bevy_pssm::{ShadowPlans, prelude::*, render::ShadowTarget};
use image::RgbaImage;

use crate::{
    compare::{assert_identical, assert_same_shadows, share_differing},
    stage::{Stage, camera, shadows},
    warnings,
};

#[test]
fn removed_is_as_if_never_added() {
    let mut stage = Stage::new();
    let sun = stage.sun();
    let never = stage.picture();
    stage.world().entity_mut(sun).insert(shadows());
    let ours = stage.picture();
    assert!(
        share_differing(&ours, &never, 12) > 0.001,
        "the plugin made no difference"
    );
    stage
        .world()
        .entity_mut(sun)
        .remove::<ParallelSplitShadows>();
    assert_identical("removed", &stage.picture(), &never);

    stage.world().entity_mut(sun).insert(shadows());
    assert_identical("added_again", &stage.picture(), &ours);
}

#[test]
fn removed_while_nothing_renders_is_as_if_never_added() {
    let mut stage = Stage::new();
    let sun = stage.sun();
    let never = stage.picture();
    stage.world().entity_mut(sun).insert(shadows());
    stage.picture();
    let activate = |stage: &mut Stage, is_active| {
        let world = stage.world();
        for mut camera in world.query::<&mut Camera>().iter_mut(world) {
            camera.is_active = is_active;
        }
    };
    // The maps go first, and then the light is left to Bevy.
    activate(&mut stage, false);
    stage.step();
    stage
        .world()
        .entity_mut(sun)
        .remove::<ParallelSplitShadows>();
    stage.step();
    activate(&mut stage, true);
    assert_identical("removed_unseen", &stage.picture(), &never);
}

#[test]
fn every_change_takes_effect_in_its_frame() {
    let mut stage = Stage::new();
    let sun = stage.sun();
    let changes = [
        shadows(),
        ParallelSplitShadows {
            cascades: 1,
            ..shadows()
        },
        ParallelSplitShadows {
            cascades: 3,
            map_size: MapSize::PerCascade(vec![[1000; 2], [500; 2], [77; 2]]),
            ..shadows()
        },
        ParallelSplitShadows {
            map_size: MapSize::Halving(2048),
            far: 90.0,
            ..shadows()
        },
        ParallelSplitShadows {
            fit: CascadeFit::Tight,
            splits: SplitScheme::Uniform,
            ..shadows()
        },
        ParallelSplitShadows {
            splits: SplitScheme::Geometric {
                gamma: 4.0,
                bias: 150.0,
            },
            ..shadows()
        },
        ParallelSplitShadows {
            blend: 0.0,
            fade: 0.0,
            ..shadows()
        },
    ];
    // Reached by changes, and from the start: the same.
    let reached: Vec<_> = changes
        .iter()
        .map(|change| {
            stage.world().entity_mut(sun).insert(change.clone());
            stage.picture()
        })
        .collect();
    drop(stage);
    for (index, (change, reached)) in changes.iter().zip(reached).enumerate() {
        let mut stage = Stage::new();
        let sun = stage.sun();
        stage.world().entity_mut(sun).insert(change.clone());
        assert_identical(&format!("change_{index}"), &reached, &stage.picture());
    }
}

/// Whose pipelines are compiled beside the frames, as a game's are.
#[test]
fn no_frame_misses_anything_while_the_shader_changes() {
    let mut stage = Stage::with_renderer(RenderPlugin::default(), |_| {});
    let sun = stage.sun();
    stage.world().entity_mut(sun).insert(shadows());
    let before = stage.picture();
    let sky = |picture: &RgbaImage| {
        let corner = *picture.get_pixel(0, 0);
        picture.pixels().filter(|pixel| **pixel == corner).count()
    };
    let fits = [
        Some(CascadeFit::Tight),
        Some(CascadeFit::Warped(MapWarp::Minimax)),
        Some(CascadeFit::Faces),
        None,
    ];
    for (index, fit) in fits.into_iter().enumerate() {
        let mut light = stage.world().entity_mut(sun);
        match fit {
            Some(fit) => light.insert(ParallelSplitShadows { fit, ..shadows() }),
            None => light.remove::<ParallelSplitShadows>(),
        };
        let first = stage.headless.picture();
        let settled = stage.picture();
        assert_identical(&format!("shader_{index}"), &first, &settled);
        assert_eq!(sky(&settled), sky(&before), "fit {index}");
        assert!(share_differing(&settled, &before, 12) > 0.0, "fit {index}");
    }
}

#[test]
fn shadows_switched_off_and_on() {
    let mut stage = Stage::new();
    let sun = stage.sun();
    stage.world().entity_mut(sun).insert(shadows());
    let on = stage.picture();
    let set = |stage: &mut Stage, enabled| {
        if let Some(mut light) = stage.world().get_mut::<DirectionalLight>(sun) {
            light.shadow_maps_enabled = enabled;
        }
        stage.picture()
    };
    let off = set(&mut stage, false);
    assert!(share_differing(&off, &on, 12) > 0.01);
    assert_identical("switched_on", &set(&mut stage, true), &on);
    stage.world().entity_mut(sun).insert(Visibility::Hidden);
    stage.picture();
    stage.world().entity_mut(sun).insert(Visibility::Visible);
    assert_identical("shown_again", &stage.picture(), &on);
}

#[test]
fn a_camera_that_rests_disturbs_no_other() {
    let mut stage = Stage::new();
    let sun = stage.sun();
    stage.world().entity_mut(sun).insert(shadows());
    let first = stage.camera();
    let alone = stage.picture();
    // The other sees nothing that the first one does.
    let target = stage.target();
    let away = Transform::from_xyz(200.0, 3.0, 90.0).looking_to(Vec3::X, Vec3::Y);
    let second = stage.world().spawn(camera(target)).insert(away).id();
    let set_active = |stage: &mut Stage, camera, active| {
        if let Some(mut camera) = stage.world().get_mut::<Camera>(camera) {
            camera.is_active = active;
        }
    };
    set_active(&mut stage, first, false);
    stage.picture();
    for _ in 0..2 {
        set_active(&mut stage, first, true);
        set_active(&mut stage, second, false);
        assert_identical("other_rests", &stage.picture(), &alone);
        set_active(&mut stage, first, false);
        set_active(&mut stage, second, true);
        stage.picture();
    }
}

#[derive(Resource)]
struct Late(bevy::camera::RenderTarget);

#[test]
fn late_cameras_do_not_panic() {
    let mut stage = Stage::with_app(WgpuSettings::default(), |app| {
        app.add_systems(
            Last,
            |mut commands: Commands, late: Option<Res<Late>>, mut cameras: Query<&mut Camera>| {
                for mut camera in &mut cameras {
                    camera.is_active = true;
                }
                if let Some(late) = late {
                    commands.spawn(camera(late.0.clone()));
                    commands.remove_resource::<Late>();
                }
            },
        );
    });
    let sun = stage.sun();
    stage.world().entity_mut(sun).insert(shadows());
    // Another, with Bevy's own shadows.
    stage.sun();
    let view = stage.camera();
    if let Some(mut camera) = stage.world().get_mut::<Camera>(view) {
        camera.is_active = false;
    }
    for _ in 0..4 {
        stage.step();
    }
    let target = stage.target();
    stage.world().insert_resource(Late(target));
    for _ in 0..4 {
        stage.step();
    }
    // A light whose shadows are switched on after the cascades were made.
    stage.world().entity_mut(sun).despawn();
    stage.world().entity_mut(view).despawn();
    for _ in 0..4 {
        stage.step();
    }
}

#[test]
fn occlusion_culling_loses_no_casters() {
    let mut stage = Stage::new();
    let camera = stage.camera();
    stage
        .world()
        .entity_mut(camera)
        .insert((DepthPrepass, OcclusionCulling));
    let sun = stage.sun();
    stage.world().entity_mut(sun).insert(shadows());
    let without = stage.picture();
    stage.world().entity_mut(sun).insert(OcclusionCulling);
    assert_identical("occlusion_culling", &stage.picture(), &without);
    // Bevy's light with occlusion culling becomes ours.
    stage
        .world()
        .entity_mut(sun)
        .remove::<ParallelSplitShadows>();
    stage.picture();
    stage.world().entity_mut(sun).insert(shadows());
    assert_identical("occlusion_culling_taken_over", &stage.picture(), &without);
}

/// Bevy's shadows, the plugin's and none.
fn pictures() -> [RgbaImage; 3] {
    let mut stage = Stage::new();
    let sun = stage.sun();
    let built_in = stage.picture();
    stage.world().entity_mut(sun).insert(shadows());
    let with = stage.picture();
    if let Some(mut light) = stage.world().get_mut::<DirectionalLight>(sun) {
        light.shadow_maps_enabled = false;
    }
    [built_in, with, stage.picture()]
}

/// Where the GPU has no compute shaders, as in browsers, Bevy's CPU lays out what is drawn.
#[test]
fn without_preprocessing_on_the_gpu() {
    let [built_in, with, unshadowed] = pictures();
    let gpu = WgpuSettings {
        priority: WgpuSettingsPriority::WebGL2,
        limits: WgpuLimits::downlevel_webgl2_defaults(),
        ..default()
    };
    let mut stage = Stage::with_app(gpu, |_| {});
    let support = stage.render_world().resource::<GpuPreprocessingSupport>();
    assert!(support.max_supported_mode == GpuPreprocessingMode::None);
    let sun = stage.sun();
    assert_same_shadows(
        "no_preprocessing_built_in",
        &stage.picture(),
        &built_in,
        &unshadowed,
    );
    stage.world().entity_mut(sun).insert(shadows());
    assert_same_shadows("no_preprocessing", &stage.picture(), &with, &unshadowed);
}

#[test]
fn without_depth_clip_control() {
    let gpu = || WgpuSettings {
        disabled_features: Some(WgpuFeatures::DEPTH_CLIP_CONTROL),
        ..default()
    };
    let [_, with, unshadowed] = pictures();
    let mut stage = Stage::with_app(gpu(), |_| {});
    let sun = stage.sun();
    stage.world().entity_mut(sun).insert(shadows());
    assert_same_shadows(
        "no_depth_clip_control",
        &stage.picture(),
        &with,
        &unshadowed,
    );
    // Warps, which Bevy's stand-in for it cannot draw, give way to tight maps.
    for fit in [
        CascadeFit::Warped(MapWarp::Strength(1.0)),
        CascadeFit::Faces,
    ] {
        let mut entity = stage.world().entity_mut(sun);
        entity.insert(ParallelSplitShadows { fit, ..shadows() });
        let picture = stage.picture();
        let plans = stage.world().get::<ShadowPlans>(sun).unwrap();
        let maps = plans
            .views
            .values()
            .flatten()
            .filter_map(|plan| plan.map.as_ref());
        assert!(maps.clone().count() > 0);
        assert!(maps.clone().all(|map| map.fit == MapFit::Tight));
        assert_same_shadows("no_depth_clip_control_warped", &picture, &with, &unshadowed);
    }
}

#[test]
fn nothing_is_logged_that_bevy_would_not() {
    let lines = |ours: bool| {
        let mut stage = Stage::new();
        warnings::take();
        let sun = stage.sun();
        if ours {
            stage.world().entity_mut(sun).insert(shadows());
        }
        stage.picture();
        if ours {
            stage
                .world()
                .entity_mut(sun)
                .remove::<ParallelSplitShadows>();
            stage.picture();
        }
        warnings::take()
    };
    assert_eq!(lines(true), lines(false));
}

#[test]
fn a_bad_value_is_reported_once_and_changes_nothing() {
    let mut stage = Stage::new();
    let sun = stage.sun();
    stage.world().entity_mut(sun).insert(shadows());
    let good = stage.picture();
    warnings::take();
    stage.world().entity_mut(sun).insert(ParallelSplitShadows {
        far: -3.0,
        ..shadows()
    });
    assert_identical("bad_value", &stage.picture(), &good);
    let reported: Vec<String> = warnings::take()
        .into_iter()
        .filter(|line| line.contains("`far` is -3"))
        .collect();
    assert_eq!(reported.len(), 1, "{reported:?}");
}

#[test]
fn a_light_is_told_what_it_keeps() {
    let mut stage = Stage::new();
    let first = stage.sun();
    let second = stage.world().spawn(DirectionalLight::default()).id();
    stage.picture();
    warnings::take();
    let bad = ParallelSplitShadows {
        near: -1.0,
        ..shadows()
    };
    for light in [first, second] {
        stage.world().entity_mut(light).insert(bad.clone());
        stage.picture();
        stage.world().entity_mut(light).insert(shadows());
        stage.picture();
        stage.world().entity_mut(light).insert(bad.clone());
        stage.picture();
    }
    let warnings = warnings::take();
    for light in [first, second] {
        let about = |text: &str| {
            let of_light = format!("ight {light}");
            let lines = warnings.iter();
            lines
                .filter(|line| line.contains(&of_light) && line.contains(text))
                .count()
        };
        assert_eq!(about("keeps Bevy's own shadows"), 1, "{warnings:#?}");
        assert_eq!(about("Keeping the last good shadows"), 1, "{warnings:#?}");
    }
}

#[test]
fn layers_that_no_map_needs_are_given_back() {
    let mut stage = Stage::new();
    let sun = stage.sun();
    stage.world().entity_mut(sun).insert(shadows());
    stage.picture();
    let layers = |stage: &mut Stage| {
        let world = stage.headless.app.sub_app(RenderApp).world();
        let target = world.resource::<ShadowTarget>();
        (0..16)
            .filter(|layer| target.layer(*layer).is_some())
            .count()
    };
    let four = layers(&mut stage);
    let two = ParallelSplitShadows {
        cascades: 2,
        ..shadows()
    };
    stage.world().entity_mut(sun).insert(two);
    for _ in 0..70 {
        stage.headless.step();
    }
    assert_eq!(layers(&mut stage), four - 2);
}

#[test]
fn a_lost_device_is_recovered_from() {
    let mut stage = Stage::new();
    let sun = stage.sun();
    stage.world().entity_mut(sun).insert(shadows());
    stage.camera();
    stage.headless.settle();
    let before = stage.last_picture();
    stage.world().insert_resource(RenderErrorHandler(|_, _, _| {
        RenderErrorPolicy::Recover(RenderCreation::Automatic(Box::default()))
    }));
    let device = stage.world().resource::<RenderDevice>().clone();
    device.wgpu_device().destroy();
    // So that the renderer hears of it before it goes on.
    let _ = device.wgpu_device().poll(PollType::wait_indefinitely());
    for _ in 0..20 {
        stage.step();
    }
    stage.headless.settle();
    let after = stage.last_picture();
    assert_identical("lost_device", &after, &before);
}
