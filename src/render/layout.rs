//! Which layer of the target each map gets.
//!
//! While any light is managed, *all* maps that share Bevy's array texture move to the plugin's
//! target: managed cascades, those of other directional lights, and spot lights' maps.

use bevy::{
    ecs::{component::Component, entity::Entity},
    math::UVec2,
    pbr::MAX_DIRECTIONAL_LIGHTS,
    platform::collections::HashMap,
};

use super::{extract::ExtractedCascade, options::LookupOptions};

/// A view whose map lies in the plugin's target.
#[derive(Component, Debug, Clone, Copy, PartialEq, Eq)]
pub struct AdoptedMap {
    /// Layer of the target.
    pub layer: u32,
    /// Texels per side, from the layer's texel (0, 0) on.
    pub size: UVec2,
    /// Whether the map may be left undrawn when it has no casters: the shader then takes it as
    /// lit. Bevy's own maps are always drawn.
    pub skip_if_empty: bool,
    /// Whether what its layer holds still serves, maybe with more casters, if that is whole.
    pub(super) may_keep: bool,
    pub(super) spot_index: Option<u32>,
}

/// The maps of a camera: where the shader finds each light's.
#[derive(Component, Debug, Default, Clone, PartialEq)]
pub(super) struct AdoptedLights {
    pub lights: Vec<AdoptedLight>,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct AdoptedLight {
    /// Position in the camera's uniform.
    pub index: u32,
    pub base_layer: u32,
    /// Without meaning if the light is not managed.
    pub options: LookupOptions,
    /// View entities of the light's cascades, with their plan if the light is managed.
    pub cascades: Vec<(Entity, Option<ExtractedCascade>)>,
}

impl AdoptedLight {
    pub fn is_managed(&self) -> bool {
        self.cascades.iter().any(|(_, cascade)| cascade.is_some())
    }
}

/// What layers are wanted for, and how many there can be.
#[derive(Debug, Default)]
pub(super) struct LayerRequest {
    /// In the order in which they are drawn.
    pub cameras: Vec<CameraRequest>,
    /// View entities of spot lights' maps, and their index among spot lights.
    pub spots: Vec<(Entity, u32)>,
    /// Side of Bevy's own maps, as the game wants them (texels).
    pub built_in_size: u32,
    /// What the GPU allows.
    pub max_size: u32,
    pub max_layers: u32,
}

/// A camera's share of the lights.
#[derive(Debug)]
pub(super) struct CameraRequest {
    pub camera: Entity,
    /// The camera whose maps of managed lights it looks up.
    pub host: Option<Entity>,
    /// Lights in its uniform, shadowed or not.
    pub light_count: usize,
    /// Layers that Bevy counts for it.
    pub built_in_layers: u32,
    /// The first layer that it has had.
    pub first_layer: Option<u32>,
    /// Cascades, light by light.
    pub cascades: Vec<CascadeRequest>,
}

#[derive(Debug)]
pub(super) struct CascadeRequest {
    pub view: Entity,
    pub light: Entity,
    /// Position of the light in the camera's uniform.
    pub light_index: u32,
    /// Without meaning if the light is not managed.
    pub options: LookupOptions,
    /// `None` if the light is not managed.
    pub cascade: Option<ExtractedCascade>,
}

/// Where all maps lie.
#[derive(Debug, PartialEq)]
pub(super) struct LayerLayout {
    pub maps: Vec<(Entity, AdoptedMap)>,
    pub cameras: Vec<(Entity, AdoptedLights)>,
    pub layers: u32,
    /// Of a layer (texels).
    pub size: UVec2,
    /// Side of Bevy's own maps (texels).
    pub built_in_size: u32,
}

/// Layers for all maps; `None` if layers or the uniform's slots run out.
pub(super) fn layout_layers(request: &LayerRequest) -> Option<LayerLayout> {
    let built_in_size = request.built_in_size.min(request.max_size);
    // Spot lights' maps come where the shader looks for them: right after the cascades of the
    // camera that has the most.
    let layers_before_spots = request.cameras.iter().map(|it| it.built_in_layers).max();
    let layers_before_spots = layers_before_spots.unwrap_or(0);
    let spot_count = request.spots.iter().map(|(_, index)| index + 1).max();
    let spot_count = spot_count.unwrap_or(0);
    let mut maps: Vec<(Entity, AdoptedMap)> = request
        .spots
        .iter()
        .map(|(view, index)| {
            let map = AdoptedMap {
                layer: layers_before_spots + index,
                size: UVec2::splat(built_in_size),
                skip_if_empty: false,
                may_keep: false,
                spot_index: Some(*index),
            };
            (*view, map)
        })
        .collect();

    let mut next_layer = 0;
    let mut cameras: Vec<(Entity, AdoptedLights)> = Vec::with_capacity(request.cameras.len());
    let mut hosts: HashMap<(Entity, Entity), AdoptedLight> = HashMap::default();
    let (mut own, shared): (Vec<_>, Vec<_>) =
        request.cameras.iter().partition(|it| it.host.is_none());
    // Maps that stay where they are need not be drawn anew when another camera comes or goes.
    own.sort_by_key(|it| it.first_layer.unwrap_or(u32::MAX));
    for camera in own.iter().chain(&shared) {
        let mut lights: Vec<AdoptedLight> = Vec::new();
        for by_light in camera.cascades.chunk_by(|a, b| a.light == b.light) {
            let first = &by_light[0];
            let of_host = camera.host.and_then(|host| hosts.get(&(host, first.light)));
            if let Some(of_host) = of_host {
                lights.push(AdoptedLight {
                    index: first.light_index,
                    ..of_host.clone()
                });
                continue;
            }
            lights.push(AdoptedLight {
                index: first.light_index,
                base_layer: next_layer,
                options: first.options,
                cascades: by_light.iter().map(|it| (it.view, it.cascade)).collect(),
            });
            for it in by_light {
                let size = it.cascade.map(|cascade| cascade.map_size);
                let size = size.unwrap_or(UVec2::splat(built_in_size));
                let map = AdoptedMap {
                    layer: next_layer,
                    size: size.min(UVec2::splat(request.max_size)),
                    skip_if_empty: it.cascade.is_some_and(|cascade| !cascade.is_drawn_always),
                    may_keep: it.cascade.is_some_and(|cascade| cascade.may_keep),
                    spot_index: None,
                };
                maps.push((it.view, map));
                next_layer += 1;
                if next_layer == layers_before_spots {
                    next_layer += spot_count;
                }
            }
        }
        if shared.iter().any(|it| it.host == Some(camera.camera)) {
            let by_light = camera.cascades.chunk_by(|a, b| a.light == b.light);
            for (light, by_light) in lights.iter().zip(by_light) {
                if light.is_managed() {
                    hosts.insert((camera.camera, by_light[0].light), light.clone());
                }
            }
        }
        // The next camera starts behind the spot lights' maps.
        next_layer = next_layer.max(layers_before_spots + spot_count);
        let managed = lights.iter().filter(|light| light.is_managed()).count();
        if camera.light_count + managed.max(1) > MAX_DIRECTIONAL_LIGHTS {
            return None;
        }
        cameras.push((camera.camera, AdoptedLights { lights }));
    }
    let layers = maps.iter().map(|(_, map)| map.layer + 1).max().unwrap_or(0);
    let size = maps.iter().map(|(_, map)| map.size).reduce(UVec2::max);
    (layers <= request.max_layers).then(|| LayerLayout {
        maps,
        cameras,
        layers,
        size: size.unwrap_or(UVec2::splat(built_in_size)),
        built_in_size,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entity(index: u32) -> Entity {
        Entity::from_raw_u32(index).expect("a small index")
    }

    fn cascade(side: u32) -> ExtractedCascade {
        ExtractedCascade {
            map_size: UVec2::splat(side),
            ..ExtractedCascade::NO_MAP
        }
    }

    /// A camera with lights of so many cascades; of managed ones with the side of their maps.
    fn camera(index: u32, lights: &[(u32, Option<u32>)]) -> CameraRequest {
        let of_light = |(light_index, (count, side)): (usize, &(u32, Option<u32>))| {
            let light_index = light_index as u32;
            let side = *side;
            (0..*count).map(move |cascade_index| CascadeRequest {
                view: entity(1000 * index + 10 * light_index + cascade_index),
                light: entity(1 + light_index),
                light_index,
                options: LookupOptions::default(),
                cascade: side.map(cascade),
            })
        };
        CameraRequest {
            camera: entity(500 + index),
            host: None,
            light_count: lights.len(),
            built_in_layers: lights.iter().map(|light| light.0).sum(),
            first_layer: None,
            cascades: lights.iter().enumerate().flat_map(of_light).collect(),
        }
    }

    fn request(cameras: Vec<CameraRequest>, spots: u32) -> LayerRequest {
        LayerRequest {
            cameras,
            spots: (0..spots)
                .map(|index| (entity(900 + index), index))
                .collect(),
            built_in_size: 1024,
            max_size: 4096,
            max_layers: 256,
        }
    }

    fn layers(layout: &LayerLayout) -> Vec<u32> {
        let mut layers: Vec<u32> = layout.maps.iter().map(|(_, map)| map.layer).collect();
        layers.sort_unstable();
        layers
    }

    #[test]
    fn each_map_has_its_own_layer_and_spots_follow_the_neediest_camera() {
        let cameras = vec![
            camera(1, &[(2, Some(512))]),
            camera(2, &[(4, Some(512)), (3, None)]),
        ];
        let layout = layout_layers(&request(cameras, 2)).expect("there is room");
        assert_eq!(layers(&layout), [0, 1, 7, 8, 9, 10, 11, 12, 13, 14, 15]);
        let spots: Vec<u32> = layout.maps[..2].iter().map(|(_, map)| map.layer).collect();
        assert_eq!(
            spots,
            [7, 8],
            "after the seven cascades of the second camera"
        );
        assert_eq!(layout.cameras[0].1.lights[0].base_layer, 0);
        // The second camera begins behind the spot lights' maps.
        let bases: Vec<u32> = layout.cameras[1]
            .1
            .lights
            .iter()
            .map(|it| it.base_layer)
            .collect();
        assert_eq!(bases, [9, 13]);
        assert_eq!(layout.layers, 16);
    }

    #[test]
    fn guests_look_up_their_hosts_maps_of_managed_lights() {
        let mut guest = camera(1, &[(4, Some(512)), (3, None)]);
        guest.host = Some(entity(502));
        let host = camera(2, &[(4, Some(512)), (3, None)]);
        // Whichever comes first.
        let layout = layout_layers(&request(vec![guest, host], 0)).expect("there is room");
        assert_eq!(layers(&layout), [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]);
        let [host, guest] = [entity(502), entity(501)].map(|camera| {
            let found = layout.cameras.iter().find(|(known, _)| *known == camera);
            &found.expect("it is there").1.lights
        });
        assert_eq!(guest[0], host[0]);
        assert_ne!(
            guest[1].base_layer, host[1].base_layer,
            "other lights' are their own"
        );
        assert!(
            layout
                .maps
                .iter()
                .all(|(view, _)| !(1000..1004).map(entity).any(|it| it == *view))
        );
    }

    #[test]
    fn cameras_keep_their_layers_when_others_come_and_go() {
        let base = |layout: &LayerLayout, index: u32| {
            let mut cameras = layout.cameras.iter();
            let found = cameras.find(|(camera, _)| *camera == entity(500 + index));
            found.expect("it is there").1.lights[0].base_layer
        };
        let lights = [(4, Some(512))];
        let mut main = camera(2, &lights);
        let alone = layout_layers(&request(vec![camera(2, &lights)], 0)).expect("there is room");
        main.first_layer = Some(base(&alone, 2));
        // One that is drawn before it comes.
        let both = layout_layers(&request(vec![camera(1, &lights), main], 0));
        let both = both.expect("there is room");
        assert_eq!([base(&both, 2), base(&both, 1)], [0, 4]);
    }

    #[test]
    fn layers_are_as_large_as_the_largest_map() {
        let layout = layout_layers(&request(vec![camera(1, &[(1, Some(512)), (1, None)])], 1));
        assert_eq!(layout.expect("there is room").size, UVec2::splat(1024));
        let layout = layout_layers(&request(vec![camera(1, &[(1, Some(9000))])], 0));
        assert_eq!(
            layout.expect("there is room").size,
            UVec2::splat(4096),
            "no larger than allowed"
        );
        let mut request = request(vec![camera(1, &[(1, None)])], 1);
        request.built_in_size = 9000;
        let layout = layout_layers(&request).expect("there is room");
        assert_eq!(layout.size, UVec2::splat(4096));
        assert_eq!(layout.built_in_size, 4096, "as large as the maps are drawn");
    }

    #[test]
    fn only_managed_maps_are_left_undrawn_when_empty() {
        let layout = layout_layers(&request(vec![camera(1, &[(1, Some(512)), (1, None)])], 1));
        let skipped = layout.expect("there is room").maps;
        let skipped: Vec<bool> = skipped.iter().map(|(_, map)| map.skip_if_empty).collect();
        assert_eq!(skipped, [false, true, false]);
    }

    #[test]
    fn layers_run_out() {
        let mut request = request(
            vec![camera(1, &[(4, Some(512))]), camera(2, &[(4, Some(512))])],
            1,
        );
        request.max_layers = 9;
        assert!(layout_layers(&request).is_some());
        request.max_layers = 8;
        assert!(layout_layers(&request).is_none());
    }

    #[test]
    fn slots_run_out() {
        let lights = |count: usize| {
            let managed = [(1, Some(512)); 1];
            let others = vec![(1, None); count];
            layout_layers(&request(
                vec![camera(1, &[&managed[..], &others].concat())],
                0,
            ))
        };
        // One slot more for the managed light's data.
        assert!(lights(MAX_DIRECTIONAL_LIGHTS - 2).is_some());
        assert!(lights(MAX_DIRECTIONAL_LIGHTS - 1).is_none());
    }

    #[test]
    fn nothing_needs_no_layers() {
        let layout = layout_layers(&request(Vec::new(), 0)).expect("there is room");
        assert_eq!((layout.layers, layout.maps.len()), (0, 0));
    }
}
