//! Casters whose mesh or material changes.

use std::sync::{Mutex, PoisonError};

use bevy::{
    asset::{AssetEvent, AssetId, Assets},
    ecs::{
        entity::Entity,
        message::MessageReader,
        resource::Resource,
        system::{Query, Res, ResMut, SystemParam},
    },
    image::Image,
    material::AlphaMode,
    mesh::{Mesh, Mesh3d},
    pbr::{MeshMaterial3d, StandardMaterial},
    platform::{collections::HashSet, sync::Arc},
};

/// Casters whose mesh or material has changed of late, as the renderer has seen them: of whatever type it is.
#[derive(Resource, Debug, Default, Clone)]
pub struct EditedCasters(Arc<Mutex<Vec<Entity>>>);

impl EditedCasters {
    pub fn note(&self, edited: impl Iterator<Item = Entity>) {
        let mut casters = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        casters.extend(edited);
    }

    fn take(&self) -> Vec<Entity> {
        core::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Materials whose mask has changed since changes were looked for last: they do not change with their images.
#[derive(Resource, Debug, Default)]
pub struct NewMasks(HashSet<AssetId<StandardMaterial>>);

pub(super) fn note_changed_masks(
    mut images: MessageReader<AssetEvent<Image>>,
    materials: Res<Assets<StandardMaterial>>,
    mut masks: ResMut<NewMasks>,
) {
    let modified = images.read().filter_map(|event| match event {
        AssetEvent::Modified { id } => Some(*id),
        _ => None,
    });
    let modified: HashSet<AssetId<Image>> = modified.collect();
    if modified.is_empty() {
        return;
    }
    let masked = materials.iter().filter(|(_, material)| {
        let image = material.base_color_texture.as_ref();
        let is_modified = image.is_some_and(|image| modified.contains(&image.id()));
        is_modified && material.alpha_mode != AlphaMode::Opaque
    });
    masks.0.extend(masked.map(|(id, _)| id));
}

/// What tells of edits.
#[derive(SystemParam)]
pub struct Edits<'w, 's> {
    seen: Res<'w, EditedCasters>,
    masks: ResMut<'w, NewMasks>,
    materials: Query<'w, 's, (Entity, &'static MeshMaterial3d<StandardMaterial>)>,
    meshes: Query<'w, 's, &'static Mesh3d>,
    assets: Option<Res<'w, Assets<Mesh>>>,
}

impl Edits<'_, '_> {
    /// Entities whose mask has changed, and those whose mesh or material has, which the renderer heeds by itself.
    pub fn take(&mut self) -> (Vec<Entity>, Vec<Entity>) {
        let masks = core::mem::take(&mut self.masks.0);
        let is_masked = |material: &MeshMaterial3d<_>| masks.contains(&material.id());
        let masked = if masks.is_empty() {
            Vec::new()
        } else {
            let meshes = self.materials.iter();
            let masked = meshes.filter(|(_, material)| is_masked(material));
            masked.map(|(entity, _)| entity).collect()
        };
        (masked, self.seen.take())
    }

    /// Whether an entity's mesh is loaded.
    pub fn has_mesh(&self, entity: Entity) -> bool {
        let mesh = self.meshes.get(entity).ok();
        let assets = self.assets.as_ref();
        mesh.is_some_and(|mesh| assets.is_none_or(|assets| assets.contains(&mesh.0)))
    }
}
