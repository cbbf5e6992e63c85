//! Casters whose shape the GPU makes: they go through Bevy's caster phases, as always.

use bevy::{
    camera::visibility::VisibilityRange,
    mesh::{
        VertexAttributeValues,
        morph::{MeshMorphWeights, MorphAttributes},
        skinning::{SkinnedMesh, SkinnedMeshInverseBindposes},
    },
    prelude::*,
};

use bevy_pssm::prelude::*;
use image::RgbaImage;

use crate::{
    compare::assert_identical,
    drop_in::assert_right,
    stage::{Stage, shadows},
};

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

/// A post whose upper end is moved aside as its weight says.
fn morphing_post() -> Mesh {
    let post = post();
    let targets = positions(&post)
        .into_iter()
        .map(|p| MorphAttributes::new(Vec3::X * 0.6 * p.y, Vec3::ZERO, Vec3::ZERO))
        .collect();
    post.with_morph_targets(targets)
}

#[test]
fn morphed() {
    let mut stage = stage_with(morphing_post(), |world, caster| {
        let weights = vec![1.0];
        world
            .entity_mut(caster)
            .insert(MeshMorphWeights::Value { weights });
    });
    let sun = stage.sun();
    assert_right("morphed", &mut stage, sun);
}

/// A post of two joints.
fn jointed_post() -> Mesh {
    let post = post();
    let upper: Vec<bool> = positions(&post).iter().map(|p| p.y > 2.5).collect();
    let joints = upper.iter().map(|up| [u16::from(*up), 0, 0, 0]).collect();
    post.with_inserted_attribute(
        Mesh::ATTRIBUTE_JOINT_INDEX,
        VertexAttributeValues::Uint16x4(joints),
    )
    .with_inserted_attribute(
        Mesh::ATTRIBUTE_JOINT_WEIGHT,
        vec![[1.0, 0.0, 0.0, 0.0]; upper.len()],
    )
}

/// Gives a jointed post its joints, and bends it. The upper joint.
fn bend(world: &mut World, caster: Entity) -> Entity {
    let inverse_bindposes = world
        .resource_mut::<Assets<SkinnedMeshInverseBindposes>>()
        .add(vec![Mat4::IDENTITY; 2]);
    let bent = Transform::from_rotation(Quat::from_rotation_z(-0.6));
    let joints = [Transform::IDENTITY, bent].map(|joint| world.spawn(joint).id());
    world
        .entity_mut(caster)
        .add_children(&joints)
        .insert(SkinnedMesh {
            inverse_bindposes,
            joints: joints.to_vec(),
        });
    joints[1]
}

#[test]
fn skinned() {
    let mut stage = stage_with(jointed_post(), |world, caster| {
        bend(world, caster);
    });
    let sun = stage.sun();
    assert_right("skinned", &mut stage, sun);
}

/// A walk past posts that are bent, morphed and replaced by other levels of detail, now and then and for a while.
fn walk_past_posts(updates: MapUpdates, of_casters: ShadowUpdates) -> Vec<RgbaImage> {
    let mut stage = Stage::new();
    stage.clear_casters();
    let sun = stage.sun();
    let comparison = Comparison {
        updates,
        ..default()
    };
    let config = ParallelSplitShadows {
        comparison,
        ..shadows()
    };
    stage.world().entity_mut(sun).insert(config);
    let camera = stage.camera();
    let world = stage.world();
    let material = world
        .resource_mut::<Assets<StandardMaterial>>()
        .add(StandardMaterial::default());
    let mut spawn = |mesh: Mesh, place: Vec3| {
        let mesh = Mesh3d(world.resource_mut::<Assets<Mesh>>().add(mesh));
        let place = Transform::from_translation(place);
        let caster = (mesh, MeshMaterial3d(material.clone()), place, of_casters);
        world.spawn(caster).id()
    };
    let morphed = [Vec3::new(1.0, 0.0, 2.0), Vec3::new(-3.0, 0.0, -9.0)]
        .map(|place| spawn(morphing_post(), place));
    let skinned = [Vec3::new(-1.5, 0.0, 1.0), Vec3::new(2.0, 0.0, -12.0)]
        .map(|place| spawn(jointed_post(), place));
    let levels: Vec<_> = [-3.0, -4.5]
        .into_iter()
        .enumerate()
        .flat_map(|(index, z)| {
            let place = Vec3::new(1.5 - 3.0 * index as f32, 0.0, z);
            let near = spawn(post(), place);
            let far = spawn(post().scaled_by(Vec3::new(2.0, 0.5, 2.0)), place);
            let fade = index as f32;
            let ranges = [0.0..0.0, 11.5..11.5 + fade, 500.0..500.0];
            let levels = [(near, 0), (far, 1)];
            levels.map(|(level, at)| {
                let range = VisibilityRange {
                    start_margin: ranges[at].clone(),
                    end_margin: ranges[at + 1].clone(),
                    use_aabb: false,
                };
                (level, range)
            })
        })
        .collect();
    for (level, range) in levels {
        world.entity_mut(level).insert(range);
    }
    for caster in morphed {
        let weights = vec![0.0];
        let mut caster = world.entity_mut(caster);
        caster.insert(MeshMorphWeights::Value { weights });
    }
    let joints = skinned.map(|caster| bend(world, caster));
    stage.headless.settle();
    for _ in 0..4 {
        stage.step();
    }
    let frames = (0..50).map(|frame| {
        let world = stage.world();
        let mut eye = world.get_mut::<Transform>(camera).expect("a camera");
        eye.translation.z -= if frame < 35 { 0.1 } else { -0.15 };
        // Once, and again and again.
        if [4, 9].contains(&frame) || (20..30).contains(&frame) {
            for (index, joint) in joints.into_iter().enumerate() {
                let by = 0.1 * (index as f32 + 1.0);
                let mut joint = world.get_mut::<Transform>(joint).expect("a joint");
                joint.rotate_z(by);
            }
        }
        if [6, 9].contains(&frame) || (24..34).contains(&frame) {
            for caster in morphed {
                let mut weights = world.get_mut::<MeshMorphWeights>(caster).expect("weights");
                if let MeshMorphWeights::Value { weights } = &mut *weights {
                    weights[0] += 0.1;
                }
            }
        }
        stage.step();
        stage.last_picture()
    });
    frames.collect()
}

#[test]
fn held_maps_follow_poses_and_levels_of_detail() {
    let anew = walk_past_posts(MapUpdates::EveryFrame, ShadowUpdates::Automatic);
    let held = walk_past_posts(MapUpdates::WhenNeeded, ShadowUpdates::Automatic);
    for (frame, (held, anew)) in held.iter().zip(&anew).enumerate() {
        assert_identical(&format!("posed_{frame}"), held, anew);
    }
    // Were they missed, pictures would tell.
    let missed = walk_past_posts(MapUpdates::WhenNeeded, ShadowUpdates::Never);
    let differ = missed.iter().zip(&anew).filter(|(a, b)| a != b).count();
    assert!(differ > 20, "{differ}");
}
