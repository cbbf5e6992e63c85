//! Which meshes a vertex shader of their material's own moves.

use bevy::{
    ecs::{
        change_detection::{DetectChanges, Tick},
        entity::Entity,
        resource::Resource,
        system::{Res, ResMut},
    },
    material::MaterialProperties,
    pbr::{MaterialVertexShader, PreparedMaterial, PrepassVertexShader, RenderMaterialInstances},
    platform::collections::HashMap,
    render::erased_render_asset::ErasedRenderAssets,
};
use core::{any::TypeId, mem};

use crate::systems::DisplacedMeshes;

/// Which types of materials move meshes, and what has been told.
#[derive(Resource, Default)]
pub(super) struct DisplacingTypes {
    /// Of all that have been there: whether their vertex shader is their own.
    known: HashMap<TypeId, bool>,
    /// Whether there is any of those that do.
    are_there: bool,
    /// Whether a type has come of which meshes have not been told.
    is_any_new: bool,
    /// Which instances have changed since.
    until: Tick,
}

/// Whether any material may move meshes, or may have begun or ceased to.
pub(super) fn are_possible(
    materials: Option<Res<ErasedRenderAssets<PreparedMaterial>>>,
    types: Res<DisplacingTypes>,
) -> bool {
    types.are_there || materials.is_some_and(|materials| materials.is_changed())
}

/// Tells the main world, where bounds are used.
pub(super) fn note_displaced_meshes(
    materials: Res<ErasedRenderAssets<PreparedMaterial>>,
    instances: Res<RenderMaterialInstances>,
    displaced: Res<DisplacedMeshes>,
    mut types: ResMut<DisplacingTypes>,
) {
    if materials.is_changed() {
        let had_any = types.are_there;
        let materials = materials.iter();
        types.follow(materials.map(|(id, material)| (id.type_id(), &*material.properties)));
        if had_any && !types.are_there {
            // Of what is out of sight there are no instances to tell of.
            displaced.update(|known| known.clear());
        }
    }
    let changes = types.changes(&instances);
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

impl DisplacingTypes {
    /// Takes in which materials there are. Shaders belong to a material's type.
    fn follow<'a>(&mut self, materials: impl Iterator<Item = (TypeId, &'a MaterialProperties)>) {
        let were_there = mem::take(&mut self.are_there);
        for (id, properties) in materials {
            self.are_there |= *self.known.entry(id).or_insert_with(|| {
                let displaces = has_vertex_shader(properties);
                self.is_any_new |= displaces;
                displaces
            });
        }
        self.is_any_new |= self.are_there && !were_there;
    }

    /// The meshes that may have come to be displaced, or not, and whether they are. Of what is out of sight there is
    /// no instance: it stays what it was.
    fn changes(&mut self, instances: &RenderMaterialInstances) -> Vec<(Entity, bool)> {
        let until = mem::replace(&mut self.until, instances.current_change_tick);
        let is_any_new = mem::take(&mut self.is_any_new);
        if !self.are_there {
            return Vec::new();
        }
        let is_old = |changed: Tick| changed.get().wrapping_sub(until.get()) > u32::MAX / 2;
        instances
            .instances
            .iter()
            .filter(|(_, instance)| is_any_new || !is_old(instance.last_change_tick))
            .map(|(entity, instance)| {
                let id = instance.asset_id.type_id();
                let is_displaced = self.known.get(&id).is_some_and(|displaces| *displaces);
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
        asset::{AssetId, Handle, UntypedAssetId},
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
        let own = MaterialProperties::default();
        let mut moves = MaterialProperties::default();
        moves.add_shader(MaterialVertexShader, Handle::default());
        let only_plain = || [(plain.type_id(), &own)].into_iter();
        let both = || only_plain().chain([(lifted.type_id(), &moves)]);
        let mut instances = RenderMaterialInstances::default();
        // Ticks go round.
        instances.current_change_tick.set(u32::MAX - 1);
        let mut told = DisplacingTypes::default();

        extract(&mut instances, &[(a, lifted), (b, plain)]);
        told.follow(only_plain());
        assert_eq!(told.changes(&instances), []);
        // The material comes late.
        extract(&mut instances, &[]);
        told.follow(both());
        let mut all = told.changes(&instances);
        all.sort_by_key(|(_, is_displaced)| !is_displaced);
        assert_eq!(all, [(a, true), (b, false)]);
        extract(&mut instances, &[]);
        assert_eq!(told.changes(&instances), []);
        extract(&mut instances, &[(a, plain)]);
        assert_eq!(told.changes(&instances), [(a, false)]);
        extract(&mut instances, &[(c, lifted)]);
        assert_eq!(told.changes(&instances), [(c, true)]);
        extract(&mut instances, &[]);
        assert_eq!(told.changes(&instances), []);
        // It goes, and comes back late.
        told.follow(only_plain());
        extract(&mut instances, &[(a, lifted)]);
        assert_eq!(told.changes(&instances), []);
        extract(&mut instances, &[]);
        told.follow(both());
        let again = told.changes(&instances);
        assert!(again.contains(&(a, true)), "{again:?}");
    }
}
