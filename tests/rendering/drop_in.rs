//! Everything Bevy draws receives the plugin's shadows, and what is not ours stays Bevy's.
//!
//! The expected pictures are Bevy's own at four times the texels per map.

use bevy::{
    asset::uuid_handle,
    camera::{ScalingMode, Viewport},
    core_pipeline::prepass::{DeferredPrepass, DepthPrepass, MotionVectorPrepass, NormalPrepass},
    light::{
        DirectionalLightShadowMap, FogVolume, NotShadowCaster, NotShadowReceiver,
        ShadowFilteringMethod, TransmittedShadowReceiver, VolumetricFog, VolumetricLight,
    },
    pbr::{DefaultOpaqueRendererMethod, ExtendedMaterial, MaterialExtension, MaterialPlugin},
    prelude::*,
    reflect::TypePath,
    render::render_resource::AsBindGroup,
    shader::ShaderRef,
};
use bevy_pssm::{ShadowTarget, prelude::*};
use image::RgbaImage;

use crate::{
    compare::{assert_identical, assert_same_shadows, save, share_differing},
    stage::{SIZE, Stage, camera, eye, shadows},
};

/// The scene without shadows, with Bevy's at high resolution, and with ours.
struct Pictures {
    unshadowed: RgbaImage,
    stock: RgbaImage,
    ours: RgbaImage,
}

fn take(stage: &mut Stage, sun: Entity) -> Pictures {
    let set_maps = |stage: &mut Stage, enabled: bool| {
        if let Some(mut light) = stage.world().get_mut::<DirectionalLight>(sun) {
            light.shadow_maps_enabled = enabled;
        }
    };
    set_maps(stage, false);
    let unshadowed = stage.picture();
    set_maps(stage, true);
    stage
        .world()
        .insert_resource(DirectionalLightShadowMap { size: 4096 });
    let stock = stage.picture();
    stage
        .world()
        .insert_resource(DirectionalLightShadowMap { size: 1024 });
    stage.world().entity_mut(sun).insert(ParallelSplitShadows {
        map_size: MapSize::Same(2048),
        ..shadows()
    });
    let ours = stage.picture();
    Pictures {
        unshadowed,
        stock,
        ours,
    }
}

/// Asserts that the sun's shadows are, with the plugin, what they are without.
pub fn assert_right(name: &str, stage: &mut Stage, sun: Entity) {
    let pictures = take(stage, sun);
    assert_same_shadows(name, &pictures.ours, &pictures.stock, &pictures.unshadowed);
}

#[test]
fn forward_camera() {
    let mut stage = Stage::new();
    let sun = stage.sun();
    assert_right("forward", &mut stage, sun);
}

#[test]
fn multisampled_camera() {
    let mut stage = Stage::new();
    let camera = stage.camera();
    stage.world().entity_mut(camera).insert(Msaa::Sample4);
    let sun = stage.sun();
    assert_right("multisampled", &mut stage, sun);
}

#[test]
fn deferred_camera() {
    let mut stage = Stage::new();
    stage
        .world()
        .insert_resource(DefaultOpaqueRendererMethod::deferred());
    let camera = stage.camera();
    stage
        .world()
        .entity_mut(camera)
        .insert((DepthPrepass, DeferredPrepass));
    let sun = stage.sun();
    assert_right("deferred", &mut stage, sun);
}

#[test]
fn camera_with_prepasses() {
    let mut stage = Stage::new();
    let camera = stage.camera();
    stage
        .world()
        .entity_mut(camera)
        .insert((DepthPrepass, NormalPrepass, MotionVectorPrepass));
    let sun = stage.sun();
    assert_right("prepasses", &mut stage, sun);
}

#[test]
fn orthographic_camera() {
    let mut stage = Stage::new();
    let camera = stage.camera();
    stage
        .world()
        .entity_mut(camera)
        .insert(Projection::Orthographic(OrthographicProjection {
            scaling_mode: ScalingMode::FixedVertical {
                viewport_height: 20.0,
            },
            ..OrthographicProjection::default_3d()
        }));
    let sun = stage.sun();
    assert_right("orthographic", &mut stage, sun);
}

/// From the midst of what is seen, as from behind all of it: Bevy's own shadows begin at the eye.
#[test]
fn orthographic_camera_that_sees_behind_its_eye() {
    let mut stage = Stage::new();
    let camera = stage.camera();
    let stand = |stage: &mut Stage, ahead: f32, near: f32| {
        let mut place = eye();
        place.translation += place.forward() * ahead;
        let lens = OrthographicProjection {
            scaling_mode: ScalingMode::FixedVertical {
                viewport_height: 20.0,
            },
            near,
            ..OrthographicProjection::default_3d()
        };
        stage
            .world()
            .entity_mut(camera)
            .insert((place, Projection::Orthographic(lens)));
    };
    let sun = stage.sun();
    stand(&mut stage, -60.0, 0.0);
    let pictures = take(&mut stage, sun);
    stand(&mut stage, 40.0, -1000.0);
    let ours = stage.picture();
    assert_same_shadows(
        "orthographic_midst",
        &ours,
        &pictures.stock,
        &pictures.unshadowed,
    );
}

#[test]
fn gltf_scene() {
    let mut stage = Stage::new();
    let scene = stage
        .world()
        .resource::<AssetServer>()
        .load(GltfAssetLabel::Scene(0).from_asset("models/pillars.gltf"));
    stage.clear_casters();
    stage.world().spawn(WorldAssetRoot(scene));
    stage.wait_for(|world| {
        let mut pillars = world.query_filtered::<&Name, With<Mesh3d>>();
        pillars.iter(world).count() >= 8
    });
    let sun = stage.sun();
    assert_right("gltf", &mut stage, sun);
}

#[derive(Asset, AsBindGroup, TypePath, Debug, Clone, Default)]
struct Plain {}

impl MaterialExtension for Plain {}

#[test]
fn extended_material() {
    type Extended = ExtendedMaterial<StandardMaterial, Plain>;
    let mut stage = Stage::with_app(default(), |app| {
        app.add_plugins(MaterialPlugin::<Extended>::default());
    });
    let material = stage
        .world()
        .resource_mut::<Assets<Extended>>()
        .add(Extended {
            base: StandardMaterial {
                perceptual_roughness: 1.0,
                ..default()
            },
            extension: Plain {},
        });
    let mut meshes = stage.world().query_filtered::<Entity, With<Mesh3d>>();
    let meshes: Vec<Entity> = meshes.iter(stage.world()).collect();
    for mesh in meshes {
        stage
            .world()
            .entity_mut(mesh)
            .remove::<MeshMaterial3d<StandardMaterial>>()
            .insert(MeshMaterial3d(material.clone()));
    }
    let sun = stage.sun();
    assert_right("extended_material", &mut stage, sun);
}

/// Leaves every other pixel without a place, as registers of one that has been discarded may.
#[derive(Asset, AsBindGroup, TypePath, Debug, Clone, Default)]
struct Riddled {}

const RIDDLED: Handle<Shader> = uuid_handle!("0e5f3c52-6a0c-4c52-9d0f-7c5a6a4b7d20");

impl MaterialExtension for Riddled {
    fn fragment_shader() -> ShaderRef {
        RIDDLED.into()
    }
}

#[test]
fn pixels_next_to_discarded_ones() {
    type Material = ExtendedMaterial<StandardMaterial, Riddled>;
    let shader = "import bevy_pbr::render::{
            forward_io::{FragmentOutput, VertexOutput},
            pbr_fragment::pbr_input_from_standard_material,
            pbr_functions::{apply_pbr_lighting, main_pass_post_lighting_processing},
        };
        @fragment
        fn fragment(in: VertexOutput, @builtin(front_facing) is_front: bool) -> FragmentOutput {
            var input = pbr_input_from_standard_material(in, is_front);
            input.material.base_color.a = 1.0;
            if (u32(in.position.x) % 2u == 1u) {
                input.world_position = vec4(3.0, 40.0, -7.0, 1.0);
            }
            var out: FragmentOutput;
            out.color = main_pass_post_lighting_processing(input, apply_pbr_lighting(input));
            return out;
        }";
    let mut stage = Stage::with_app(default(), |app| {
        app.add_plugins(MaterialPlugin::<Material>::default());
    });
    let sun = stage.sun();
    stage.world().entity_mut(sun).insert(shadows());
    let world = stage.world();
    let inserted = world
        .resource_mut::<Assets<Shader>>()
        .insert(&RIDDLED, Shader::from_wesl(shader, "riddled.wesl"));
    assert!(inserted.is_ok());
    let base = StandardMaterial {
        perceptual_roughness: 1.0,
        alpha_mode: AlphaMode::Mask(0.5),
        ..default()
    };
    let whole = world
        .resource_mut::<Assets<StandardMaterial>>()
        .add(base.clone());
    let riddled = world.resource_mut::<Assets<Material>>().add(Material {
        base,
        extension: Riddled {},
    });
    let mut meshes = world.query_filtered::<Entity, With<Mesh3d>>();
    let meshes: Vec<Entity> = meshes.iter(world).collect();
    for mesh in &meshes {
        world
            .entity_mut(*mesh)
            .insert(MeshMaterial3d(whole.clone()));
    }
    let expected = stage.picture();
    for mesh in meshes {
        stage
            .world()
            .entity_mut(mesh)
            .remove::<MeshMaterial3d<StandardMaterial>>()
            .insert(MeshMaterial3d(riddled.clone()));
    }
    let found = stage.picture();
    save("pixels_next_to_discarded_ones", &found, &expected);
    let every_other =
        |from: &RgbaImage| RgbaImage::from_fn(SIZE.x / 2, SIZE.y, |x, y| *from.get_pixel(2 * x, y));
    let differing = share_differing(&every_other(&found), &every_other(&expected), 12);
    assert!(differing < 0.001, "{differing} of the pixels differ");
}

/// Lifts a mesh out of its bounds.
#[derive(Asset, AsBindGroup, TypePath, Debug, Clone, Default)]
struct Lifted {}

const LIFT: f32 = 6.0;
const LIFTED: Handle<Shader> = uuid_handle!("5c1b8b8e-3c8f-4f43-9d0a-2d6f9a2f7c11");
const LIFTED_IN_MAPS: Handle<Shader> = uuid_handle!("8f0d2a4b-61c3-4b7e-a5d2-94c7e3b1f026");

impl MaterialExtension for Lifted {
    fn vertex_shader() -> ShaderRef {
        LIFTED.into()
    }

    fn prepass_vertex_shader() -> ShaderRef {
        LIFTED_IN_MAPS.into()
    }
}

/// The vertex shader of the pass whose inputs and outputs are in a module.
fn lifting(io: &str) -> String {
    format!(
        "import bevy_pbr::{{
            {io}::{{Vertex, VertexOutput, decompress_vertex}},
            render::{{mesh_functions, view_transformations::position_world_to_clip}},
        }};
        @vertex
        fn vertex(compressed: Vertex) -> VertexOutput {{
            let index = compressed.instance_index;
            let vertex = decompress_vertex(compressed, index);
            let world_from_local = mesh_functions::get_world_from_local(index);
            let local = vec4(vertex.position + vec3(0.0, {LIFT:.1}, 0.0), 1.0);
            var out: VertexOutput;
            out.world_position = mesh_functions::mesh_position_local_to_world(world_from_local, local);
            out.position = position_world_to_clip(out.world_position.xyz);
            @if(UNCLIPPED_DEPTH_ORTHO_EMULATION) {{
            out.unclipped_depth = out.position.z;
            out.position.z = min(out.position.z, 1.0);
            }}
            @if(VERTEX_NORMALS) out.world_normal =
                mesh_functions::mesh_normal_local_to_world(vertex.normal, index);
            @if(VERTEX_UVS_A) out.uv = vertex.uv;
            @if(VERTEX_OUTPUT_INSTANCE_INDEX) out.instance_index = index;
            return out;
        }}"
    )
}

#[test]
fn what_a_vertex_shader_lifts() {
    type Material = ExtendedMaterial<StandardMaterial, Lifted>;
    for (fit, margin) in [
        (CascadeFit::Steady, None),
        (CascadeFit::Steady, Some(BoundsMargin(LIFT))),
        (CascadeFit::Tight, None),
        (
            CascadeFit::Warped(MapWarp::Minimax),
            Some(BoundsMargin(LIFT)),
        ),
    ] {
        let mut stage = Stage::with_app(default(), |app| {
            app.add_plugins(MaterialPlugin::<Material>::default());
        });
        stage.clear_casters();
        stage.clear_ground();
        let world = stage.world();
        for (handle, io, path) in [
            (LIFTED, "render::forward_io", "lifted.wesl"),
            (LIFTED_IN_MAPS, "prepass::io", "lifted_in_maps.wesl"),
        ] {
            let inserted = world
                .resource_mut::<Assets<Shader>>()
                .insert(&handle, Shader::from_wesl(lifting(io), path));
            assert!(inserted.is_ok());
        }
        let base = StandardMaterial {
            perceptual_roughness: 1.0,
            ..default()
        };
        let plain = world
            .resource_mut::<Assets<StandardMaterial>>()
            .add(base.clone());
        let lifted = world.resource_mut::<Assets<Material>>().add(Material {
            base,
            extension: Lifted {},
        });
        let mut meshes = world.resource_mut::<Assets<Mesh>>();
        let ground = meshes.add(Plane3d::default().mesh().size(600.0, 600.0));
        let block = meshes.add(Cuboid::from_length(3.0));
        let ground = (
            Mesh3d(ground),
            MeshMaterial3d(lifted.clone()),
            Transform::from_xyz(0.0, -LIFT, 0.0),
            NotShadowCaster,
        );
        let mut ground = world.spawn(ground);
        if let Some(margin) = margin {
            ground.insert(margin);
        }
        // Above and behind the camera, which sees nothing but the ground.
        let places = (0..24).map(|i| {
            Vec3::new(
                -30.0 + 6.0 * (i % 8) as f32,
                25.0,
                4.0 + 7.0 * (i / 8) as f32,
            )
        });
        let blocks: Vec<(Entity, Vec3)> = places
            .map(|place| {
                let block = (
                    Mesh3d(block.clone()),
                    MeshMaterial3d(plain.clone()),
                    Transform::from_translation(place),
                );
                (world.spawn(block).id(), place)
            })
            .collect();
        let sun = stage.sun();
        let pictures = take(&mut stage, sun);
        let fitted = ParallelSplitShadows {
            fit: fit.clone(),
            map_size: MapSize::Same(2048),
            ..shadows()
        };
        stage.world().entity_mut(sun).insert(fitted);
        // Blocks that are lifted to where they were throw the same shadows.
        for (block, place) in blocks {
            stage
                .world()
                .entity_mut(block)
                .remove::<MeshMaterial3d<StandardMaterial>>()
                .insert((
                    MeshMaterial3d(lifted.clone()),
                    Transform::from_translation(place - LIFT * Vec3::Y),
                    BoundsMargin(LIFT),
                ));
        }
        let ours = stage.picture();
        let name = format!("lifted_ground_{fit:?}_{}", margin.is_some());
        assert_same_shadows(&name, &ours, &pictures.stock, &pictures.unshadowed);
    }
}

/// Two cameras, each with one half of the picture.
fn halves(stage: &mut Stage, places: [Transform; 2]) -> [Entity; 2] {
    [0_u32, 1].map(|index| {
        let physical_size = UVec2::new(SIZE.x / 2, SIZE.y);
        let half = Camera {
            order: index as isize,
            viewport: Some(Viewport {
                physical_position: UVec2::new(index * physical_size.x, 0),
                physical_size,
                ..default()
            }),
            clear_color: if index == 0 {
                default()
            } else {
                ClearColorConfig::None
            },
            ..default()
        };
        let bundle = camera(stage.target());
        let view = stage.world().spawn(bundle).id();
        let place = places[index as usize];
        stage.world().entity_mut(view).insert((half, place));
        view
    })
}

#[test]
fn split_screen() {
    let mut stage = Stage::new();
    let places = [0.0, 1.0].map(|index| {
        let at = Transform::from_xyz(6.0 - 9.0 * index, 3.0, 12.0 - 20.0 * index);
        at.looking_at(Vec3::new(-2.0, 0.5, -12.0 - 30.0 * index), Vec3::Y)
    });
    halves(&mut stage, places);
    let sun = stage.sun();
    assert_right("split_screen", &mut stage, sun);
}

#[test]
fn eyes_that_share_maps() {
    let mut stage = Stage::new();
    let aside = eye().with_translation(eye().translation + 0.064 * eye().right());
    let eyes = halves(&mut stage, [eye(), aside]);
    let sun = stage.sun();
    let pictures = take(&mut stage, sun);
    let layers = |stage: &mut Stage| {
        for _ in 0..70 {
            stage.step();
        }
        let target = stage.render_world().resource::<ShadowTarget>();
        let present = (0..16).take_while(|layer| target.layer(*layer).is_some());
        present.count()
    };
    assert_eq!(layers(&mut stage), 8);
    let share = SharesShadowsWith(eyes[0]);
    stage.world().entity_mut(eyes[1]).insert(share);
    assert_eq!(layers(&mut stage), 4);
    let shared = stage.picture();
    let Pictures {
        stock, unshadowed, ..
    } = &pictures;
    assert_same_shadows("eyes_that_share_maps", &shared, stock, unshadowed);
    stage
        .world()
        .entity_mut(eyes[1])
        .remove::<SharesShadowsWith>();
    assert_eq!(layers(&mut stage), 8);
    assert_identical("eyes_apart_again", &stage.picture(), &pictures.ours);
}

#[test]
fn filters_and_odd_maps() {
    for (name, filter) in [
        ("hardware", ShadowFilteringMethod::Hardware2x2),
        ("gaussian", ShadowFilteringMethod::Gaussian),
        ("temporal", ShadowFilteringMethod::Temporal),
    ] {
        let mut stage = Stage::new();
        let camera = stage.camera();
        stage.world().entity_mut(camera).insert(filter);
        let sun = stage.sun();
        let pictures = take(&mut stage, sun);
        assert_same_shadows(name, &pictures.ours, &pictures.stock, &pictures.unshadowed);
    }
}

#[test]
fn soft_shadows() {
    let mut stage = Stage::new();
    let sun = stage.sun();
    if let Some(mut light) = stage.world().get_mut::<DirectionalLight>(sun) {
        light.soft_shadow_size = Some(0.2);
    }
    let pictures = take(&mut stage, sun);
    save("soft", &pictures.ours, &pictures.stock);
    let shadowed = share_differing(&pictures.ours, &pictures.unshadowed, 12);
    let expected = share_differing(&pictures.stock, &pictures.unshadowed, 12);
    assert!(
        (0.5..2.0).contains(&(shadowed / expected)),
        "{shadowed} against {expected}"
    );
}

#[test]
fn transmission() {
    let mut stage = Stage::new();
    let sun = stage.sun();
    let leaf = StandardMaterial {
        base_color: Color::srgb(0.3, 0.8, 0.3),
        diffuse_transmission: 0.8,
        double_sided: true,
        cull_mode: None,
        thickness: 0.05,
        ..default()
    };
    let leaf = stage
        .world()
        .resource_mut::<Assets<StandardMaterial>>()
        .add(leaf);
    let screen = stage
        .world()
        .resource_mut::<Assets<Mesh>>()
        .add(Rectangle::new(7.0, 5.0));
    stage.world().spawn((
        Mesh3d(screen),
        MeshMaterial3d(leaf),
        Transform::from_xyz(1.5, 2.5, -2.0).looking_to(Vec3::new(1.0, 0.0, -0.8), Vec3::Y),
        TransmittedShadowReceiver,
        NotShadowCaster,
    ));
    assert_right("transmission", &mut stage, sun);
}

#[test]
fn meshes_that_do_not_receive() {
    let mut stage = Stage::new();
    let sun = stage.sun();
    let mut meshes = stage.world().query_filtered::<Entity, With<Mesh3d>>();
    let meshes: Vec<Entity> = meshes.iter(stage.world()).collect();
    for mesh in meshes {
        stage.world().entity_mut(mesh).insert(NotShadowReceiver);
    }
    let pictures = take(&mut stage, sun);
    assert_identical("not_receivers", &pictures.ours, &pictures.unshadowed);
}

/// A light that is not ours, in pictures where ours gives no light: Bevy's picture to the bit,
/// but for rounding where its map fills only a part of a larger layer.
fn assert_stays_bevys(name: &str, map_size: u32, levels: u8, spawn_other: impl FnOnce(&mut World)) {
    let mut stage = Stage::new();
    let sun = stage.sun();
    if let Some(mut light) = stage.world().get_mut::<DirectionalLight>(sun) {
        // Of one that gives none at all there would be no maps.
        light.illuminance = 1e-6;
    }
    spawn_other(stage.world());
    let stock = stage.picture();
    stage.world().entity_mut(sun).insert(ParallelSplitShadows {
        map_size: MapSize::Same(map_size),
        ..shadows()
    });
    let ours = stage.picture();
    save(name, &ours, &stock);
    let differing = share_differing(&ours, &stock, levels);
    assert!(
        differing == 0.0,
        "{name}: {differing:.6} of the picture differ"
    );
}

fn second_sun(world: &mut World) {
    world.spawn((
        DirectionalLight {
            illuminance: 2000.0,
            shadow_maps_enabled: true,
            ..default()
        },
        Transform::from_xyz(3.0, 4.0, 5.0).looking_at(Vec3::ZERO, Vec3::Y),
        crate::stage::stock_cascades(),
    ));
}

fn spot_light(world: &mut World) {
    world.spawn((
        SpotLight {
            intensity: 4_000_000.0,
            range: 60.0,
            outer_angle: 0.9,
            shadow_maps_enabled: true,
            ..default()
        },
        Transform::from_xyz(-8.0, 9.0, 4.0).looking_at(Vec3::new(0.0, 0.0, -6.0), Vec3::Y),
    ));
    world.spawn((
        PointLight {
            intensity: 400_000.0,
            range: 30.0,
            shadow_maps_enabled: true,
            ..default()
        },
        Transform::from_xyz(3.0, 5.0, -1.0),
    ));
}

#[test]
fn a_second_sun_stays_bevys() {
    assert_stays_bevys("second_sun", 1024, 0, second_sun);
    assert_stays_bevys("second_sun_small_ours", 300, 0, second_sun);
    assert_stays_bevys("second_sun_large_ours", 2048, 2, second_sun);
}

#[test]
fn two_suns_of_ours() {
    let mut stage = Stage::new();
    let first = stage.sun();
    second_sun(stage.world());
    // Ours as well, all the time: the other one is compared.
    let mut suns = stage
        .world()
        .query_filtered::<Entity, With<DirectionalLight>>();
    let suns: Vec<Entity> = suns.iter(stage.world()).collect();
    for sun in suns.into_iter().filter(|sun| *sun != first) {
        stage.world().entity_mut(sun).insert(ParallelSplitShadows {
            cascades: 3,
            map_size: MapSize::PerCascade(vec![[1500; 2], [1024; 2], [700; 2]]),
            ..shadows()
        });
    }
    assert_right("two_suns", &mut stage, first);
}

#[test]
fn spot_and_point_lights_stay_bevys() {
    assert_stays_bevys("spot", 1024, 0, spot_light);
    assert_stays_bevys("spot_large_ours", 1500, 2, spot_light);
}

/// Shows a map instead of the scene, for no shader of Bevy's calls this lookup for a spot light.
#[derive(Asset, AsBindGroup, TypePath, Debug, Clone, Default)]
struct Mapped {}

const MAPPED: Handle<Shader> = uuid_handle!("b0a6f6f0-54c7-4a3f-8f3b-3c1d7be2a9e4");

impl MaterialExtension for Mapped {
    fn fragment_shader() -> ShaderRef {
        MAPPED.into()
    }
}

#[test]
fn lookups_of_a_materials_own_shader_stay_bevys() {
    type Material = ExtendedMaterial<StandardMaterial, Mapped>;
    let shader = "import bevy_pbr::render::{
            forward_io::{FragmentOutput, VertexOutput},
            mesh_view_bindings::{lights, view},
            shadow_sampling::sample_shadow_map_hardware,
        };
        @fragment
        fn fragment(in: VertexOutput) -> FragmentOutput {
            let uv = in.position.xy / view.viewport.zw;
            // The point light comes first.
            let layer = lights.spot_light_shadowmap_offset + 1;
            let is_far = sample_shadow_map_hardware(uv, 0.1 / 14.0, layer);
            var out: FragmentOutput;
            out.color = vec4(vec3(is_far), 1.0);
            return out;
        }";
    let mut stage = Stage::with_app(default(), |app| {
        app.add_plugins(MaterialPlugin::<Material>::default());
    });
    let sun = stage.sun();
    let world = stage.world();
    spot_light(world);
    let inserted = world
        .resource_mut::<Assets<Shader>>()
        .insert(&MAPPED, Shader::from_wesl(shader, "mapped.wesl"));
    assert!(inserted.is_ok());
    let mapped = world
        .resource_mut::<Assets<Material>>()
        .add(Material::default());
    let mut meshes = world.query_filtered::<Entity, With<Mesh3d>>();
    let meshes: Vec<Entity> = meshes.iter(world).collect();
    for mesh in meshes {
        world
            .entity_mut(mesh)
            .remove::<MeshMaterial3d<StandardMaterial>>()
            .insert(MeshMaterial3d(mapped.clone()));
    }
    let stock = stage.picture();
    // Layers are twice as wide as the spot light's map.
    stage.world().entity_mut(sun).insert(ParallelSplitShadows {
        map_size: MapSize::Same(2048),
        ..shadows()
    });
    let ours = stage.picture();
    save("mapped", &ours, &stock);
    let black = RgbaImage::new(SIZE.x, SIZE.y);
    let bright = share_differing(&stock, &black, 240);
    assert!((0.1..0.9).contains(&bright), "{bright} of it are far");
    let differing = share_differing(&ours, &stock, 40);
    assert!(differing < 0.001, "{differing} of the picture differ");
}

/// A spot light in fog.
fn foggy_spot_light(world: &mut World) {
    world.add_observer(|camera: On<Add<Camera3d>>, mut commands: Commands| {
        commands.entity(camera.entity).insert(VolumetricFog {
            ambient_intensity: 0.0,
            ..default()
        });
    });
    world.spawn((
        SpotLight {
            intensity: 40_000_000.0,
            range: 60.0,
            outer_angle: 0.9,
            shadow_maps_enabled: true,
            ..default()
        },
        VolumetricLight,
        Transform::from_xyz(-8.0, 9.0, 4.0).looking_at(Vec3::new(0.0, 0.0, -6.0), Vec3::Y),
    ));
    world.spawn((
        FogVolume {
            density_factor: 0.05,
            ..default()
        },
        Transform::from_scale(Vec3::new(60.0, 20.0, 120.0)),
    ));
}

#[test]
fn fog_around_spot_lights_stays_bevys() {
    assert_stays_bevys("foggy_spot", 1024, 0, foggy_spot_light);
    assert_stays_bevys("foggy_spot_large_ours", 2048, 2, foggy_spot_light);
}

#[test]
fn volumetric_fog() {
    let mut stage = Stage::new();
    let camera = stage.camera();
    stage.world().entity_mut(camera).insert(VolumetricFog {
        ambient_intensity: 0.0,
        ..default()
    });
    let sun = stage.sun();
    stage.world().entity_mut(sun).insert(VolumetricLight);
    stage.world().spawn((
        FogVolume {
            density_factor: 0.02,
            ..default()
        },
        Transform::from_scale(Vec3::new(60.0, 20.0, 120.0)),
    ));
    assert_right("fog", &mut stage, sun);
}

#[test]
fn fog_outside_the_maps_is_lit() {
    let mut stage = Stage::new();
    stage.clear_casters();
    let camera = stage.camera();
    stage.world().entity_mut(camera).insert(VolumetricFog {
        ambient_intensity: 0.0,
        ..default()
    });
    let sun = stage.sun();
    stage.world().entity_mut(sun).insert(VolumetricLight);
    stage.world().spawn((
        FogVolume {
            density_factor: 0.02,
            ..default()
        },
        Transform::from_xyz(0.0, 0.0, -200.0).with_scale(Vec3::new(300.0, 60.0, 300.0)),
    ));
    let bright = |picture: &RgbaImage| picture.pixels().map(|p| u64::from(p[0])).sum::<u64>();
    stage.world().entity_mut(sun).insert(ParallelSplitShadows {
        far: 400.0,
        ..shadows()
    });
    let covered = stage.picture();
    stage.world().entity_mut(sun).insert(ParallelSplitShadows {
        far: 20.0,
        ..shadows()
    });
    let outside = stage.picture();
    save("fog_outside", &outside, &covered);
    let ratio = bright(&outside) as f64 / bright(&covered) as f64;
    assert!(
        (0.98..1.02).contains(&ratio),
        "fog beyond the maps has {ratio} of its light"
    );
}
