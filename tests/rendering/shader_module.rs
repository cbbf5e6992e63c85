//! The shader module compiles under every combination of the flags that reach it.

use bevy::{
    asset::AssetId,
    prelude::*,
    render::{
        render_resource::{ShaderModuleDescriptor, ShaderSource},
        renderer::RenderDevice,
    },
    shader::{
        Shader, ShaderCache, ShaderCacheError, ShaderCacheSource, ShaderDefVal, ValidateShader,
    },
};

use bevy_pssm::{ShaderFeatures, shaders::shader_defs};

use crate::stage::Stage;

/// Calls everything that Bevy and users import from the module.
const ENTRY: &str = "
import bevy_pbr::render::shadows::{
    cascade_debug_visualization, fetch_directional_shadow, fetch_point_shadow, fetch_spot_shadow,
    get_cascade_index, sample_directional_cascade, world_to_directional_light_local,
};

@fragment
fn fragment(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let normal = vec3(0.0, 1.0, 0.0);
    let index = get_cascade_index(0u, position.z);
    let local = world_to_directional_light_local(0u, index, position);
    let shadow = fetch_point_shadow(0u, position, normal, position.xy)
        + fetch_spot_shadow(0u, position, normal, 0.1, position.xy)
        + fetch_directional_shadow(0u, position, normal, position.z, position.xy)
        + sample_directional_cascade(0u, index, position, normal, position.xy);
    return vec4(cascade_debug_visualization(local.xyz, 0u, position.z), shadow);
}
";

/// The same calls in another function.
fn calls_in(function: &str) -> String {
    let fragment = "@fragment\nfn fragment(@builtin(position) position: vec4<f32>) -> @location(0)";
    assert!(ENTRY.contains(fragment));
    ENTRY.replace(fragment, function)
}

/// As a material's vertex shader might.
fn vertex_entry() -> String {
    calls_in("@vertex\nfn vertex(@location(0) position: vec4<f32>) -> @builtin(position)")
}

/// As a game's compute shader might.
fn compute_entry() -> String {
    calls_in("fn calls(position: vec4<f32>) ->")
        + "
@group(3) @binding(0) var<storage, read_write> found: array<vec4<f32>>;

@compute @workgroup_size(64)
fn compute(@builtin(global_invocation_id) id: vec3<u32>) {
    found[id.x] = calls(vec4(vec3<f32>(id), 1.0));
}
"
}

const GAUSSIAN: &str = "SHADOW_FILTER_METHOD_GAUSSIAN";
const TEMPORAL: &str = "SHADOW_FILTER_METHOD_TEMPORAL";

/// Flags of passes in which the next pixel may be another surface's.
const RAGGED: [&str; 4] = [
    "MAY_DISCARD",
    "VISIBILITY_RANGE_DITHER",
    "FORWARD_DECAL",
    "MESHLET_MESH_MATERIAL_PASS",
];

fn load(
    device: &RenderDevice,
    source: ShaderCacheSource,
    _: &ValidateShader,
) -> Result<String, ShaderCacheError> {
    let ShaderCacheSource::Wgsl(text) = source else {
        return Err(ShaderCacheError::CreateShaderModule("not WGSL".into()));
    };
    let scope = device
        .wgpu_device()
        .push_error_scope(wgpu::ErrorFilter::Validation);
    device.create_and_validate_shader_module(ShaderModuleDescriptor {
        label: None,
        source: ShaderSource::Wgsl(text.clone().into()),
    });
    match bevy::tasks::block_on(scope.pop()) {
        Some(error) => Err(ShaderCacheError::CreateShaderModule(error.to_string())),
        None => Ok(text),
    }
}

#[test]
fn every_flag_combination_compiles() {
    let mut stage = Stage::new();
    stage.sun();
    stage.picture();
    let device = stage.world().resource::<RenderDevice>().clone();
    let mut cache = ShaderCache::new(device, load);
    let mut replacements = Vec::new();
    for (id, shader) in stage.world().resource::<Assets<Shader>>().iter() {
        cache.set_shader(id, shader.clone());
        let names = ["shadows.wesl", "shadow_sampling.wesl"];
        let is_ours = |name| shader.path.ends_with(&format!("bevy_pbr/render/{name}"));
        if names.into_iter().any(is_ours) {
            replacements.push((id, shader.clone()));
        }
    }
    assert_eq!(replacements.len(), 2, "Bevy's modules have gone");
    let entry = AssetId::from(bevy::asset::uuid::Uuid::from_u128(1));
    cache.set_shader(
        entry,
        Shader::from_wesl(ENTRY, "embedded://tests/entry.wesl"),
    );
    let other_entries = [
        (2, "vertex", vertex_entry()),
        (3, "compute", compute_entry()),
    ];
    let other_entries = other_entries.map(|(number, stage, text)| {
        let entry = AssetId::from(bevy::asset::uuid::Uuid::from_u128(number));
        let path = format!("embedded://tests/{stage}_entry.wesl");
        cache.set_shader(entry, Shader::from_wesl(text, path));
        (stage, entry)
    });

    let filters = [
        None,
        Some("SHADOW_FILTER_METHOD_HARDWARE_2X2"),
        Some(GAUSSIAN),
        Some(TEMPORAL),
    ];
    let platforms: [&[&str]; 7] = [
        &[],
        &[
            "AVAILABLE_STORAGE_BUFFER_BINDINGS__GE_3",
            "DEPTH_PREPASS",
            "TEMPORAL_JITTER",
            "MAY_DISCARD",
        ],
        &["NO_CUBE_ARRAY_TEXTURES_SUPPORT", "FORWARD_DECAL"],
        &["VISIBILITY_RANGE_DITHER"],
        &[
            "AVAILABLE_STORAGE_BUFFER_BINDINGS__GE_3",
            "MESHLET_MESH_MATERIAL_PASS",
        ],
        &["DEFERRED_LIGHTING_PIPELINE", "DEPTH_PREPASS"],
        &["DEFERRED_LIGHTING_PIPELINE", "PCSS_SAMPLERS_AVAILABLE"],
    ];
    let mut switches = platforms.concat();
    switches.sort_unstable();
    switches.dedup();
    let mut compiled = 0;
    for set in 0..128_u32 {
        let has = |bit: u32| set & (1 << bit) != 0;
        let parts = ShaderFeatures {
            biases: has(0),
            tents: has(1),
            temporal: has(2),
            soft: has(3),
            warps: has(4),
            overlays: has(5),
            built_in: has(6),
            // With half of everything else.
            faces: set.count_ones() % 2 == 1,
            sheared: set.count_ones() % 4 < 2,
            any_stage: set & 3 == 3,
        };
        let defs = shader_defs(parts);
        for (module, shader) in &replacements {
            let mut shader = shader.clone();
            shader.shader_defs = defs.clone();
            cache.set_shader(*module, shader);
        }
        // All platforms with nothing and with everything, one of them in between.
        let platforms = match set {
            0 | 127 => &platforms[..],
            _ => &platforms[set as usize % platforms.len()..][..1],
        };
        for filter in filters {
            for platform in platforms {
                let mut defs: Vec<ShaderDefVal> =
                    filter.into_iter().map(ShaderDefVal::from).collect();
                for name in &switches {
                    defs.push(ShaderDefVal::Bool((*name).into(), platform.contains(name)));
                }
                let text = cache
                    .get(compiled, entry, &defs)
                    .unwrap_or_else(|error| panic!("{parts:?}, {defs:?}: {error}"));
                for (name, part) in [
                    ("fetch_split_shadow", true),
                    ("built_in_fetch_directional_shadow", parts.built_in),
                    ("manual", parts.biases),
                    ("soft(lookup", parts.soft),
                    (
                        "temporal(lookup",
                        parts.temporal || filter == Some(TEMPORAL),
                    ),
                    ("tent_sum(lookup", parts.tents || filter == Some(GAUSSIAN)),
                    ("cascade_color", parts.overlays),
                    ("is_in_wedge", parts.faces),
                    ("dpdx(shading", !parts.any_stage),
                    (
                        "are_seen_square",
                        RAGGED.iter().any(|flag| platform.contains(flag)),
                    ),
                ] {
                    assert_eq!(text.contains(name), part, "{name}: {parts:?}, {filter:?}");
                }
                compiled += 1;
            }
        }
        if parts.any_stage {
            let mut defs = vec![ShaderDefVal::from(GAUSSIAN)];
            for name in &switches {
                defs.push(ShaderDefVal::Bool((*name).into(), false));
            }
            for (stage, entry) in other_entries {
                let found = cache.get(0, entry, &defs);
                found.unwrap_or_else(|error| panic!("in a {stage} shader, {parts:?}: {error}"));
            }
        }
    }
    assert_eq!(compiled, (126 + 2 * 7) * 4);
}
