//! Taking over the views whose maps share Bevy's array texture: each gets a layer of our target
//! and becomes a root view, which [`shadow_map_pass`](super::shadow_map_pass) draws.

use bevy::{
    camera::visibility::RenderLayers,
    core_pipeline::schedule::{Core3d, RootNonCameraView},
    ecs::{
        component::Component,
        entity::Entity,
        query::{With, Without},
        resource::Resource,
        schedule::ScheduleLabel,
        system::{Commands, Local, Query, Res, ResMut},
    },
    light::DirectionalLightShadowMap,
    log::{info, warn},
    math::{UVec2, UVec4},
    pbr::{
        CORE_3D_SHADOW_MAP_FORMAT, ExtractedDirectionalLight, LightEntity, MAX_DIRECTIONAL_LIGHTS,
        ShadowView, ViewLightEntities, ViewShadowBindings,
    },
    render::{
        camera::SortedCameras,
        occlusion_culling::{
            OcclusionCulling, OcclusionCullingSubview, OcclusionCullingSubviewEntities,
        },
        render_resource::{
            Extent3d, Texture, TextureAspect, TextureDescriptor, TextureDimension, TextureUsages,
            TextureView, TextureViewDescriptor, TextureViewDimension,
        },
        renderer::RenderDevice,
        sync_world::MainEntity,
        view::ExtractedView,
    },
};

use super::{ExtractedShadows, extract::ExtractedCascade, options::LookupOptions};
use crate::shaders::LeftToBevy;

/// A view whose map lies in our target.
#[derive(Component, Debug, Clone, Copy, PartialEq, Eq)]
pub struct AdoptedMap {
    /// Layer of the target.
    pub layer: u32,
    /// Texels per side, in the layer's first corner.
    pub size: UVec2,
    /// Whether the map may be left undrawn when it has no casters: the shader then takes it as
    /// lit. Bevy's own maps are always drawn.
    pub skip_if_empty: bool,
    spot_index: Option<u32>,
}

/// The maps of a camera: where the shader finds each light's.
#[derive(Component, Debug, Default, Clone)]
pub(super) struct AdoptedLights {
    pub lights: Vec<AdoptedLight>,
    /// Lights in the camera's uniform, shadowed or not.
    pub light_count: usize,
}

#[derive(Debug, Clone)]
pub(super) struct AdoptedLight {
    /// Position in the camera's uniform.
    pub index: u32,
    pub base_layer: u32,
    /// Without meaning if the light is not ours.
    pub options: LookupOptions,
    /// View entities of the light's cascades, with their plan if the light is ours.
    pub cascades: Vec<(Entity, Option<ExtractedCascade>)>,
}

/// The depth array that holds all maps.
#[derive(Resource, Debug, Default)]
pub struct ShadowTarget {
    texture: Option<Texture>,
    layers: Vec<TextureView>,
    /// Of a layer.
    pub(super) size: UVec2,
    /// Side of the maps that are not ours.
    pub(super) stock_size: u32,
}

impl ShadowTarget {
    /// One layer of the array; `None` past its end.
    pub fn layer(&self, layer: u32) -> Option<&TextureView> {
        self.layers.get(layer as usize)
    }

    fn fit(&mut self, device: &RenderDevice, size: UVec2, layers: u32) -> &Texture {
        let held = self.layers.len() as u32;
        let fits = self.size == size && held >= layers && held <= 2 * layers;
        if !fits {
            self.texture = None;
        }
        self.size = size;
        let (views, texture) = (&mut self.layers, &mut self.texture);
        texture.get_or_insert_with(|| {
            let texture = device.create_texture(&TextureDescriptor {
                label: Some("pssm_shadow_maps"),
                size: Extent3d {
                    width: size.x,
                    height: size.y,
                    depth_or_array_layers: layers,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: TextureDimension::D2,
                format: CORE_3D_SHADOW_MAP_FORMAT,
                usage: TextureUsages::RENDER_ATTACHMENT
                    | TextureUsages::TEXTURE_BINDING
                    | TextureUsages::COPY_SRC,
                view_formats: &[],
            });
            *views = (0..layers)
                .map(|layer| layer_view(&texture, layer))
                .collect();
            texture
        })
    }
}

fn layer_view(texture: &Texture, layer: u32) -> TextureView {
    texture.create_view(&TextureViewDescriptor {
        label: Some("pssm_shadow_map"),
        dimension: Some(TextureViewDimension::D2),
        base_array_layer: layer,
        array_layer_count: Some(1),
        ..Default::default()
    })
}

/// Bevy's occlusion culling has no late phase for cascades and would drop casters for a frame.
pub(super) fn forgo_occlusion_culling(
    extracted: Res<ExtractedShadows>,
    mut lights: Query<(&MainEntity, &mut ExtractedDirectionalLight)>,
    mut told: Local<bool>,
) {
    for (light, mut extracted_light) in &mut lights {
        if extracted_light.occlusion_culling && extracted.lights.contains_key(light) {
            extracted_light.occlusion_culling = false;
            if !*told {
                *told = true;
                info!(
                    "Light {light:?} is drawn without occlusion culling, which would lose casters"
                );
            }
        }
    }
}

/// Nothing is drawn into Bevy's array while its maps live in ours: it need not be large. Unless
/// slots may run out, which only [`adopt_views`] finds out, too late to make it large again.
pub(super) fn shrink_stock_maps(
    extracted: Res<ExtractedShadows>,
    target: Res<ShadowTarget>,
    lights: Query<(), With<ExtractedDirectionalLight>>,
    mut stock: ResMut<DirectionalLightShadowMap>,
) {
    let slots = lights.iter().count() + extracted.lights.len();
    let unused = !extracted.lights.is_empty() && target.texture.is_some();
    stock.size = if unused && slots <= MAX_DIRECTIONAL_LIGHTS {
        1
    } else {
        extracted.stock_size
    };
}

pub(super) fn adopt_views(
    mut commands: Commands,
    device: Res<RenderDevice>,
    extracted: Res<ExtractedShadows>,
    sorted_cameras: Res<SortedCameras>,
    mut target: ResMut<ShadowTarget>,
    mut cameras: Query<(
        &MainEntity,
        &mut ViewLightEntities,
        &mut ViewShadowBindings,
        Option<&RenderLayers>,
        Option<&mut OcclusionCullingSubviewEntities>,
    )>,
    mut views: Query<
        (
            Entity,
            &LightEntity,
            &mut ExtractedView,
            Option<&ShadowView>,
            Option<&AdoptedMap>,
        ),
        Without<ViewLightEntities>,
    >,
    lights: Query<(&MainEntity, Option<&RenderLayers>), With<ExtractedDirectionalLight>>,
    adopted_cameras: Query<Entity, With<AdoptedLights>>,
    left_to_bevy: Res<LeftToBevy>,
    mut warned: Local<bool>,
) {
    let order: Vec<Entity> = sorted_cameras
        .0
        .iter()
        .map(|camera| camera.entity)
        .collect();
    let release = |commands: &mut Commands, target: &mut ShadowTarget| {
        for (view, light, _, _, adopted) in &views {
            if adopted.is_some() {
                commands.entity(view).remove::<AdoptedMap>();
                if matches!(light, LightEntity::Directional { .. }) {
                    commands.entity(view).remove::<RootNonCameraView>();
                }
            }
        }
        for camera in &adopted_cameras {
            commands.entity(camera).remove::<AdoptedLights>();
        }
        *target = ShadowTarget::default();
    };
    if extracted.lights.is_empty() {
        if target.texture.is_some() {
            release(&mut commands, &mut target);
        }
        return;
    }

    let max_size = device.limits().max_texture_dimension_2d;
    let stock_size = (extracted.stock_size as u32).min(max_size);
    let stock_cascades = order
        .iter()
        .filter_map(|camera| Some(cameras.get(*camera).ok()?.1.lights.len()))
        .max()
        .unwrap_or(0) as u32;

    let mut maps: Vec<(Entity, AdoptedMap)> = Vec::new();
    let mut spot_count = 0;
    for (view, light, _, shadow_view, adopted) in &views {
        if !matches!(light, LightEntity::Spot { .. }) {
            continue;
        }
        let named = shadow_view.and_then(|view| index_in_name(&view.pass_name, "spot_light_"));
        let Some(index) = named.or(adopted.and_then(|map| map.spot_index)) else {
            continue;
        };
        spot_count = spot_count.max(index + 1);
        maps.push((
            view,
            AdoptedMap {
                // Where the shader looks for it: right after the neediest camera's cascades.
                layer: stock_cascades + index,
                size: UVec2::splat(stock_size),
                skip_if_empty: false,
                spot_index: Some(index),
            },
        ));
    }

    let mut next_layer = 0;
    let mut records: Vec<(Entity, AdoptedLights)> = Vec::new();
    for camera in &order {
        let Ok((camera_main, camera_lights, _, layers, _)) = cameras.get(*camera) else {
            continue;
        };
        let camera_layers = layers.cloned().unwrap_or_default();
        let mut record = AdoptedLights {
            lights: Vec::new(),
            light_count: lights
                .iter()
                .filter(|(_, layers)| {
                    layers
                        .cloned()
                        .unwrap_or_default()
                        .intersects(&camera_layers)
                })
                .count()
                .min(MAX_DIRECTIONAL_LIGHTS),
        };
        let mut previous = None;
        for view in &camera_lights.lights {
            let Ok((
                _,
                LightEntity::Directional {
                    light_entity,
                    cascade_index,
                },
                _,
                Some(shadow_view),
                _,
            )) = views.get(*view)
            else {
                continue;
            };
            let Some(index) = index_in_name(&shadow_view.pass_name, "directional_light_") else {
                continue;
            };
            let managed = lights
                .get(*light_entity)
                .ok()
                .and_then(|(main, _)| extracted.lights.get(main));
            let own = managed
                .and_then(|light| light.views.get(camera_main))
                .map(|cascades| cascades.get(*cascade_index).copied().unwrap_or(NO_MAP));
            if previous != Some(*light_entity) {
                previous = Some(*light_entity);
                record.lights.push(AdoptedLight {
                    index,
                    base_layer: next_layer,
                    options: managed.map(|light| light.options).unwrap_or_default(),
                    cascades: Vec::new(),
                });
            }
            if let Some(light) = record.lights.last_mut() {
                light.cascades.push((*view, own));
            }
            maps.push((
                *view,
                AdoptedMap {
                    layer: next_layer,
                    size: own.map_or(UVec2::splat(stock_size), |cascade| {
                        cascade.map_size.min(UVec2::splat(max_size))
                    }),
                    skip_if_empty: own.is_some(),
                    spot_index: None,
                },
            ));
            next_layer += 1;
            if next_layer == stock_cascades {
                next_layer += spot_count;
            }
        }
        // The next camera starts behind the spot lights' maps.
        next_layer = next_layer.max(stock_cascades + spot_count);
        records.push((*camera, record));
    }

    let layers = maps.iter().map(|(_, map)| map.layer + 1).max().unwrap_or(0);
    let slots_needed = |record: &AdoptedLights| {
        let own = record.lights.iter().filter(|light| light.is_ours()).count();
        record.light_count + own.max(1)
    };
    let too_many = layers > device.limits().max_texture_array_layers
        || records
            .iter()
            .any(|(_, record)| slots_needed(record) > MAX_DIRECTIONAL_LIGHTS);
    left_to_bevy.set(too_many);
    if layers == 0 || too_many {
        if too_many && !*warned {
            *warned = true;
            warn!(
                "Too many shadowed lights or cameras for own maps: Bevy's pass draws the cascades"
            );
        }
        release(&mut commands, &mut target);
        return;
    }

    let size = maps
        .iter()
        .map(|(_, map)| map.size)
        .reduce(UVec2::max)
        .unwrap_or(UVec2::splat(stock_size));
    target.stock_size = stock_size;
    let texture = target.fit(&device, size, layers).clone();
    let array = texture.create_view(&TextureViewDescriptor {
        label: Some("pssm_shadow_map_array"),
        dimension: Some(TextureViewDimension::D2Array),
        aspect: TextureAspect::DepthOnly,
        ..Default::default()
    });
    for (_, mut camera_lights, mut bindings, _, subviews) in &mut cameras {
        bindings.directional_light_depth_texture = texture.clone();
        bindings.directional_light_depth_texture_view = array.clone();
        if let Some(mut subviews) = subviews {
            subviews.0.clear();
        }
        // Bevy's per-camera pass has nothing left to draw.
        camera_lights.lights.clear();
    }
    for (view, map) in maps {
        if let Ok((_, _, mut extracted_view, _, adopted)) = views.get_mut(view) {
            extracted_view.viewport = UVec4::new(0, 0, map.size.x, map.size.y);
            if adopted != Some(&map) {
                commands
                    .entity(view)
                    .insert((map, RootNonCameraView(Core3d.intern())));
            }
            commands
                .entity(view)
                .remove::<(ShadowView, OcclusionCulling, OcclusionCullingSubview)>();
        }
    }
    // A camera that is no longer drawn must not write into the others' uniform.
    for camera in &adopted_cameras {
        if records.iter().all(|(recorded, _)| *recorded != camera) {
            commands.entity(camera).remove::<AdoptedLights>();
        }
    }
    for (camera, record) in records {
        commands.entity(camera).insert(record);
    }
}

/// A cascade that exists for Bevy but has no plan: its light or camera is degenerate.
const NO_MAP: ExtractedCascade = ExtractedCascade {
    map_size: UVec2::splat(crate::config::MIN_MAP_SIZE),
    has_map: false,
    texel: [0.0; 2],
    depth_per_meter: 0.0,
    blend_start: f32::MAX,
    far: f32::MAX,
    wedge: None,
};

impl AdoptedLight {
    pub fn is_ours(&self) -> bool {
        self.cascades.iter().any(|(_, own)| own.is_some())
    }
}

/// Bevy publishes the position of a light in its uniform and of a spot light among spot lights
/// in the names of their passes only.
fn index_in_name(pass_name: &str, kind: &str) -> Option<u32> {
    let (_, rest) = pass_name.split_once(kind)?;
    rest.split('_').next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::index_in_name;

    #[test]
    fn light_indices_are_read_off_pass_names() {
        let name = "shadow_directional_light_7_cascade_3";
        assert_eq!(index_in_name(name, "directional_light_"), Some(7));
        assert_eq!(
            index_in_name("shadow_spot_light_12", "spot_light_"),
            Some(12)
        );
        assert_eq!(
            index_in_name("shadow_point_light_1_face", "spot_light_"),
            None
        );
    }
}
