//! Maps are drawn when they have to be, and held pictures are those of maps drawn anew.

use bevy::{
    asset::{RenderAssetUsages, uuid_handle},
    camera::visibility::{NoCpuCulling, RenderLayers},
    core_pipeline::schedule::RootNonCameraView,
    diagnostic::{DiagnosticPath, DiagnosticsStore},
    ecs::entity_disabling::Disabled,
    light::NotShadowCaster,
    pbr::{ExtendedMaterial, LightEntity, MaterialExtension, MaterialPlugin, ViewLightEntities},
    prelude::*,
    reflect::TypePath,
    render::{
        Render, RenderApp, RenderSystems, camera::DirtySpecializations,
        render_resource::AsBindGroup, view::ExtractedView,
    },
    shader::ShaderRef,
};
use bevy_pssm::{
    MAPS_ADDED_TO, MAPS_DRAWN, MAPS_DRAWN_UNPLANNED, MAPS_HELD, ShadowPlans, prelude::*,
    render::AdoptedMap,
};
use image::RgbaImage;

use crate::{
    compare::assert_identical,
    stage::{Dice, Stage, eye, shadows},
};

fn stage(config: ParallelSplitShadows) -> (Stage, Entity) {
    let mut stage = Stage::new();
    let sun = stage.sun();
    stage.world().entity_mut(sun).insert(config);
    stage.camera();
    note_drawn(&mut stage);
    stage.headless.settle();
    // Until maps are known to be whole.
    for _ in 0..4 {
        stage.step();
    }
    (stage, sun)
}

fn note_drawn(stage: &mut Stage) {
    let render_app = stage.headless.app.sub_app_mut(RenderApp);
    render_app
        .init_resource::<DrawnViews>()
        .add_systems(Render, note_drawn_views.in_set(RenderSystems::Prepare));
}

/// The views that the last frame drew, in order: whether they are maps' own, and of which light's cascade.
#[derive(Resource, Default)]
struct DrawnViews(Vec<(bool, (Entity, usize))>);

fn note_drawn_views(
    roots: Query<(Entity, Option<&ViewLightEntities>), With<RootNonCameraView>>,
    views: Query<(&LightEntity, Has<AdoptedMap>), With<ExtractedView>>,
    mut drawn: ResMut<DrawnViews>,
) {
    drawn.0.clear();
    // None of an earlier frame is left.
    let of_maps = roots.iter().filter(|(_, lights)| lights.is_some());
    assert!(of_maps.count() <= 1);
    for (root, lights) in &roots {
        // None is drawn twice.
        assert!(views.get(root).is_err(), "{root} is a map's view");
        let views = views.iter_many(lights.iter().flat_map(|it| &it.lights));
        drawn
            .0
            .extend(views.flatten().filter_map(|(light, is_own)| {
                let LightEntity::Directional {
                    light_entity,
                    cascade_index,
                } = *light
                else {
                    return None;
                };
                Some((is_own, (light_entity, cascade_index)))
            }));
    }
}

fn drawn_views(stage: &Stage) -> &[(bool, (Entity, usize))] {
    let world = stage.headless.app.sub_app(RenderApp).world();
    &world.resource::<DrawnViews>().0
}

/// How many maps of what rests the last frame drew.
fn drawn(stage: &mut Stage) -> usize {
    let own = drawn_views(stage).iter().filter(|(is_own, _)| *is_own);
    own.count()
}

/// Into how many that were held it drew something.
fn drawn_over(stage: &mut Stage) -> usize {
    let mut before = None;
    let over = drawn_views(stage).iter().filter(|(is_own, map)| {
        let is_first = before.replace(*map) != Some(*map);
        is_first && !is_own
    });
    over.count()
}

fn blocks(stage: &mut Stage) -> Vec<Entity> {
    let mut casters = stage
        .world()
        .query_filtered::<(Entity, &Transform), (With<Mesh3d>, Without<Camera3d>)>();
    let casters = casters.iter(stage.headless.app.world());
    let mut blocks: Vec<_> = casters.filter(|(_, at)| at.translation.y > 0.0).collect();
    blocks.sort_by(|a, b| a.1.translation.z.total_cmp(&b.1.translation.z));
    blocks.into_iter().map(|(entity, _)| entity).collect()
}

#[test]
fn at_rest_nothing_is_drawn_and_what_changes_is() {
    let (mut stage, sun) = stage(shadows());
    let store = stage.world().resource::<DiagnosticsStore>();
    let count = |path: &DiagnosticPath| store.get_measurement(path).map(|it| it.value);
    assert_eq!(count(&MAPS_DRAWN), Some(0.0));
    assert!(count(&MAPS_HELD) >= Some(3.0));
    let mut cost = |change: &dyn Fn(&mut World)| {
        change(stage.world());
        stage.step();
        let first = drawn(&mut stage);
        let later = (0..5).map(|_| {
            stage.step();
            drawn(&mut stage)
        });
        (first, later.sum::<usize>())
    };
    assert_eq!(cost(&|_| ()), (0, 0));
    // Written, and the same.
    assert_eq!(
        cost(&|world| {
            let mut all = world.query::<&mut Transform>();
            all.iter_mut(world).for_each(|mut it| it.set_changed());
        }),
        (0, 0)
    );
    let turn = |world: &mut World| {
        let mut sun = world.get_mut::<Transform>(sun).expect("a sun");
        sun.rotate_y(0.1);
    };
    let (first, later) = cost(&turn);
    assert!(first >= 3 && later == 0, "{first} then {later}");
    let nudge = |world: &mut World| {
        let mut cameras = world.query_filtered::<&mut Transform, With<Camera3d>>();
        for mut camera in cameras.iter_mut(world) {
            camera.translation.x += 0.01;
        }
    };
    let (first, later) = cost(&nudge);
    assert!(first <= 1 && later == 0, "{first} then {later}");
}

/// An edit of a material is known to the renderer only, which draws maps that plans hold.
#[test]
fn maps_drawn_for_edits_are_counted() {
    let (mut stage, sun) = stage(shadows());
    let caster = blocks(&mut stage)[0];
    let mut step = || {
        stage.step();
        let world = stage.world();
        let store = world.resource::<DiagnosticsStore>();
        let count = |path: &DiagnosticPath| store.get_measurement(path).map(|it| it.value);
        let [drawn, held, unplanned] = [&MAPS_DRAWN, &MAPS_HELD, &MAPS_DRAWN_UNPLANNED].map(count);
        let counts = world.get::<ShadowPlans>(sun).expect("plans").counts();
        assert_eq!(
            (Some(counts.drawn as f64), Some(counts.held as f64)),
            (drawn, held)
        );
        assert!(counts.drawn == 0 && counts.added_to == 0 && counts.held >= 3);
        if unplanned == Some(0.0) {
            let material = world.get::<MeshMaterial3d<StandardMaterial>>(caster);
            let material = material.expect("a material").0.clone();
            let mut materials = world.resource_mut::<Assets<StandardMaterial>>();
            materials.get_mut(&material).expect("one").emissive.red += 0.01;
        }
        unplanned
    };
    // Edited after the first; drawn in the second, which the third tells of.
    assert_eq!([step(), step()], [Some(0.0); 2]);
    assert!(step() >= Some(1.0));
}

/// What a game does to one of its casters in a frame. Bevy 0.20 draws triangles of other meshes, in all passes, once
/// several mesh assets have changed in one frame, and panics over an entity binned twice where several casters changed who
/// culls them, without the plugin's maps too: only the first change of a frame may be either.
fn change_something(world: &mut World, casters: &mut Vec<Entity>, is_first: bool, dice: &mut Dice) {
    let index = dice.pick(casters.len());
    let caster = casters[index];
    let mut entity = world.entity_mut(caster);
    match dice.pick(13) {
        0 => {
            let by = Vec3::new(dice.roll() - 0.5, 0.0, dice.roll() - 0.5);
            entity.get_mut::<Transform>().expect("one").translation += by;
        }
        1 => {
            let is_hidden = entity.get::<Visibility>() == Some(&Visibility::Hidden);
            entity.insert(if is_hidden {
                Visibility::Inherited
            } else {
                Visibility::Hidden
            });
        }
        2 if entity.contains::<NotShadowCaster>() => {
            entity.remove::<NotShadowCaster>();
        }
        2 => {
            entity.insert(NotShadowCaster);
        }
        3 if entity.contains::<RenderLayers>() => {
            entity.remove::<RenderLayers>();
        }
        3 => {
            entity.insert(RenderLayers::from_layers(&[0, 3]));
        }
        4 => {
            let other = casters[dice.pick(casters.len())];
            let mesh = world.get::<Mesh3d>(other).expect("a mesh").clone();
            world.entity_mut(caster).insert(mesh);
        }
        5 => {
            let at = Transform::from_xyz(8.0 * dice.roll() - 4.0, 1.5, 10.0 * dice.roll() - 8.0);
            let (mesh, material) = (
                entity.get::<Mesh3d>().expect("a mesh").clone(),
                entity
                    .get::<MeshMaterial3d<StandardMaterial>>()
                    .expect("a material")
                    .clone(),
            );
            casters.push(world.spawn((mesh, material, at)).id());
        }
        6 if casters.len() > 8 => {
            world.entity_mut(caster).despawn();
            casters.remove(index);
        }
        7 => {
            let material = entity
                .get::<MeshMaterial3d<StandardMaterial>>()
                .expect("one")
                .0
                .clone();
            let mut materials = world.resource_mut::<Assets<StandardMaterial>>();
            if let Some(mut material) = materials.get_mut(&material) {
                material.alpha_mode = match material.alpha_mode {
                    AlphaMode::Opaque => AlphaMode::Mask(0.5),
                    _ => AlphaMode::Opaque,
                };
                material.base_color.set_alpha(dice.roll());
            }
        }
        8 if is_first => {
            let mesh = entity.get::<Mesh3d>().expect("a mesh").0.clone();
            let mut meshes = world.resource_mut::<Assets<Mesh>>();
            if let Some(mut mesh) = meshes.get_mut(&mesh) {
                let by = Vec3::splat(0.8 + 0.4 * dice.roll());
                mesh.scale_by(by);
            }
        }
        9 if is_first && entity.contains::<NoCpuCulling>() => {
            entity.remove::<NoCpuCulling>();
        }
        9 if is_first => {
            entity.insert(NoCpuCulling);
        }
        10 if entity.contains::<Disabled>() => {
            entity.remove::<Disabled>();
        }
        10 => {
            entity.insert(Disabled);
        }
        11 => {
            let other = casters[dice.pick(casters.len())];
            let material = world.get::<MeshMaterial3d<StandardMaterial>>(other);
            let material = material.expect("a material").clone();
            world.entity_mut(caster).insert(material);
        }
        _ => {
            entity
                .get_mut::<Transform>()
                .expect("one")
                .rotate_y(dice.roll());
        }
    }
}

/// A walk with a turn and a cut, during which casters change now and then, so many at once. What happens to the `ignored`
/// one is to be missed.
fn walk(
    updates: MapUpdates,
    fit: CascadeFit,
    (frames, at_once): (usize, usize),
    ignored: Option<usize>,
) -> (Vec<RgbaImage>, usize) {
    let config = ParallelSplitShadows {
        fit,
        comparison: Comparison {
            updates,
            ..default()
        },
        ..shadows()
    };
    let (mut stage, sun) = stage(config);
    let mut casters = blocks(&mut stage);
    let mover = stage.world().entity_mut(casters[3]).clone_and_spawn();
    if let Some(ignored) = ignored {
        let ignored = [mover, casters[3]][ignored];
        stage
            .world()
            .entity_mut(ignored)
            .insert(ShadowUpdates::Never);
    }
    let mut dice = Dice(7);
    let mut total = 0;
    let mut pictures = Vec::new();
    for frame in 0..frames {
        let world = stage.world();
        let mut cameras = world.query_filtered::<&mut Transform, With<Camera3d>>();
        for mut camera in cameras.iter_mut(world) {
            match frame % 60 {
                0..20 => camera.translation.z -= 0.1,
                20..30 => camera.rotate_y(0.02),
                45 => *camera = eye(),
                _ => (),
            }
        }
        // Shadows are off for a while.
        if let Some(mut light) = world.get_mut::<DirectionalLight>(sun) {
            light.shadow_maps_enabled = !(48..52).contains(&(frame % 60));
        }
        let changes = if frame % 3 == 0 { at_once } else { 0 };
        for change in 0..changes {
            change_something(world, &mut casters, change == 0, &mut dice);
        }
        if frame % 240 < 120 {
            let place = Vec3::new(0.0, 3.0, -4.0)
                + 3.0 * Quat::from_rotation_y(0.1 * frame as f32).mul_vec3(Vec3::X);
            *world.get_mut::<Transform>(mover).expect("one") = Transform::from_translation(place);
        }
        stage.step();
        total += drawn(&mut stage);
        pictures.push(stage.last_picture());
    }
    (pictures, total)
}

/// `PSSM_HOLD_FRAMES` says how many frames each walk has, `PSSM_HOLD_CHANGES` how many casters change in every third.
#[test]
fn held_pictures_are_those_of_maps_drawn_anew() {
    let count = |name: &str, usual: usize| {
        let count = std::env::var(name).ok();
        count.map_or(usual, |count| count.parse().expect("a number"))
    };
    let (frames, changes) = (count("PSSM_HOLD_FRAMES", 60), count("PSSM_HOLD_CHANGES", 1));
    for (name, fit, most) in [
        ("steady", CascadeFit::Steady, 0.3),
        ("stable", CascadeFit::Stable, 0.55),
        ("tight", CascadeFit::Tight, 0.4),
        ("warped", CascadeFit::Warped(MapWarp::Minimax), 0.8),
    ] {
        let extent = (frames, changes);
        let (anew, every) = walk(MapUpdates::EveryFrame, fit.clone(), extent, None);
        let (held, needed) = walk(MapUpdates::WhenNeeded, fit, extent, None);
        for (frame, (held, anew)) in held.iter().zip(&anew).enumerate() {
            if held != anew {
                assert_identical(&format!("held_{name}_{frame}"), held, anew);
            }
        }
        let share = needed as f64 / every as f64;
        assert!(
            changes > 1 || share < most,
            "{name}: {needed} of {every} maps drawn"
        );
    }
}

/// A change that is missed is seen in pictures: those above would differ.
#[test]
fn a_missed_change_is_found() {
    let walk = |updates, ignored| walk(updates, CascadeFit::Steady, (20, 0), ignored).0;
    let anew = walk(MapUpdates::EveryFrame, Some(0));
    assert!(walk(MapUpdates::WhenNeeded, Some(0)) != anew);
    assert!(walk(MapUpdates::WhenNeeded, Some(1)) == anew, "it rests");
}

/// A turn on the spot among blocks, some of which may move, and in each frame: maps drawn anew, second views drawn,
/// and maps that count as added to.
fn turn(updates: MapUpdates, is_any_moving: bool) -> Vec<(RgbaImage, [usize; 3])> {
    let comparison = Comparison {
        updates,
        ..default()
    };
    let (mut stage, _) = stage(ParallelSplitShadows {
        comparison,
        ..shadows()
    });
    let block = blocks(&mut stage)[0];
    let mut movers = Vec::new();
    let center = eye().translation.with_y(1.0);
    for step in 0..120 {
        let turn = Quat::from_rotation_y(0.3 * step as f32);
        let at = center + turn * Vec3::X * (4.0 + 0.4 * step as f32);
        let copy = stage.world().entity_mut(block).clone_and_spawn();
        let mut copy = stage.world().entity_mut(copy);
        copy.insert(Transform::from_translation(at));
    }
    // Before the camera, wherever it looks.
    let distances = [3.0, 5.0, 9.0, 14.0, 22.0, 35.0, 60.0];
    for distance in distances.into_iter().filter(|_| is_any_moving) {
        let copy = stage.world().entity_mut(block).clone_and_spawn();
        movers.push((copy, distance));
    }
    for _ in 0..4 {
        stage.step();
    }
    let frames = (0..60).map(|frame| {
        let world = stage.world();
        let mut cameras = world.query_filtered::<&mut Transform, With<Camera3d>>();
        for mut camera in cameras.iter_mut(world) {
            camera.rotate_y(1.5_f32.to_radians());
        }
        for (mover, distance) in &movers {
            let turn = Quat::from_rotation_y((1.5 * frame as f32 + 90.0 / distance).to_radians());
            let at = center + turn * Vec3::NEG_Z * *distance;
            *world.get_mut::<Transform>(*mover).expect("one") = Transform::from_translation(at);
        }
        stage.step();
        let store = stage.world().resource::<DiagnosticsStore>();
        let added_to = store.get_measurement(&MAPS_ADDED_TO).map(|it| it.value);
        let added_to = added_to.expect("a count") as usize;
        let counts = [drawn(&mut stage), drawn_over(&mut stage), added_to];
        (stage.last_picture(), counts)
    });
    frames.collect()
}

/// What a map comes to need is drawn over what it holds, under what moves.
#[test]
fn what_is_added_is_drawn_over_what_is_held() {
    for is_any_moving in [false, true] {
        let anew = turn(MapUpdates::EveryFrame, is_any_moving);
        let held = turn(MapUpdates::WhenNeeded, is_any_moving);
        let mut totals = [0; 3];
        for (frame, ((held, counts), (anew, of_anew))) in held.iter().zip(&anew).enumerate() {
            if held != anew {
                assert_identical(&format!("added_{is_any_moving}_{frame}"), held, anew);
            }
            for (total, count) in totals.iter_mut().zip(counts) {
                *total += count;
            }
            assert_eq!(of_anew[2], 0);
        }
        let [anew, over, added_to] = totals;
        assert!(anew < 60 && over > 10 && added_to > 10, "{totals:?}");
        // Maps may come to be for more, and there is none to add.
        assert!(is_any_moving || added_to >= over, "{totals:?}");
    }
}

#[test]
fn games_overrule_what_changes() {
    let (mut stage, _) = stage(shadows());
    let caster = blocks(&mut stage)[0];
    let mut frame = |change: &dyn Fn(&mut EntityWorldMut)| {
        change(&mut stage.world().entity_mut(caster));
        stage.step();
        [drawn(&mut stage), drawn_over(&mut stage)]
    };
    let set = |it: &mut EntityWorldMut, updates: Option<ShadowUpdates>| {
        match updates {
            Some(updates) => it.insert(updates),
            None => it.remove::<ShadowUpdates>(),
        };
    };
    assert_eq!(frame(&|_| ()), [0, 0]);
    assert!(frame(&|it| set(it, Some(ShadowUpdates::Always)))[0] > 0);
    assert!(frame(&|_| ())[1] > 0);
    // It rests again.
    let [anew, over] = frame(&|it| set(it, Some(ShadowUpdates::Never)));
    assert!(anew == 0 && over > 0);
    frame(&|_| ());
    let move_it = |it: &mut EntityWorldMut| {
        it.get_mut::<Transform>().expect("one").translation.x += 1.0;
    };
    assert_eq!(frame(&move_it), [0, 0]);
    // Maps show it where it was.
    assert!(frame(&|it| set(it, None))[0] > 0);
    assert_eq!(frame(&|_| ()), [0, 0]);
    assert!(frame(&move_it)[0] > 0);
}

#[test]
fn what_moves_is_drawn_over_what_rests() {
    let (mut stage, _) = stage(shadows());
    let caster = blocks(&mut stage)[0];
    let frame = |stage: &mut Stage, by: f32| {
        let mut at = stage.world().get_mut::<Transform>(caster).expect("one");
        at.translation.x += by;
        stage.step();
        [drawn(stage), drawn_over(stage)]
    };
    // What rests is drawn without it, once.
    assert!(frame(&mut stage, 0.05)[0] > 0);
    for _ in 0..30 {
        let [resting, moving] = frame(&mut stage, 0.05);
        assert!(resting == 0 && moving > 0, "{resting} {moving}");
    }
    // Views of what moves are made anew in each frame, but not which pipelines draw it.
    let dirty = stage.render_world().resource::<DirtySpecializations>();
    assert!(dirty.views.is_empty(), "{:?}", dirty.views);
    let later: Vec<_> = (0..240).map(|_| frame(&mut stage, 0.0)).collect();
    let resting = later.iter().filter(|[resting, _]| *resting > 0).count();
    assert_eq!(resting, 1, "what rests is drawn into the map itself, once");
    assert_eq!(later.last(), Some(&[0, 0]));
}

/// A material with a mask, and that.
fn masked(stage: &mut Stage) -> (MeshMaterial3d<StandardMaterial>, Handle<Image>) {
    let mask = stage.checkered_mask();
    let material = StandardMaterial {
        base_color_texture: Some(mask.clone()),
        alpha_mode: AlphaMode::Mask(0.5),
        ..default()
    };
    let mut materials = stage.world().resource_mut::<Assets<StandardMaterial>>();
    (MeshMaterial3d(materials.add(material)), mask)
}

#[test]
fn a_mask_that_changes_is_drawn_anew() {
    let (mut stage, _) = stage(shadows());
    let caster = blocks(&mut stage)[0];
    let (masked, mask) = masked(&mut stage);
    stage.world().entity_mut(caster).insert(masked);
    stage.headless.settle();
    for _ in 0..4 {
        stage.step();
    }
    assert_eq!(drawn(&mut stage), 0);
    let touch = |stage: &mut Stage, image: &Handle<Image>| {
        stage
            .world()
            .resource_mut::<Assets<Image>>()
            .get_mut(image)
            .expect("an image")
            .asset_usage = RenderAssetUsages::all();
        stage.step();
        drawn(stage)
    };
    let other = stage.checkered_mask();
    stage.step();
    assert_eq!(touch(&mut stage, &other), 0);
    assert!(touch(&mut stage, &mask) > 0);
}

/// A mask of what casts no shadow has nothing drawn.
#[test]
fn what_changes_and_casts_no_shadow_has_nothing_drawn() {
    let (mut stage, _) = stage(shadows());
    let panel = blocks(&mut stage)[0];
    let (masked, mask) = masked(&mut stage);
    let mut panel = stage.world().entity_mut(panel);
    panel.insert((masked, NotShadowCaster));
    stage.headless.settle();
    for _ in 0..4 {
        stage.step();
    }
    for frame in 0..5 {
        let mut images = stage.world().resource_mut::<Assets<Image>>();
        images.get_mut(&mask).expect("an image").asset_usage = RenderAssetUsages::all();
        stage.step();
        assert_eq!(drawn(&mut stage), 0, "{frame}");
    }
}

/// Maps drawn, and drawn over, in frames in each of which a caster's material, mesh or mask is edited.
fn edits(updates: ShadowUpdates, edit: impl Fn(&mut World, Entity)) -> Vec<[usize; 2]> {
    let (mut stage, _) = stage(shadows());
    let caster = blocks(&mut stage)[0];
    let (masked, _) = masked(&mut stage);
    let world = stage.world();
    let mut meshes = world.resource_mut::<Assets<Mesh>>();
    let mesh = meshes.add(Cuboid::from_length(1.5));
    let mut caster_mut = world.entity_mut(caster);
    caster_mut.insert((masked, Mesh3d(mesh), updates));
    stage.headless.settle();
    for _ in 0..100 {
        stage.step();
    }
    let frame = |is_edited: bool, stage: &mut Stage| {
        if is_edited {
            edit(stage.world(), caster);
        }
        stage.step();
        [drawn(stage), drawn_over(stage)]
    };
    assert_eq!(frame(false, &mut stage), [0, 0]);
    let drawn: Vec<_> = (0..30).map(|_| frame(true, &mut stage)).collect();
    // The same as drawn anew.
    let held = stage.last_picture();
    let mut suns = stage.world().query::<&mut ParallelSplitShadows>();
    for mut config in suns.iter_mut(stage.world()) {
        config.comparison.updates = MapUpdates::EveryFrame;
    }
    frame(false, &mut stage);
    frame(false, &mut stage);
    assert_identical("edited", &held, &stage.last_picture());
    drawn
}

/// A caster whose mesh or material changes again and again is drawn as what moves, and not at all if it need not show.
#[test]
fn what_is_edited_again_and_again_is_drawn_over_what_rests() {
    type Edit = fn(&mut World, Entity);
    let edit_material: Edit = |world, caster| {
        let material = world.get::<MeshMaterial3d<StandardMaterial>>(caster);
        let material = material.expect("one").0.clone();
        let mut materials = world.resource_mut::<Assets<StandardMaterial>>();
        materials.get_mut(&material).expect("one").emissive.red += 0.01;
    };
    let edit_mesh: Edit = |world, caster| {
        let mesh = world.get::<Mesh3d>(caster).expect("one").0.clone();
        let mut meshes = world.resource_mut::<Assets<Mesh>>();
        let mut mesh = meshes.get_mut(&mesh).expect("one");
        let smaller = mesh.clone().scaled_by(Vec3::new(1.0, 0.98, 1.0));
        *mesh = smaller;
    };
    let edit_mask: Edit = |world, caster| {
        let material = world.get::<MeshMaterial3d<StandardMaterial>>(caster);
        let material = material.expect("one").0.clone();
        let materials = world.resource::<Assets<StandardMaterial>>();
        let material = materials.get(&material).expect("one");
        let mask = material.base_color_texture.clone().expect("a mask");
        let mut images = world.resource_mut::<Assets<Image>>();
        images.get_mut(&mask).expect("an image").asset_usage = RenderAssetUsages::all();
    };
    for (what, edit) in [
        ("material", edit_material),
        ("mesh", edit_mesh),
        ("mask", edit_mask),
    ] {
        let frames = edits(ShadowUpdates::Automatic, edit);
        assert!(frames[0][0] > 0, "{what}: {frames:?}");
        for [resting, over] in &frames[8..] {
            assert!(*resting == 0 && *over > 0, "{what}: {frames:?}");
        }
    }
    let frames = edits(ShadowUpdates::Never, edit_material);
    assert!(frames[8..].iter().all(|it| *it == [0, 0]), "{frames:?}");
}

/// A caster whose edits need not show, and go on while its mesh is loaded, has a shadow all the same.
#[test]
fn what_loads_late_has_a_shadow_though_its_edits_need_not_show() {
    let load = |updates: MapUpdates| {
        let comparison = Comparison {
            updates,
            ..default()
        };
        let (mut stage, _) = stage(ParallelSplitShadows {
            comparison,
            ..shadows()
        });
        let block = blocks(&mut stage)[0];
        let world = stage.world();
        let mesh = world.get::<Mesh3d>(block).expect("one").0.clone();
        let meshes = world.resource::<Assets<Mesh>>();
        let loaded = meshes.get(&mesh).expect("a mesh").clone();
        let late = meshes.reserve_handle();
        let mut materials = world.resource_mut::<Assets<StandardMaterial>>();
        let glowing = materials.add(StandardMaterial::default());
        let material = MeshMaterial3d(glowing.clone());
        let place = Transform::from_xyz(1.5, 1.0, 4.0);
        world.spawn((Mesh3d(late.clone()), material, place, ShadowUpdates::Never));
        for frame in 0..40 {
            let world = stage.world();
            let mut materials = world.resource_mut::<Assets<StandardMaterial>>();
            materials.get_mut(&glowing).expect("one").emissive.red = 0.01 * frame as f32;
            if frame == 20 {
                let mut meshes = world.resource_mut::<Assets<Mesh>>();
                meshes.insert(late.id(), loaded.clone()).expect("a handle");
            }
            stage.step();
            // Its edits show in no map as long as it is not there.
            let is_held = updates == MapUpdates::WhenNeeded;
            assert!(!is_held || !(10..20).contains(&frame) || drawn(&mut stage) == 0);
        }
        (drawn(&mut stage), stage.last_picture())
    };
    let (_, anew) = load(MapUpdates::EveryFrame);
    let (count, held) = load(MapUpdates::WhenNeeded);
    assert_identical("late_and_glowing", &held, &anew);
    assert_eq!(count, 0);
}

/// What is to discard by a shader of its own.
#[derive(Asset, AsBindGroup, TypePath, Debug, Clone, Default)]
struct Late {}

const LATE: Handle<Shader> = uuid_handle!("3f1f6a0e-98b4-4d55-8f83-5b0a2a6f51c7");

impl MaterialExtension for Late {
    fn prepass_fragment_shader() -> ShaderRef {
        LATE.into()
    }
}

/// A shader that does not come has maps drawn for some time, and not for ever; if it comes after all, its casters are
/// in maps.
#[test]
fn shaders_that_do_not_come_are_not_waited_for_for_ever() {
    type Material = ExtendedMaterial<StandardMaterial, Late>;
    let run = |updates: MapUpdates| {
        let mut stage = Stage::with_app(default(), |app| {
            app.add_plugins(MaterialPlugin::<Material>::default());
        });
        let sun = stage.sun();
        let comparison = Comparison {
            updates,
            ..default()
        };
        stage.world().entity_mut(sun).insert(ParallelSplitShadows {
            comparison,
            ..shadows()
        });
        stage.camera();
        note_drawn(&mut stage);
        stage.headless.settle();
        let near = blocks(&mut stage).pop();
        let world = stage.world();
        let material = world.resource_mut::<Assets<Material>>().add(Material {
            base: StandardMaterial {
                alpha_mode: AlphaMode::Mask(0.5),
                ..default()
            },
            extension: Late {},
        });
        world
            .entity_mut(near.expect("a block"))
            .remove::<MeshMaterial3d<StandardMaterial>>()
            .insert(MeshMaterial3d(material));
        let mut counts = Vec::new();
        for _ in 0..100 {
            stage.step();
            counts.push(drawn(&mut stage));
        }
        let lacking = stage.last_picture();
        let mut shaders = stage.world().resource_mut::<Assets<Shader>>();
        let shader = Shader::from_wesl("@fragment fn fragment() {}", "late.wesl");
        assert!(shaders.insert(&LATE, shader).is_ok());
        for _ in 0..40 {
            stage.step();
        }
        (counts, lacking, stage.last_picture())
    };
    let (_, _, anew) = run(MapUpdates::EveryFrame);
    let (counts, lacking, held) = run(MapUpdates::WhenNeeded);
    assert!(counts[5..50].iter().all(|count| *count > 0), "{counts:?}");
    assert_eq!(counts[90..], [0; 10], "{counts:?}");
    assert_identical("late_shader", &held, &anew);
    assert!(lacking != held, "its shadow has come");
}

/// Gray says for how many frames a map has been held.
#[test]
fn the_overlay_shows_how_old_maps_are() {
    let (mut stage, sun) = stage(shadows());
    stage.world().insert_resource(ShadowOverlay::Age);
    stage.headless.settle();
    let brightness = |stage: &Stage| {
        let picture = stage.last_picture();
        picture
            .pixels()
            .map(|pixel| u64::from(pixel[1]))
            .sum::<u64>()
    };
    stage.step();
    let young = brightness(&stage);
    for _ in 0..60 {
        stage.step();
    }
    let old = brightness(&stage);
    assert!(old > young, "{young} and then {old}");
    let mut turned = stage.world().get_mut::<Transform>(sun).expect("a sun");
    turned.rotate_y(0.2);
    stage.step();
    assert!(brightness(&stage) < old);
}

/// A camera that is drawn before another one comes and goes, and takes none of its layers.
#[test]
fn a_camera_that_comes_and_goes_has_no_others_maps_drawn() {
    let (mut stage, _) = stage(shadows());
    let target = stage.target();
    let other = stage
        .world()
        .spawn((
            Camera {
                order: -1,
                is_active: false,
                ..default()
            },
            target,
            Camera3d::default(),
            eye().with_translation(Vec3::new(3.0, 2.0, 8.0)),
        ))
        .id();
    let mut frames = |is_active: bool| {
        let mut camera = stage.world().get_mut::<Camera>(other).expect("a camera");
        camera.is_active = is_active;
        stage.step();
        let first = drawn(&mut stage);
        let later = (0..6).map(|_| {
            stage.step();
            drawn(&mut stage)
        });
        (first, later.last().expect("some"))
    };
    // The target grows once, and all is drawn anew.
    frames(true);
    frames(false);
    for _ in 0..3 {
        let (first, last) = frames(true);
        assert!(
            (1..=4).contains(&first),
            "{first} maps of the one that comes"
        );
        assert_eq!(last, 0);
        assert_eq!(frames(false), (0, 0));
    }
}
