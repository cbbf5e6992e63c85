//! Which meshes a vertex shader of their material's own moves.

use bevy::{
    ecs::{
        change_detection::Tick,
        entity::Entity,
        system::{Local, Res},
    },
    material::MaterialProperties,
    pbr::{MaterialVertexShader, PreparedMaterial, PrepassVertexShader, RenderMaterialInstances},
    platform::collections::HashSet,
    render::erased_render_asset::ErasedRenderAssets,
};
use core::{any::TypeId, mem};

use crate::systems::DisplacedMeshes;

/// What has been told.
#[derive(Default)]
pub(super) struct Told {
    /// Of materials that have a vertex shader.
    types: HashSet<TypeId>,
    /// Which instances have changed since.
    until: Tick,
}

/// Whether any material may move meshes.
pub(super) fn are_possible(materials: Option<Res<ErasedRenderAssets<PreparedMaterial>>>) -> bool {
    let mut materials = materials.iter().flat_map(|it| it.iter());
    materials.any(|(_, material)| has_vertex_shader(&material.properties))
}

/// Tells the main world, where bounds are used.
pub(super) fn note_displaced_meshes(
    materials: Res<ErasedRenderAssets<PreparedMaterial>>,
    instances: Res<RenderMaterialInstances>,
    displaced: Res<DisplacedMeshes>,
    mut told: Local<Told>,
) {
    // Shaders belong to a material's type.
    let types = materials
        .iter()
        .filter(|(_, material)| has_vertex_shader(&material.properties))
        .map(|(id, _)| id.type_id())
        .collect();
    let changes = told.follow(types, &instances);
    if !changes.is_empty() {
        displaced.update(|known| {
            for (entity, is_displaced) in changes {
                if is_displaced {
                    known.insert(entity);
                } else {
                    known.remove(&entity);
                }
            }
        });
    }
}

impl Told {
    /// The meshes that may have come to be displaced, or not, and whether they are. Of what is out of sight there is
    /// no instance: it stays what it was.
    fn follow(
        &mut self,
        types: HashSet<TypeId>,
        instances: &RenderMaterialInstances,
    ) -> Vec<(Entity, bool)> {
        let until = mem::replace(&mut self.until, instances.current_change_tick);
        let are_same = types == self.types;
        self.types = types;
        if self.types.is_empty() {
            return Vec::new();
        }
        let is_old = |changed: Tick| changed.get().wrapping_sub(until.get()) > u32::MAX / 2;
        instances
            .instances
            .iter()
            .filter(|(_, instance)| !(are_same && is_old(instance.last_change_tick)))
            .map(|(entity, instance)| {
                let is_displaced = self.types.contains(&instance.asset_id.type_id());
                (entity.id(), is_displaced)
            })
            .collect()
    }
}

fn has_vertex_shader(properties: &MaterialProperties) -> bool {
    properties.get_shader(MaterialVertexShader).is_some()
        || properties.get_shader(PrepassVertexShader).is_some()
}

#[cfg(test)]
mod tests {
    use bevy::{
        asset::{AssetId, UntypedAssetId},
        image::Image,
        mesh::Mesh,
        pbr::RenderMaterialInstance,
    };

    use super::*;

    /// As Bevy extracts: what has changed has the tick, which goes on afterwards.
    fn extract(instances: &mut RenderMaterialInstances, changed: &[(Entity, UntypedAssetId)]) {
        let last_change_tick = instances.current_change_tick;
        for (entity, asset_id) in changed {
            let instance = RenderMaterialInstance {
                asset_id: *asset_id,
                last_change_tick,
            };
            instances.instances.insert((*entity).into(), instance);
        }
        let next = last_change_tick.get().wrapping_add(1);
        instances.current_change_tick.set(next);
    }

    #[test]
    fn only_what_has_changed_is_told_again() {
        let plain = AssetId::<Image>::default().untyped();
        let lifted = AssetId::<Mesh>::default().untyped();
        let [a, b, c] = [1, 2, 3].map(|index| Entity::from_raw_u32(index).expect("an index"));
        let types = HashSet::from_iter([lifted.type_id()]);
        let mut instances = RenderMaterialInstances::default();
        // Ticks go round.
        instances.current_change_tick.set(u32::MAX - 1);
        let mut told = Told::default();

        extract(&mut instances, &[(a, lifted), (b, plain)]);
        assert_eq!(told.follow(HashSet::default(), &instances), []);
        // The material comes late.
        extract(&mut instances, &[]);
        let mut all = told.follow(types.clone(), &instances);
        all.sort_by_key(|(_, is_displaced)| !is_displaced);
        assert_eq!(all, [(a, true), (b, false)]);
        extract(&mut instances, &[]);
        assert_eq!(told.follow(types.clone(), &instances), []);
        extract(&mut instances, &[(a, plain)]);
        assert_eq!(told.follow(types.clone(), &instances), [(a, false)]);
        extract(&mut instances, &[(c, lifted)]);
        assert_eq!(told.follow(types.clone(), &instances), [(c, true)]);
        extract(&mut instances, &[]);
        assert_eq!(told.follow(types, &instances), []);
    }
}
