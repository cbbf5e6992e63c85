//! Taking over the views whose maps share Bevy's array texture: each gets a layer of the target, into
//! which it is drawn ([`pass`](super::pass)).

use bevy::{
    camera::visibility::RenderLayers,
    ecs::{
        entity::Entity,
        query::{QueryData, With, Without},
        system::{Commands, Local, Query, Res, ResMut, SystemParam},
    },
    light::DirectionalLightShadowMap,
    log::{info, warn},
    math::UVec4,
    pbr::{
        ExtractedDirectionalLight, LightEntity, MAX_DIRECTIONAL_LIGHTS, ShadowView,
        ViewLightEntities, ViewShadowBindings,
    },
    render::{
        camera::SortedCameras,
        occlusion_culling::{
            OcclusionCulling, OcclusionCullingSubview, OcclusionCullingSubviewEntities,
        },
        renderer::RenderDevice,
        sync_world::{MainEntity, MainEntityHashSet},
        view::ExtractedView,
    },
};

use super::{
    ExtractedShadows,
    extract::ExtractedCascade,
    layout::{
        AdoptedLight, AdoptedLights, AdoptedMap, CameraRequest, CascadeRequest, LayerLayout,
        LayerRequest, layout_layers,
    },
    second_view::{Pipelines, SecondView},
    target::ShadowTarget,
};
use crate::support::{Obstacle, ShadowSupport};

/// Readies what Bevy makes views of: no occlusion culling, which has no late phase for cascades and would drop casters
/// for a frame, and no large array for maps that live in the target, and are not drawn into it. Unless slots may run
/// out, which only [`adopt_views`] finds out, too late to make it large again. Pipelines of second views, which Bevy is
/// about to drop, are kept.
pub(super) fn ready_lights(
    extracted: Res<ExtractedShadows>,
    target: Res<ShadowTarget>,
    support: Res<ShadowSupport>,
    mut lights: Query<(&MainEntity, &mut ExtractedDirectionalLight)>,
    (second_views, mut pipelines): (Query<(&SecondView, &ExtractedView)>, Pipelines),
    mut built_in: ResMut<DirectionalLightShadowMap>,
    mut told: Local<MainEntityHashSet>,
) {
    pipelines.keep(&second_views);
    let slots = lights.iter().count() + extracted.lights.len();
    let is_unused = !extracted.lights.is_empty() && target.exists() && support.may_take_over();
    built_in.size = if is_unused && slots <= MAX_DIRECTIONAL_LIGHTS {
        1
    } else {
        extracted.built_in_size
    };
    for (light, mut extracted_light) in &mut lights {
        if extracted_light.occlusion_culling && extracted.lights.contains_key(light) {
            extracted_light.occlusion_culling = false;
            if told.insert(*light) {
                info!(
                    "Light {light:?} is drawn without occlusion culling, which would lose casters"
                );
            }
        }
    }
}

#[derive(QueryData)]
#[query_data(mutable)]
pub(super) struct AdoptingCamera {
    main: &'static MainEntity,
    lights: &'static mut ViewLightEntities,
    bindings: &'static mut ViewShadowBindings,
    layers: Option<&'static RenderLayers>,
    subviews: Option<&'static mut OcclusionCullingSubviewEntities>,
}

#[derive(QueryData)]
#[query_data(mutable)]
pub(super) struct AdoptableView {
    entity: Entity,
    light: &'static LightEntity,
    extracted: &'static mut ExtractedView,
    shadow: Option<&'static ShadowView>,
    adopted: Option<&'static AdoptedMap>,
}

/// The entities that share Bevy's array of maps.
#[derive(SystemParam)]
pub(super) struct Adoptable<'w, 's> {
    sorted_cameras: Res<'w, SortedCameras>,
    cameras: Query<'w, 's, AdoptingCamera>,
    views: Query<'w, 's, AdoptableView, Without<ViewLightEntities>>,
    lights: Query<
        'w,
        's,
        (&'static MainEntity, Option<&'static RenderLayers>),
        With<ExtractedDirectionalLight>,
    >,
    adopted_cameras: Query<'w, 's, (Entity, &'static AdoptedLights)>,
}

pub(super) fn adopt_views(
    mut commands: Commands,
    device: Res<RenderDevice>,
    extracted: Res<ExtractedShadows>,
    support: Res<ShadowSupport>,
    mut target: ResMut<ShadowTarget>,
    mut adoptable: Adoptable,
    mut warned: Local<bool>,
) {
    let is_wanted = !extracted.lights.is_empty() && support.may_take_over();
    if !is_wanted {
        support.set_out_of_room(false);
    }
    let layout = is_wanted
        .then(|| adoptable.request(&extracted, &device))
        .and_then(|request| match request {
            Ok(request) => {
                let layout = layout_layers(&request);
                support.set_out_of_room(layout.is_none());
                if layout.is_none() && !*warned {
                    *warned = true;
                    warn!(
                        "Too many shadowed lights or cameras for the plugin's maps: Bevy's pass \
                         draws the cascades"
                    );
                }
                layout
            }
            Err(obstacle) => {
                support.refuse(obstacle);
                None
            }
        });
    match layout {
        Some(layout) if layout.layers > 0 => {
            target.built_in_size = layout.built_in_size;
            adoptable.adopt(&mut commands, &device, &mut target, layout);
        }
        _ if target.exists() => {
            adoptable.release(&mut commands);
            target.free();
        }
        _ => {}
    }
}

impl Adoptable<'_, '_> {
    /// # Errors
    /// A view's label that has no index.
    fn request(
        &self,
        extracted: &ExtractedShadows,
        device: &RenderDevice,
    ) -> Result<LayerRequest, Obstacle> {
        let limits = device.limits();
        let mut request = LayerRequest {
            built_in_size: extracted.built_in_size as u32,
            max_size: limits.max_texture_dimension_2d,
            max_layers: limits.max_texture_array_layers,
            ..LayerRequest::default()
        };
        for view in &self.views {
            if matches!(view.light, LightEntity::Spot { .. }) {
                let index = match view.shadow {
                    Some(shadow) => Some(index_in_label(&shadow.pass_name, "spot_light_")?),
                    None => view.adopted.and_then(|map| map.spot_index),
                };
                request
                    .spots
                    .extend(index.map(|index| (view.entity, index)));
            }
        }
        for entity in self.sorted_cameras.0.iter().map(|camera| camera.entity) {
            if let Ok(camera) = self.cameras.get(entity) {
                let request_of_camera = self.camera_request(entity, &camera, extracted)?;
                request.cameras.push(request_of_camera);
            }
        }
        Ok(request)
    }

    fn camera_request(
        &self,
        entity: Entity,
        camera: &AdoptingCameraReadOnlyItem,
        extracted: &ExtractedShadows,
    ) -> Result<CameraRequest, Obstacle> {
        let camera_layers = camera.layers.unwrap_or_default();
        let lights = self.lights.iter().filter(|(_, layers)| {
            let layers = layers.unwrap_or_default();
            layers.intersects(camera_layers)
        });
        let host = extracted.hosts.get(camera.main);
        let host_entity = host.and_then(|host| {
            let hosts = self.sorted_cameras.0.iter().map(|camera| camera.entity);
            hosts
                .into_iter()
                .find(|it| self.cameras.get(*it).is_ok_and(|it| it.main == host))
        });
        let mut request = CameraRequest {
            camera: entity,
            host: host_entity,
            light_count: lights.count().min(MAX_DIRECTIONAL_LIGHTS),
            built_in_layers: camera.lights.lights.len() as u32,
            first_layer: self.first_layer(entity, &camera.lights.lights),
            cascades: Vec::new(),
        };
        for view in camera.lights.lights.iter() {
            let Ok(view) = self.views.get(*view) else {
                continue;
            };
            let (
                LightEntity::Directional {
                    light_entity,
                    cascade_index,
                },
                Some(shadow),
            ) = (view.light, view.shadow)
            else {
                continue;
            };
            let main = self.lights.get(*light_entity).ok().map(|(main, _)| main);
            let managed = main.and_then(|main| extracted.lights.get(main));
            let planned = host.unwrap_or(camera.main);
            let cascades = managed.and_then(|light| light.views.get(planned));
            request.cascades.push(CascadeRequest {
                view: view.entity,
                light: *light_entity,
                light_index: index_in_label(&shadow.pass_name, "directional_light_")?,
                options: managed.map(|light| light.options).unwrap_or_default(),
                cascade: cascades.map(|cascades| {
                    let cascade = cascades.get(*cascade_index).copied();
                    cascade.unwrap_or(ExtractedCascade::NO_MAP)
                }),
            });
        }
        Ok(request)
    }

    /// The first layer of a camera's own maps, of those that it looks up.
    fn first_layer(&self, camera: Entity, own: &[Entity]) -> Option<u32> {
        let (_, adopted) = self.adopted_cameras.get(camera).ok()?;
        let is_own = |light: &&AdoptedLight| {
            let mut cascades = light.cascades.iter();
            cascades.all(|(view, _)| own.contains(view))
        };
        let own = adopted.lights.iter().filter(is_own);
        own.map(|light| light.base_layer).min()
    }

    fn adopt(
        &mut self,
        commands: &mut Commands,
        device: &RenderDevice,
        target: &mut ShadowTarget,
        layout: LayerLayout,
    ) {
        let (texture, array) = target.resize(device, layout.size, layout.layers).clone();
        for mut camera in &mut self.cameras {
            camera.bindings.directional_light_depth_texture = texture.clone();
            camera.bindings.directional_light_depth_texture_view = array.clone();
            if let Some(mut subviews) = camera.subviews {
                subviews.0.clear();
            }
            // Bevy's per-camera pass has nothing left to draw.
            camera.lights.lights.clear();
        }
        // A camera that looks up another one's maps has none of its own any more.
        for it in self.views.iter().filter(|it| it.adopted.is_some()) {
            if !layout.maps.iter().any(|(view, _)| *view == it.entity) {
                commands.entity(it.entity).remove::<AdoptedMap>();
            }
        }
        for (view, map) in layout.maps {
            if let Ok(mut it) = self.views.get_mut(view) {
                it.extracted.viewport = UVec4::new(0, 0, map.size.x, map.size.y);
                if it.adopted != Some(&map) {
                    commands.entity(view).insert(map);
                }
                commands
                    .entity(view)
                    .remove::<(ShadowView, OcclusionCulling, OcclusionCullingSubview)>();
            }
        }
        // A camera that is no longer drawn must not write into the others' uniform.
        for (camera, _) in &self.adopted_cameras {
            if layout.cameras.iter().all(|(drawn, _)| *drawn != camera) {
                commands.entity(camera).remove::<AdoptedLights>();
            }
        }
        for (camera, lights) in layout.cameras {
            commands.entity(camera).insert(lights);
        }
    }

    /// Leaves all views to Bevy.
    fn release(&self, commands: &mut Commands) {
        for view in self.views.iter().filter(|view| view.adopted.is_some()) {
            commands.entity(view.entity).remove::<AdoptedMap>();
        }
        for (camera, _) in &self.adopted_cameras {
            commands.entity(camera).remove::<AdoptedLights>();
        }
    }
}

/// Bevy publishes the position of a light in its uniform and of a spot light among spot lights
/// in the labels of their passes only.
fn index_in_label(label: &str, kind: &str) -> Result<u32, Obstacle> {
    let rest = label.split_once(kind).map(|(_, rest)| rest);
    let number = rest.and_then(|rest| rest.split('_').next()?.parse().ok());
    number.ok_or_else(|| Obstacle::PassLabel(label.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::index_in_label;

    #[test]
    fn light_indices_are_read_off_pass_labels() {
        let label = "shadow_directional_light_7_cascade_3";
        assert_eq!(index_in_label(label, "directional_light_"), Ok(7));
        assert_eq!(
            index_in_label("shadow_spot_light_12", "spot_light_"),
            Ok(12)
        );
        assert!(index_in_label("shadow_point_light_1_face", "spot_light_").is_err());
        assert!(index_in_label("shadow_spot_light_x", "spot_light_").is_err());
    }
}
