//! Casters whose shape the GPU makes: they go through Bevy's caster phases, as always.

use bevy::{
    mesh::{
        VertexAttributeValues,
        morph::{MeshMorphWeights, MorphAttributes},
        skinning::{SkinnedMesh, SkinnedMeshInverseBindposes},
    },
    prelude::*,
};

use crate::{drop_in::assert_right, stage::Stage};

#[test]
fn alpha_masked() {
    let mut stage = Stage::new();
    let sun = stage.sun();
    stage.clear_casters();
    let mesh = stage
        .world()
        .resource_mut::<Assets<Mesh>>()
        .add(Rectangle::new(6.0, 4.0));
    let mask = stage.checkered_mask();
    let material = stage
        .world()
        .resource_mut::<Assets<StandardMaterial>>()
        .add(StandardMaterial {
            base_color_texture: Some(mask),
            alpha_mode: AlphaMode::Mask(0.5),
            cull_mode: None,
            double_sided: true,
            ..default()
        });
    stage.world().spawn((
        Mesh3d(mesh),
        MeshMaterial3d(material),
        Transform::from_xyz(0.0, 2.5, 0.0).looking_to(Vec3::new(1.0, -0.3, -0.8), Vec3::Y),
    ));
    assert_right("alpha_mask", &mut stage, sun);
}

/// A post, standing on the ground.
fn post() -> Mesh {
    let post = Cuboid::new(0.6, 5.0, 0.6).mesh().build();
    post.translated_by(Vec3::Y * 2.5)
}

fn positions(mesh: &Mesh) -> Vec<Vec3> {
    match mesh.attribute(Mesh::ATTRIBUTE_POSITION) {
        Some(VertexAttributeValues::Float32x3(list)) => {
            list.iter().map(|p| Vec3::from_array(*p)).collect()
        }
        _ => panic!("a mesh has positions"),
    }
}

/// A stage with nothing but ground and the mesh in two places.
fn stage_with(mesh: Mesh, extra: impl Fn(&mut World, Entity)) -> Stage {
    let mut stage = Stage::new();
    stage.clear_casters();
    let mesh = stage.world().resource_mut::<Assets<Mesh>>().add(mesh);
    let material = stage
        .world()
        .resource_mut::<Assets<StandardMaterial>>()
        .add(StandardMaterial::default());
    for place in [Vec3::new(0.5, 0.0, 2.0), Vec3::new(-1.0, 0.0, -14.0)] {
        let caster = (
            Mesh3d(mesh.clone()),
            MeshMaterial3d(material.clone()),
            Transform::from_translation(place),
        );
        let caster = stage.world().spawn(caster).id();
        extra(stage.world(), caster);
    }
    stage
}

#[test]
fn morphed() {
    let post = post();
    // The upper end is moved aside.
    let targets = positions(&post)
        .into_iter()
        .map(|p| MorphAttributes::new(Vec3::X * 0.6 * p.y, Vec3::ZERO, Vec3::ZERO))
        .collect();
    let mut stage = stage_with(post.with_morph_targets(targets), |world, caster| {
        let weights = vec![1.0];
        world
            .entity_mut(caster)
            .insert(MeshMorphWeights::Value { weights });
    });
    let sun = stage.sun();
    assert_right("morphed", &mut stage, sun);
}

#[test]
fn skinned() {
    let post = post();
    let upper: Vec<bool> = positions(&post).iter().map(|p| p.y > 2.5).collect();
    let joints = upper.iter().map(|up| [u16::from(*up), 0, 0, 0]).collect();
    let post = post
        .with_inserted_attribute(
            Mesh::ATTRIBUTE_JOINT_INDEX,
            VertexAttributeValues::Uint16x4(joints),
        )
        .with_inserted_attribute(
            Mesh::ATTRIBUTE_JOINT_WEIGHT,
            vec![[1.0, 0.0, 0.0, 0.0]; upper.len()],
        );
    let mut stage = stage_with(post, |world, caster| {
        let inverse_bindposes = world
            .resource_mut::<Assets<SkinnedMeshInverseBindposes>>()
            .add(vec![Mat4::IDENTITY; 2]);
        // The second joint bends the post.
        let bent = Transform::from_rotation(Quat::from_rotation_z(-0.6));
        let joints = [Transform::IDENTITY, bent].map(|joint| world.spawn(joint).id());
        world
            .entity_mut(caster)
            .add_children(&joints)
            .insert(SkinnedMesh {
                inverse_bindposes,
                joints: joints.to_vec(),
            });
    });
    let sun = stage.sun();
    assert_right("skinned", &mut stage, sun);
}
