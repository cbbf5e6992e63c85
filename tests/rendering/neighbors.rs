//! Pixels whose neighbors were discarded: what is read from those may be anything.

use bevy::{
    asset::uuid_handle,
    pbr::{ExtendedMaterial, MaterialExtension, MaterialPlugin},
    prelude::*,
    reflect::TypePath,
    render::render_resource::AsBindGroup,
    shader::ShaderRef,
};
use bevy_pssm::prelude::*;
use image::RgbaImage;

use crate::{
    compare::{save, share_differing},
    stage::{Stage, shadows},
};

/// Every other column of pixels is lost.
#[derive(Asset, AsBindGroup, TypePath, Debug, Clone, Default)]
struct Torn {}

const TORN: Handle<Shader> = uuid_handle!("0d6f0f35-7a0b-4f0c-8b55-6f3a1c9e2b47");

impl MaterialExtension for Torn {
    fn fragment_shader() -> ShaderRef {
        TORN.into()
    }
}

/// Lost pixels are far off along the light, where a triangle to them would be edge-on.
const SHADER: &str = "
import bevy_pbr::render::{
    forward_io::{FragmentOutput, VertexOutput},
    mesh_view_bindings as view_bindings,
    pbr_fragment::pbr_input_from_standard_material,
    pbr_functions::{apply_pbr_lighting, main_pass_post_lighting_processing},
};

@fragment
fn fragment(in: VertexOutput, @builtin(front_facing) is_front: bool) -> FragmentOutput {
    var pbr_input = pbr_input_from_standard_material(in, is_front);
    let is_lost = u32(in.position.x) % 2u == 1u;
    let away = 500.0 * view_bindings::lights.directional_lights[0].direction_to_light;
    pbr_input.world_position += select(vec4(0.0), vec4(away, 0.0), is_lost);
    var out: FragmentOutput;
    out.color = apply_pbr_lighting(pbr_input);
    out.color = main_pass_post_lighting_processing(pbr_input, out.color);
    return out;
}
";

/// The columns that are not lost.
fn whole(picture: &RgbaImage) -> RgbaImage {
    let (width, height) = picture.dimensions();
    RgbaImage::from_fn(width / 2, height, |x, y| *picture.get_pixel(2 * x, y))
}

#[test]
fn lost_neighbors_do_not_turn_the_surface() {
    type Material = ExtendedMaterial<StandardMaterial, Torn>;
    let mut stage = Stage::with_app(default(), |app| {
        app.add_plugins(MaterialPlugin::<Material>::default());
    });
    stage.clear_casters();
    stage.clear_ground();
    let world = stage.world();
    let shader = Shader::from_wesl(SHADER, "torn.wesl");
    let inserted = world.resource_mut::<Assets<Shader>>().insert(&TORN, shader);
    assert!(inserted.is_ok());
    let base = StandardMaterial {
        perceptual_roughness: 1.0,
        ..default()
    };
    let plain = world
        .resource_mut::<Assets<StandardMaterial>>()
        .add(base.clone());
    let torn = world.resource_mut::<Assets<Material>>().add(Material {
        base,
        extension: Torn {},
    });
    let mut meshes = world.resource_mut::<Assets<Mesh>>();
    let ground = meshes.add(Plane3d::default().mesh().size(600.0, 600.0));
    let slab = meshes.add(Cuboid::new(8.0, 0.2, 8.0));
    world.spawn((
        Mesh3d(slab),
        MeshMaterial3d(plain.clone()),
        Transform::from_xyz(-1.0, 2.0, 0.0),
    ));
    let ground = world.spawn((Mesh3d(ground), MeshMaterial3d(plain))).id();
    // Coarse texels: a plane that is taken for edge-on loses all of the slab's shadow.
    let sun = stage.sun();
    stage.world().entity_mut(sun).insert(ParallelSplitShadows {
        cascades: 1,
        far: 60.0,
        fit: CascadeFit::Stable,
        map_size: MapSize::Same(128),
        ..shadows()
    });
    let set_maps = |stage: &mut Stage, enabled: bool| {
        let light = stage.world().get_mut::<DirectionalLight>(sun);
        light.expect("a light").shadow_maps_enabled = enabled;
    };
    let expected = stage.picture();
    set_maps(&mut stage, false);
    let lit = stage.picture();
    set_maps(&mut stage, true);
    stage
        .world()
        .entity_mut(ground)
        .remove::<MeshMaterial3d<StandardMaterial>>()
        .insert(MeshMaterial3d(torn));
    let found = stage.picture();
    save("lost_neighbors", &found, &expected);
    let shadowed = share_differing(&whole(&lit), &whole(&expected), 12);
    assert!(shadowed > 0.02, "{shadowed}");
    let wrong = share_differing(&whole(&found), &whole(&expected), 12);
    assert!(wrong < 0.02 * shadowed, "{wrong} of {shadowed}");
}
