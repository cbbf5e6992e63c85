//! Cameras that look up each other's maps.

use bevy::{
    camera::visibility::RenderLayers,
    ecs::{
        component::Component,
        entity::{Entity, EntityHashMap},
        reflect::ReflectComponent,
        resource::Resource,
    },
    reflect::Reflect,
};

use crate::geometry::slice::ViewVolume;

/// The camera looks up the maps of another one, which are made for what both see: the other eye of a
/// headset. Cameras that see exactly the same share maps without it.
///
/// The two look the same way from beside each other; their projections may differ. Each has maps of its own, as
/// without the component, while they do not (canted eyes), one is not drawn, their render layers
/// differ, or the other camera shares a third one's maps itself.
#[derive(Component, Reflect, Debug, Clone, Copy, PartialEq, Eq)]
#[reflect(Component, Debug, Clone, PartialEq)]
pub struct SharesShadowsWith(#[entities] pub Entity);

/// A camera that may share maps.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sharer {
    pub camera: Entity,
    pub with: Option<Entity>,
    pub layers: RenderLayers,
    pub volume: Option<ViewVolume>,
    /// It has a picture to be drawn into.
    pub is_drawn: bool,
}

/// Which cameras look up the maps of which others, and what those maps are made for.
#[derive(Resource, Debug, Default)]
pub struct SharedViews {
    /// By the camera that has no maps of its own: the one that has.
    hosts: EntityHashMap<Entity>,
    /// By the camera that has maps: what it and its guests see.
    volumes: EntityHashMap<ViewVolume>,
    /// What this follows from.
    cameras: Vec<Sharer>,
}

impl SharedViews {
    pub(super) fn update<I: Iterator<Item = Sharer>>(&mut self, cameras: impl Fn() -> I) {
        if !cameras().eq(self.cameras.iter().cloned()) {
            *self = Self {
                cameras: cameras().collect(),
                ..Self::new(cameras().collect())
            };
        }
    }

    fn new(mut cameras: Vec<Sharer>) -> Self {
        // Whoever comes first has the maps: always the same.
        cameras.sort_unstable_by_key(|it| (!it.is_drawn, it.camera));
        let mut shared = Self::default();
        let known = |camera| cameras.iter().find(|it| it.camera == camera);
        let host_of = |it: &Sharer| it.with.and_then(known);
        let may_share = |host: &Sharer, guest: &Sharer| {
            host.layers == guest.layers && (host.is_drawn || !guest.is_drawn)
        };
        for guest in &cameras {
            let Some(host) = host_of(guest) else {
                continue;
            };
            if host_of(host).is_some() || !may_share(host, guest) {
                continue;
            }
            let seen_before = shared.volumes.get(&host.camera).copied().or(host.volume);
            let both = seen_before.zip(guest.volume);
            if let Some(both) = both.and_then(|(host, guest)| host.around(&guest)) {
                shared.hosts.insert(guest.camera, host.camera);
                shared.volumes.insert(host.camera, both);
            }
        }
        for (index, guest) in cameras.iter().enumerate() {
            let stands_alone =
                host_of(guest).is_none() && !shared.volumes.contains_key(&guest.camera);
            if !stands_alone || guest.volume.is_none() {
                continue;
            }
            let host = cameras[..index].iter().find(|it| {
                let has_maps = !shared.hosts.contains_key(&it.camera);
                has_maps && it.volume == guest.volume && may_share(it, guest)
            });
            if let Some(host) = host {
                shared.hosts.insert(guest.camera, host.camera);
            }
        }
        shared
    }

    /// The camera whose maps another one looks up.
    pub fn host_of(&self, camera: Entity) -> Option<Entity> {
        self.hosts.get(&camera).copied()
    }

    /// The cameras that look up a camera's maps, beside it.
    pub fn guests_of(&self, camera: Entity) -> impl Iterator<Item = Entity> {
        let of_camera =
            move |(guest, host): (&Entity, &Entity)| (*host == camera).then_some(*guest);
        self.hosts.iter().filter_map(of_camera)
    }

    /// All cameras that look up another one's maps, and that one.
    pub fn pairs(&self) -> impl Iterator<Item = (Entity, Entity)> {
        self.hosts.iter().map(|(guest, host)| (*guest, *host))
    }

    /// What a camera's maps are made for, if that is more than it sees itself.
    pub(super) fn volume_of(&self, camera: Entity) -> Option<ViewVolume> {
        self.volumes.get(&camera).copied()
    }
}
