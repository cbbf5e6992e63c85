//! Which meshes a vertex shader of their material's own moves.

use bevy::{
    ecs::system::Res,
    material::MaterialProperties,
    pbr::{MaterialVertexShader, PreparedMaterial, PrepassVertexShader, RenderMaterialInstances},
    platform::collections::HashSet,
    render::erased_render_asset::ErasedRenderAssets,
};
use core::any::TypeId;

use crate::systems::DisplacedMeshes;

/// Tells the main world, where bounds are used.
pub(super) fn note_displaced_meshes(
    materials: Res<ErasedRenderAssets<PreparedMaterial>>,
    instances: Res<RenderMaterialInstances>,
    displaced: Res<DisplacedMeshes>,
) {
    // Shaders belong to a material's type.
    let types: HashSet<TypeId> = materials
        .iter()
        .filter(|(_, material)| has_vertex_shader(&material.properties))
        .map(|(id, _)| id.type_id())
        .collect();
    if types.is_empty() {
        return;
    }
    // Of what is out of sight there is no instance: it stays what it was.
    displaced.update(|known| {
        for (entity, instance) in &instances.instances {
            if types.contains(&instance.asset_id.type_id()) {
                known.insert(entity.id());
            } else {
                known.remove(&entity.id());
            }
        }
    });
}

fn has_vertex_shader(properties: &MaterialProperties) -> bool {
    properties.get_shader(MaterialVertexShader).is_some()
        || properties.get_shader(PrepassVertexShader).is_some()
}
