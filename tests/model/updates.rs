//! What is drawn where casters move: they alone, over maps of those that rest.

use bevy::{
    camera::{
        primitives::Aabb,
        visibility::{CascadesVisibleEntities, NoCpuCulling, NoFrustumCulling, RenderLayers},
    },
    ecs::{entity::EntityHashSet, entity_disabling::Disabled},
    light::NotShadowCaster,
    math::{DMat3, DVec3},
    mesh::{
        morph::{MeshMorphWeights, MorphWeights},
        skinning::SkinnedMesh,
    },
    prelude::*,
};
use bevy_pssm::{
    CasterCascades, ShadowPlans,
    geometry::{hull::CasterHull, oriented_box::OrientedBox},
    plan::{CasterChanges, Redraw},
    prelude::*,
    systems::ChangedCasters,
};

use crate::lights::{app, camera, sun};

/// Boxes of a meter on a square of 200 m.
fn boxes(app: &mut App) -> Vec<Entity> {
    many_boxes(app, 40)
}

/// So many along each side of it.
fn many_boxes(app: &mut App, count: usize) -> Vec<Entity> {
    let places = (0..count).flat_map(|x| (0..count).map(move |z| [x, z]));
    let places = places.map(|place| place.map(|at| 200.0 * at as f32 / count as f32 - 100.0));
    let world = app.world_mut();
    places
        .map(|[x, z]| {
            let caster = world.spawn((
                Mesh3d::default(),
                Aabb::from_min_max(Vec3::splat(-0.5), Vec3::splat(0.5)),
                Transform::from_xyz(x, 0.5, z),
                Visibility::default(),
            ));
            caster.id()
        })
        .collect()
}

/// Casters drawn in a frame: those of maps that are drawn, those that are added to maps, and those that move.
fn drawn(app: &App, view: Entity, light: Entity) -> usize {
    let light = app.world().entity(light);
    let plans = &light.get::<ShadowPlans>().unwrap().views[&view];
    let lists = &light.get::<CascadesVisibleEntities>().unwrap().entities[&view];
    let maps = plans.iter().map(|plan| plan.map.as_ref());
    let is_anew = |redraw: Option<Redraw>| redraw.is_some_and(|it| it != Redraw::Added);
    let redrawn = maps
        .zip(lists)
        .filter(|(map, _)| map.is_some_and(|map| is_anew(map.redraw)));
    let resting: usize = redrawn.map(|(_, list)| list.entities.len()).sum();
    let casters = light.get::<CasterCascades>().unwrap();
    let over = [casters.added.get(&view), casters.moving.get(&view)];
    let over = over.into_iter().flatten().flatten();
    let over: usize = over.map(|(_, cascades)| cascades.iter().count()).sum();
    resting + over
}

/// Over two seconds of a walk, with every so many boxes moving.
fn drawn_along(updates: MapUpdates, step: usize) -> usize {
    let mut app = app();
    let view = camera(&mut app);
    let light = sun(
        &mut app,
        ParallelSplitShadows {
            comparison: Comparison {
                updates,
                ..default()
            },
            ..default()
        },
    );
    let boxes = boxes(&mut app);
    app.update();
    let frames = (0..120).map(|frame| {
        let world = app.world_mut();
        for mover in boxes.iter().skip(step / 2).step_by(step) {
            let mut at = world.get_mut::<Transform>(*mover).unwrap();
            at.translation.y = 0.5 + 0.25 * (frame % 2) as f32;
        }
        world.get_mut::<Transform>(view).unwrap().translation.z -= 0.1;
        app.update();
        drawn(&app, view, light)
    });
    frames.sum()
}

#[test]
fn what_moves_costs_itself() {
    let every = drawn_along(MapUpdates::EveryFrame, 100);
    let needed = drawn_along(MapUpdates::WhenNeeded, 100);
    let share = needed as f64 / every as f64;
    assert!(share < 0.1, "{needed} of {every}");
    // Where all moves nothing is saved, and nothing lost.
    let every = drawn_along(MapUpdates::EveryFrame, 1);
    let needed = drawn_along(MapUpdates::WhenNeeded, 1);
    let share = needed as f64 / every as f64;
    assert!((0.9..1.2).contains(&share), "{needed} of {every}");
}

#[test]
fn what_has_come_to_rest_is_drawn_once_more() {
    comes_to_rest(0);
}

/// What is drawn over maps no more does not wait for its turn in them.
#[test]
fn what_has_come_to_rest_need_not_wait() {
    comes_to_rest(8);
}

fn comes_to_rest(delay: u32) {
    let mut app = app();
    let view = camera(&mut app);
    let settings = ParallelSplitShadows { delay, ..default() };
    let light = sun(&mut app, settings);
    let boxes = boxes(&mut app);
    app.update();
    let plans = &app.world().get::<ShadowPlans>(light).unwrap().views[&view];
    let is_in_two = |caster: &&Entity| {
        let at = app.world().get::<GlobalTransform>(**caster).unwrap();
        let maps = plans.iter().filter_map(|plan| plan.map.as_ref());
        let holds = |hull: &CasterHull| hull.intersects_sphere(at.translation().as_dvec3(), 0.0);
        maps.filter(|map| holds(&map.hull_now)).count() > 1
    };
    let mover = *boxes.iter().find(is_in_two).expect("where two meet");
    let maps = |app: &App| {
        let casters = app.world().get::<CasterCascades>(light).unwrap();
        let cascades = casters.get(view, mover);
        cascades.map_or(0, |cascades| cascades.iter().count())
    };
    let is_moving = |app: &App| {
        let casters = app.world().get::<CasterCascades>(light).unwrap();
        casters.moving[&view].iter().any(|(it, _)| *it == mover)
    };
    let in_lists = |app: &App| {
        let lists = app.world().get::<CascadesVisibleEntities>(light).unwrap();
        let mut lists = lists.entities[&view].iter();
        lists.any(|list| list.entities.contains(&mover))
    };
    assert!(in_lists(&app) && !is_moving(&app));
    let mut frame = |by: f32| {
        let mut at = app.world_mut().get_mut::<Transform>(mover).unwrap();
        at.translation.x += by;
        app.update();
        assert_ne!(in_lists(&app), is_moving(&app), "it is drawn once");
        let visible = app.world().get::<ViewVisibility>(mover).unwrap();
        assert!(visible.get());
        assert!(maps(&app) > 1, "no map lacks it");
        (is_moving(&app), drawn(&app, view, light))
    };
    for _ in 0..5 {
        assert!(frame(0.01).0);
    }
    let later: Vec<_> = (0..100).map(|_| frame(0.0)).collect();
    assert_eq!(later.last(), Some(&(false, 0)));
    let dearer = later
        .iter()
        .filter(|(is_moving, drawn)| !is_moving && *drawn > 0);
    assert_eq!(dearer.count(), 1);
}

/// Where casters are added to what maps hold, all that matters is there, and each is drawn once.
#[test]
fn what_is_added_is_all_that_maps_lack() {
    adds_all_that_maps_lack(30);
}

/// Much comes and goes.
#[test]
fn what_comes_is_added_to_all_maps_that_lack_it() {
    adds_all_that_maps_lack(2);
}

fn adds_all_that_maps_lack(step: usize) {
    let mut app = app();
    let view = camera(&mut app);
    let light = sun(&mut app, ParallelSplitShadows::default());
    let boxes = boxes(&mut app);
    let mut held: Vec<EntityHashSet> = Vec::new();
    let mut times = 0;
    for frame in 0..240 {
        let world = app.world_mut();
        let mut at = world.get_mut::<Transform>(view).unwrap();
        at.rotate_y(1.5_f32.to_radians());
        at.translation.x = (0.05 * frame as f32).sin();
        // One comes and one goes, now and then.
        let mut some = world.get_mut::<Visibility>(boxes[7 * frame % boxes.len()]);
        if let Some(it) = some.as_mut().filter(|_| frame % step == step - 1) {
            it.toggle_visible_hidden();
        }
        app.update();
        let entity = app.world().entity(light);
        let casters = entity.get::<CasterCascades>().unwrap();
        let plans = &entity.get::<ShadowPlans>().unwrap().views[&view];
        let lists = &entity.get::<CascadesVisibleEntities>().unwrap().entities[&view];
        held.resize_with(plans.len(), EntityHashSet::default);
        let maps = plans.iter().zip(lists).zip(&mut held).enumerate();
        for (index, ((plan, list), held)) in maps {
            let Some(map) = &plan.map else {
                continue;
            };
            let inside = casters.added[&view].iter();
            let inside = inside.filter(|(_, cascades)| cascades.contains(index));
            let added: Vec<Entity> = inside.map(|(caster, _)| *caster).collect();
            match map.redraw {
                Some(Redraw::Added) => {
                    times += usize::from(!added.is_empty());
                    for caster in added {
                        assert!(held.insert(caster), "frame {frame}: it is drawn once");
                    }
                }
                redraw => {
                    assert!(added.is_empty());
                    if redraw.is_some() {
                        *held = list.entities.iter().copied().collect();
                    }
                }
            }
            let listed: EntityHashSet = list.entities.iter().copied().collect();
            assert_eq!(*held, listed, "frame {frame}");
            for caster in &boxes {
                let caster = app.world().entity(*caster);
                let at = caster.get::<GlobalTransform>().unwrap().translation();
                let matters = map.hull_now.intersects_box(&OrientedBox {
                    center: at.as_dvec3(),
                    half_axes: DMat3::from_diagonal(DVec3::splat(0.5)),
                });
                let is_there = caster.get::<InheritedVisibility>().unwrap().get();
                let is_held = held.contains(&caster.id());
                assert!(!(matters && is_there) || is_held, "frame {frame}: {at}");
                let is_visible = caster.get::<ViewVisibility>().unwrap().get();
                assert!(!is_held || is_visible, "frame {frame}: {at}");
            }
        }
    }
    assert!(times > 10, "casters were added {times} times");
}

/// Why maps are drawn in a frame.
fn reasons(app: &App, view: Entity, light: Entity) -> Vec<Redraw> {
    let plans = &app.world().get::<ShadowPlans>(light).unwrap().views[&view];
    let maps = plans.iter().filter_map(|plan| plan.map.as_ref());
    maps.filter_map(|map| map.redraw).collect()
}

/// Whether any map is drawn anew in the next frame.
fn is_any_drawn(app: &mut App, view: Entity, light: Entity) -> bool {
    app.update();
    !reasons(app, view, light).is_empty()
}

fn lift(app: &mut App, boxes: &[Entity], by: f32) {
    for caster in boxes {
        let mut at = app.world_mut().get_mut::<Transform>(*caster).unwrap();
        at.translation.y += by;
    }
}

/// Each kind of change has something drawn where all maps were held, and undoing it too; what is written but stays the
/// same has not.
#[test]
fn no_kind_of_change_is_missed() {
    type Change = fn(&mut EntityWorldMut);
    let none: Change = |it| {
        let at = *it.get::<Transform>().unwrap();
        it.insert((at, Visibility::default()));
    };
    let kinds: [(&str, Change, Change); 8] = [
        (
            "transform",
            |it| it.get_mut::<Transform>().unwrap().translation.y += 0.5,
            |it| it.get_mut::<Transform>().unwrap().translation.y -= 0.5,
        ),
        (
            "bounds",
            |it| _ = it.insert(Aabb::from_min_max(Vec3::splat(-0.7), Vec3::splat(0.7))),
            |it| _ = it.insert(Aabb::from_min_max(Vec3::splat(-0.5), Vec3::splat(0.5))),
        ),
        (
            "mesh",
            |it| {
                let mut meshes = it.resource_mut::<Assets<Mesh>>();
                let mesh = meshes.add(Cuboid::from_length(1.0));
                it.insert(Mesh3d(mesh));
            },
            |it| _ = it.insert(Mesh3d::default()),
        ),
        (
            "visibility",
            |it| _ = it.insert(Visibility::Hidden),
            |it| _ = it.insert(Visibility::Inherited),
        ),
        (
            "casting",
            |it| _ = it.insert(NotShadowCaster),
            |it| _ = it.remove::<NotShadowCaster>(),
        ),
        (
            "layers",
            |it| _ = it.insert(RenderLayers::layer(7)),
            |it| _ = it.remove::<RenderLayers>(),
        ),
        (
            "margin",
            |it| _ = it.insert(BoundsMargin(2.0)),
            |it| _ = it.remove::<BoundsMargin>(),
        ),
        (
            "culling",
            |it| _ = it.insert(NoFrustumCulling),
            |it| _ = it.remove::<NoFrustumCulling>(),
        ),
    ];
    for (kind, change, undo) in kinds {
        let mut app = app();
        let boxes = boxes(&mut app);
        let view = camera(&mut app);
        let light = sun(&mut app, ParallelSplitShadows::default());
        let distance = |it: &&Entity| {
            let at = app.world().get::<Transform>(**it).unwrap().translation;
            at.distance_squared(Vec3::new(0.0, 0.0, -12.0)) as i32
        };
        let nearest = *boxes.iter().min_by_key(distance).unwrap();
        for (what, change, is_seen) in [
            (kind, change, true),
            ("undone", undo, true),
            ("none", none, false),
        ] {
            for _ in 0..150 {
                app.update();
            }
            let held = drawn(&app, view, light);
            assert_eq!(held, 0, "{kind}, {what}: drawn before");
            change(&mut app.world_mut().entity_mut(nearest));
            // Lists of what is lost are the renderer's to compare.
            let lists = |app: &App| -> Vec<_> {
                let lists = app.world().get::<CascadesVisibleEntities>(light).unwrap();
                lists.entities[&view]
                    .iter()
                    .map(|list| list.entities.clone())
                    .collect()
            };
            let listed = lists(&app);
            app.update();
            let is_found = drawn(&app, view, light) > 0 || lists(&app) != listed;
            assert_eq!(is_found, is_seen, "{kind}, {what}");
        }
    }
}

/// After frames in which nothing could be told apart, few that change are told from many that are written to.
#[test]
fn floods_of_changes_pass() {
    let mut app = app();
    let view = camera(&mut app);
    let boxes = many_boxes(&mut app, 100);
    // Nobody looks at them without a light.
    app.update();
    let light = sun(&mut app, ParallelSplitShadows::default());
    let still = ShadowUpdates::Never;
    for caster in &boxes {
        app.world_mut().entity_mut(*caster).insert(still);
    }
    let mover = boxes[50 * 100 + 45];
    app.world_mut().entity_mut(mover).remove::<ShadowUpdates>();
    let mut frame = |moved: &[Entity]| {
        lift(&mut app, moved, 0.01);
        is_any_drawn(&mut app, view, light)
    };
    for _ in 0..4 {
        frame(&[mover]);
    }
    assert!(
        (0..20).all(|_| !frame(&[mover])),
        "it is drawn over what rests"
    );
    // Who says that it need not show has nothing drawn, however many there are.
    assert!((0..20).all(|_| !frame(&boxes[..9000])));

    for caster in &boxes {
        app.world_mut()
            .entity_mut(*caster)
            .remove::<ShadowUpdates>();
    }
    let mut frame = |moved: &[Entity]| {
        lift(&mut app, moved, 0.01);
        is_any_drawn(&mut app, view, light)
    };
    for count in [4200, 5000, 10_000] {
        assert!((0..10).all(|_| frame(&boxes[..count])), "{count} move");
        for _ in 0..3 {
            frame(&[]);
        }
        assert!((0..20).all(|_| !frame(&[])), "{count} have stopped");
    }
    // All that is written stays what it is.
    let mut frame = || {
        lift(&mut app, &boxes, 0.0);
        is_any_drawn(&mut app, view, light)
    };
    assert!((0..10).all(|_| !frame()));
}

/// Of very many meshes more may move before they count as a flood.
#[test]
fn few_of_very_many_are_no_flood() {
    let mut app = app();
    camera(&mut app);
    sun(&mut app, ParallelSplitShadows::default());
    let boxes = many_boxes(&mut app, 400);
    app.update();
    app.update();
    let changes = |app: &App| app.world().resource::<ChangedCasters>().get().clone();
    let mut frame = |every: usize| {
        let moved: Vec<Entity> = boxes.iter().copied().step_by(every).collect();
        lift(&mut app, &moved, 0.01);
        app.update();
        (moved.len(), changes(&app))
    };
    // They begin to move, and are drawn over what rests from then on.
    let (count, begin) = frame(35);
    assert!(
        count > 4500 && begin == CasterChanges::AtOnce(None),
        "{count}"
    );
    for _ in 0..3 {
        let (_, changes) = frame(35);
        assert!(changes.are_none(), "{changes:?}");
    }
    frame(20);
    assert_eq!(frame(20).1, CasterChanges::Anywhere);
}

/// Whichever meshes tell of a flood, they do not tell for ever: it is over where no others change any more.
#[test]
fn few_do_not_stand_for_a_flood_for_long() {
    // As a sample is taken: in one of these frames, it is the same meshes.
    const SHARE: usize = 10_000_usize.div_ceil(128);
    // The longer it has lasted, the longer it is believed to: the fourth sample's are as many frames as any's.
    for (offset, flood, most) in (0..4).flat_map(|it| [(it, 10, 18), (it + 112, 116, 66)]) {
        let mut app = app();
        camera(&mut app);
        sun(&mut app, ParallelSplitShadows::default());
        let boxes = many_boxes(&mut app, 100);
        app.update();
        let changes = |app: &App| app.world().resource::<ChangedCasters>().get().clone();
        let frame = app.world().resource::<ChangedCasters>().frame() as usize;
        for _ in 0..flood {
            lift(&mut app, &boxes, 0.01);
            app.update();
            assert_eq!(changes(&app), CasterChanges::Anywhere);
        }
        let few = boxes.iter().copied().skip((frame + offset) % SHARE);
        let few: Vec<Entity> = few.step_by(SHARE).collect();
        for _ in 0..most {
            lift(&mut app, &few, 0.01);
            app.update();
        }
        for _ in 0..3 {
            lift(&mut app, &few, 0.01);
            app.update();
            let are_few = matches!(
                changes(&app),
                CasterChanges::At(_) | CasterChanges::AtOnce(Some(_))
            );
            assert!(are_few, "{offset}, {flood}: {:?}", changes(&app));
        }
    }
}

/// Nobody looks at casters until a light shines, and then nothing is missed of what changes.
#[test]
fn what_changes_at_night_is_drawn_at_sunrise() {
    let mut app = app();
    let view = camera(&mut app);
    let light = sun(&mut app, ParallelSplitShadows::default());
    let boxes = boxes(&mut app);
    let shine = |app: &mut App, illuminance: f32| {
        let mut light = app.world_mut().get_mut::<DirectionalLight>(light).unwrap();
        light.illuminance = illuminance;
    };
    let changes = |app: &App| app.world().resource::<ChangedCasters>().get().clone();
    let none = CasterChanges::At(Vec::new());
    for _ in 0..2 {
        app.update();
    }
    assert_eq!(changes(&app), none);
    shine(&mut app, 0.0);
    for _ in 0..3 {
        lift(&mut app, &boxes, 0.1);
        app.update();
        assert_eq!(changes(&app), CasterChanges::Anywhere);
    }
    app.world_mut().despawn(boxes[0]);
    app.update();
    shine(&mut app, 1000.0);
    assert!(is_any_drawn(&mut app, view, light));
    for _ in 0..4 {
        app.update();
        assert_eq!(changes(&app), none);
    }
    assert!(!is_any_drawn(&mut app, view, light));
    // Where it stood at dawn, its shadow has to go.
    let before_the_camera = 20 * 40 + 18;
    lift(&mut app, &boxes[before_the_camera..][..1], 5.0);
    assert!(is_any_drawn(&mut app, view, light));
    let CasterChanges::AtOnce(Some(places)) = changes(&app) else {
        panic!("few have changed, and one is in no map any more");
    };
    let stood = |place: &OrientedBox| (place.center.y - 0.8).abs() < 1e-3;
    assert!(places.iter().any(stood), "{places:?}");
}

/// Boxes without end, and those that are sheared, are in the maps that they throw shadows into.
#[test]
fn boxes_of_any_shape_are_culled_right() {
    let mut app = app();
    let view = camera(&mut app);
    let light = sun(&mut app, ParallelSplitShadows::default());
    boxes(&mut app);
    let of_half = |half_extents: Vec3| {
        let aabb = Aabb {
            half_extents: half_extents.into(),
            ..default()
        };
        (Mesh3d::default(), aabb, Visibility::default())
    };
    let world = app.world_mut();
    let endless = world.spawn((
        of_half(Vec3::INFINITY),
        Transform::from_xyz(5000.0, 0.0, 0.0),
    ));
    let endless = endless.id();
    // Its corners are a kilometer out, its axes half of that.
    let stretched = world
        .spawn((
            Transform::from_xyz(1000.0, 30.0, 0.0).with_scale(Vec3::new(1000.0, 1.0, 1.0)),
            Visibility::default(),
        ))
        .id();
    let turned = Transform::from_rotation(Quat::from_rotation_z(core::f32::consts::FRAC_PI_4));
    let sheared = world.spawn((
        of_half(Vec3::new(0.8, 0.8, 100.0)),
        turned,
        ChildOf(stretched),
    ));
    let sheared = sheared.id();
    app.update();
    let casters = app.world().get::<CasterCascades>(light).unwrap();
    for caster in [endless, sheared] {
        assert!(
            casters.get(view, caster).is_some(),
            "{caster}: {endless}, {sheared}"
        );
    }
}

/// While a light is away, casters come and go that its maps do not know of.
#[test]
fn lights_that_come_back_look_anew() {
    let mut app = app();
    let view = camera(&mut app);
    let [light, _other] = [(); 2].map(|()| sun(&mut app, ParallelSplitShadows::default()));
    let boxes = boxes(&mut app);
    for _ in 0..5 {
        app.update();
    }
    app.world_mut().entity_mut(light).insert(Disabled);
    app.update();
    let place = Transform::from_xyz(0.5, 0.5, -12.5);
    let copy = app.world_mut().entity_mut(boxes[0]).clone_and_spawn();
    app.world_mut().entity_mut(copy).insert(place);
    for _ in 0..5 {
        app.update();
    }
    app.world_mut().entity_mut(light).remove::<Disabled>();
    for _ in 0..2 {
        app.update();
        let lists = app.world().get::<CascadesVisibleEntities>(light).unwrap();
        let mut lists = lists.entities[&view].iter();
        assert!(lists.any(|list| list.entities.contains(&copy)));
    }
}

/// What others drew into a light's maps while all were drawn in each frame is not left in them.
#[test]
fn lights_that_come_to_rest_are_drawn_once_more() {
    let mut app = app();
    let view = camera(&mut app);
    let light = sun(&mut app, ParallelSplitShadows::default());
    boxes(&mut app);
    app.world_mut()
        .entity_mut(light)
        .insert(ShadowUpdates::Always);
    for _ in 0..5 {
        assert!(is_any_drawn(&mut app, view, light));
    }
    app.world_mut()
        .entity_mut(light)
        .insert(ShadowUpdates::Automatic);
    assert!(is_any_drawn(&mut app, view, light));
    assert!(!is_any_drawn(&mut app, view, light));
}

/// What the GPU culls is in a map wherever it stands, and may come to matter there.
#[test]
fn what_the_gpu_culls_changes_all_maps() {
    let mut app = app();
    let view = camera(&mut app);
    let light = sun(&mut app, ParallelSplitShadows::default());
    let boxes = boxes(&mut app);
    // Behind the camera.
    let at = |app: &App, caster: Entity| {
        let at = app.world().get::<Transform>(caster).unwrap();
        at.translation
    };
    let behind = boxes.iter().find(|it| at(&app, **it).z > 60.0);
    let behind = *behind.expect("it stands among them");
    app.update();
    app.update();
    for (is_gpu_culled, is_drawn) in [(false, false), (true, true)] {
        if is_gpu_culled {
            app.world_mut().entity_mut(behind).insert(NoCpuCulling);
            app.update();
        }
        assert!(!is_any_drawn(&mut app, view, light));
        lift(&mut app, &[behind], 0.1);
        assert_eq!(is_any_drawn(&mut app, view, light), is_drawn);
    }
}

/// Boxes, a camera and a sun, once all maps are held.
fn at_rest() -> (App, Vec<Entity>, Entity, Entity) {
    let mut app = app();
    let boxes = boxes(&mut app);
    let view = camera(&mut app);
    let light = sun(&mut app, ParallelSplitShadows::default());
    for _ in 0..150 {
        app.update();
    }
    assert!(!is_any_drawn(&mut app, view, light));
    (app, boxes, view, light)
}

/// What comes and goes elsewhere concerns no map, whatever says how often its shadow is drawn.
#[test]
fn what_comes_and_goes_elsewhere_has_nothing_drawn() {
    let (mut app, _, view, light) = at_rest();
    for updates in [ShadowUpdates::Always, ShadowUpdates::Never] {
        let mut come = |at: Vec3| {
            let bounds = Aabb::from_min_max(Vec3::splat(-0.5), Vec3::splat(0.5));
            let place = Transform::from_translation(at);
            let mesh = (Mesh3d::default(), bounds, place, Visibility::default());
            let mesh = app.world_mut().spawn((mesh, updates)).id();
            app.update();
            let plans = &app.world().get::<ShadowPlans>(light).unwrap().views[&view];
            let mut maps = plans.iter().filter_map(|plan| plan.map.as_ref());
            let has_come = drawn(&app, view, light) > 0;
            let is_in_maps = maps.any(|map| map.redraw.is_some());
            app.world_mut().despawn(mesh);
            [has_come, is_in_maps, is_any_drawn(&mut app, view, light)]
        };
        let far = Vec3::new(0.0, 0.5, 5000.0);
        assert_eq!(come(far), [false; 3], "{updates:?}");
        // What is drawn over a map leaves nothing behind, and what a map may hold does.
        let near = Vec3::new(0.0, 0.5, -12.0);
        let is_held = updates == ShadowUpdates::Never;
        assert_eq!(come(near), [true, is_held, is_held], "{updates:?}");
        app.update();
    }
}

/// What comes is drawn alone, and so is what has ceased to move where something else still does.
#[test]
fn what_comes_costs_itself() {
    let (mut app, boxes, view, light) = at_rest();
    let why = |app: &App| reasons(app, view, light);
    let bounds = Aabb::from_min_max(Vec3::splat(-0.5), Vec3::splat(0.5));
    let near = Transform::from_xyz(0.0, 0.5, -12.0);
    let come = (Mesh3d::default(), bounds, near, Visibility::default());
    let come = app.world_mut().spawn(come).id();
    app.update();
    let added = why(&app);
    assert!(!added.is_empty() && added.iter().all(|it| *it == Redraw::Added));
    assert!(drawn(&app, view, light) <= added.len());
    // Hidden, it leaves maps that hold it.
    app.world_mut().entity_mut(come).insert(Visibility::Hidden);
    app.update();
    assert!(why(&app).contains(&Redraw::Casters));
    app.world_mut()
        .entity_mut(come)
        .insert(Visibility::Inherited);
    app.update();
    assert!(why(&app).iter().all(|it| *it == Redraw::Added));

    // Two move, and one of them stops.
    let distance = |it: &&Entity| {
        let at = app.world().get::<Transform>(**it).unwrap().translation;
        at.distance_squared(Vec3::new(4.0, 0.0, -12.0)) as i32
    };
    let other = *boxes.iter().min_by_key(distance).unwrap();
    let mut reasons = Vec::new();
    for frame in 0..150 {
        lift(&mut app, &[other], if frame % 2 == 0 { 0.1 } else { -0.1 });
        if frame < 10 {
            lift(&mut app, &[come], 0.05);
        }
        app.update();
        reasons.extend(why(&app).into_iter().map(|why| (frame, why)));
    }
    let (first, later): (Vec<_>, Vec<_>) = reasons.into_iter().partition(|it| it.0 == 0);
    assert!(first.iter().all(|it| it.1 == Redraw::Casters) && !first.is_empty());
    assert!(later.iter().all(|it| it.1 == Redraw::Added) && !later.is_empty());
}

/// What is shot moves from its second frame on: where something moves, no map is drawn for it. What only comes is
/// soon in maps, and so is what comes with many others.
#[test]
fn what_comes_among_what_moves_may_move_too() {
    let (mut app, boxes, view, light) = at_rest();
    let why = |app: &App| reasons(app, view, light);
    let is_moving = |app: &App, caster: Entity| {
        let casters = app.world().get::<CasterCascades>(light).unwrap();
        casters.moving[&view].iter().any(|(it, _)| *it == caster)
    };
    let distance = |it: &&Entity| {
        let at = app.world().get::<Transform>(**it).unwrap().translation;
        at.distance_squared(Vec3::new(4.0, 0.0, -12.0)) as i32
    };
    let mover = *boxes.iter().min_by_key(distance).unwrap();
    let frame = |app: &mut App| {
        let mut at = app.world_mut().get_mut::<Transform>(mover).unwrap();
        at.rotate_y(0.1);
        app.update();
        why(app)
    };
    frame(&mut app);
    let shot = |app: &mut App, height: f32| {
        let bounds = Aabb::from_min_max(Vec3::splat(-0.1), Vec3::splat(0.1));
        let at = Transform::from_xyz(0.0, height, -12.0);
        let mesh = (Mesh3d::default(), bounds, at, Visibility::default());
        app.world_mut().spawn(mesh).id()
    };
    let mut is_last_apart = true;
    // One that flies and hits something.
    let flying = shot(&mut app, 1.0);
    for _ in 0..10 {
        assert_eq!(frame(&mut app), []);
        assert!(
            is_moving(&app, flying),
            "it is drawn from the first frame on"
        );
        lift(&mut app, &[flying], 0.2);
    }
    app.world_mut().despawn(flying);
    assert_eq!(frame(&mut app), []);
    // One that stays where it is.
    let staying = shot(&mut app, 1.0);
    let reasons: Vec<Redraw> = (0..40).flat_map(|_| frame(&mut app)).collect();
    assert!(!is_moving(&app, staying), "it is in maps");
    assert!(!reasons.is_empty() && reasons.iter().all(|it| *it == Redraw::Added));
    // Many together.
    let many: Vec<_> = (0..40).map(|it| shot(&mut app, 0.1 * it as f32)).collect();
    let added = frame(&mut app);
    assert!(!added.is_empty() && added.iter().all(|it| *it == Redraw::Added));
    assert!(many.iter().all(|it| !is_moving(&app, *it)));
    // Once nothing moves, what comes now and then does not keep itself apart.
    for _ in 0..3 {
        for _ in 0..100 {
            app.update();
        }
        let last = shot(&mut app, 1.0);
        app.update();
        is_last_apart = is_moving(&app, last);
    }
    assert!(!is_last_apart);
}

/// Maps that a caster leaves are drawn at once, wherever their turn is, and once.
#[test]
fn what_begins_to_move_leaves_all_maps_at_once() {
    let mut app = app();
    let boxes = boxes(&mut app);
    let view = camera(&mut app);
    let settings = ParallelSplitShadows {
        delay: 8,
        ..default()
    };
    let light = sun(&mut app, settings);
    for _ in 0..150 {
        app.update();
    }
    let held_by = |app: &App, caster: Entity| {
        let casters = app.world().get::<CasterCascades>(light).unwrap();
        let cascades = casters.get(view, caster);
        cascades.map_or(0, |cascades| cascades.iter().count())
    };
    let mut in_several = boxes.into_iter().filter(|it| held_by(&app, *it) > 1);
    let (mover, hidden) = (in_several.next().unwrap(), in_several.next().unwrap());
    let mut frame = |change: &dyn Fn(&mut World)| {
        change(app.world_mut());
        app.update();
        let reasons = reasons(&app, view, light).into_iter();
        reasons.filter(|why| *why == Redraw::Casters).count()
    };
    let moves = |world: &mut World| world.get_mut::<Transform>(mover).unwrap().rotate_y(0.1);
    let hides = |world: &mut World| _ = world.entity_mut(hidden).insert(Visibility::Hidden);
    for change in [&moves as &dyn Fn(&mut World), &hides] {
        assert!(frame(change) > 1, "none waits");
        for _ in 0..10 {
            assert_eq!(frame(&|_| ()), 0, "none is drawn twice");
        }
    }
}

/// A game's own component that keeps entities out of queries hides their shadows, and gives them back.
#[test]
fn what_a_game_disables_comes_back() {
    #[derive(Component)]
    struct Pooled;

    let mut app = app();
    app.world_mut().register_disabling_component::<Pooled>();
    let boxes = boxes(&mut app);
    let view = camera(&mut app);
    let light = sun(&mut app, ParallelSplitShadows::default());
    for _ in 0..150 {
        app.update();
    }
    let distance = |it: &&Entity| {
        let at = app.world().get::<Transform>(**it).unwrap().translation;
        at.distance_squared(Vec3::new(0.0, 0.0, -12.0)) as i32
    };
    let nearest = *boxes.iter().min_by_key(distance).unwrap();
    let is_listed = |app: &App| {
        let lists = app.world().get::<CascadesVisibleEntities>(light).unwrap();
        let mut lists = lists.entities[&view].iter();
        lists.any(|list| list.entities.contains(&nearest))
    };
    assert!(is_listed(&app));
    for _ in 0..2 {
        app.world_mut().entity_mut(nearest).insert(Pooled);
        for _ in 0..5 {
            app.update();
            assert!(!is_listed(&app));
        }
        app.world_mut().entity_mut(nearest).remove::<Pooled>();
        assert!(is_any_drawn(&mut app, view, light));
        assert!(is_listed(&app));
        app.update();
    }
}

/// All casters go along with the world's origin: none of them moves.
#[test]
fn what_the_world_is_moved_with_does_not_move() {
    let (mut app, boxes, view, light) = at_rest();
    let by = Vec3::new(1024.0, 0.0, -512.0);
    for entity in boxes.iter().chain([&view]) {
        app.world_mut()
            .get_mut::<Transform>(*entity)
            .unwrap()
            .translation -= by;
    }
    app.world_mut().resource_mut::<ShadowGridOrigin>().0 -= by.as_dvec3();
    // All maps have other matrices.
    assert!(is_any_drawn(&mut app, view, light));
    for frame in 0..5 {
        let moving = app.world().resource::<ChangedCasters>().moving().len();
        assert_eq!(moving, 0, "{frame}");
        assert!(!is_any_drawn(&mut app, view, light), "{frame}");
    }
    lift(&mut app, &boxes[800..801], 0.5);
    app.update();
    let moving = app.world().resource::<ChangedCasters>().moving().len();
    assert_eq!(moving, 1);
}

/// What many lose in a frame is one frame's change, and an origin that is no number none.
#[test]
fn changes_are_told_once() {
    let (mut app, boxes, view, light) = at_rest();
    for caster in &boxes[..5] {
        app.world_mut()
            .entity_mut(*caster)
            .insert(ShadowUpdates::Never);
    }
    assert!(!is_any_drawn(&mut app, view, light));
    for caster in &boxes[..5] {
        app.world_mut()
            .entity_mut(*caster)
            .remove::<ShadowUpdates>();
    }
    assert!(is_any_drawn(&mut app, view, light));
    assert!(!is_any_drawn(&mut app, view, light));
    app.world_mut().resource_mut::<ShadowGridOrigin>().0.x = f64::NAN;
    app.update();
    assert!(!is_any_drawn(&mut app, view, light));
}

/// A caster whose place is no number is in no map, and changes none however often it is written.
#[test]
fn what_is_nowhere_has_nothing_drawn() {
    let (mut app, _, view, light) = at_rest();
    let place = Transform::from_xyz(f32::NAN, 0.0, 0.0);
    let mesh = app.world_mut().spawn((Mesh3d::default(), place)).id();
    let bounds = Aabb::from_min_max(Vec3::splat(-0.5), Vec3::splat(0.5));
    app.world_mut().entity_mut(mesh).insert(bounds);
    for frame in 0..5 {
        app.world_mut()
            .get_mut::<Transform>(mesh)
            .unwrap()
            .set_changed();
        assert!(!is_any_drawn(&mut app, view, light), "{frame}");
    }
    // Whatever has been drawn meanwhile, it is drawn once it is somewhere.
    app.world_mut().spawn((
        Mesh3d::default(),
        bounds,
        Transform::from_xyz(1.0, 0.5, -12.0),
    ));
    app.update();
    assert!(drawn(&app, view, light) > 0);
    *app.world_mut().get_mut::<Transform>(mesh).unwrap() = Transform::from_xyz(0.0, 0.5, -12.0);
    app.update();
    let casters = app.world().get::<CasterCascades>(light).unwrap();
    let mut added = casters.added[&view].iter();
    assert!(added.any(|(caster, _)| *caster == mesh));
}

/// What counts for nothing while it is there leaves maps as it goes nowhere, and is added where it comes back.
#[test]
fn what_goes_nowhere_leaves_nothing_behind() {
    let (mut app, boxes, view, light) = at_rest();
    let lists = app.world().get::<CascadesVisibleEntities>(light).unwrap();
    let listed = &lists.entities[&view][0].entities;
    let caster = *boxes.iter().find(|it| listed.contains(it)).unwrap();
    app.world_mut()
        .entity_mut(caster)
        .insert(ShadowUpdates::Never);
    assert!(!is_any_drawn(&mut app, view, light));
    let place = |app: &App| *app.world().get::<Transform>(caster).unwrap();
    let from = place(&app);
    *app.world_mut().get_mut::<Transform>(caster).unwrap() = Transform::from_xyz(f32::NAN, 0., 0.);
    assert!(is_any_drawn(&mut app, view, light));
    let back = from.with_translation(from.translation + Vec3::Y);
    *app.world_mut().get_mut::<Transform>(caster).unwrap() = back;
    app.update();
    let casters = app.world().get::<CasterCascades>(light).unwrap();
    let mut added = casters.added[&view].iter();
    assert!(added.any(|(it, _)| *it == caster));
}

/// Written again, `ShadowUpdates` are what they were; others have all maps drawn that may hold an old shadow.
#[test]
fn updates_are_compared_by_value() {
    let (mut app, boxes, ..) = at_rest();
    let caster = boxes[0];
    let change = |app: &mut App, updates: Option<ShadowUpdates>| {
        let mut caster = app.world_mut().entity_mut(caster);
        match updates {
            Some(updates) => _ = caster.insert(updates),
            None => _ = caster.remove::<ShadowUpdates>(),
        }
        app.update();
        app.world().resource::<ChangedCasters>().get().clone()
    };
    let none = CasterChanges::At(Vec::new());
    let usual = ShadowUpdates::Automatic;
    assert_eq!(change(&mut app, Some(usual)), none, "it was that without");
    for (updates, is_news) in [
        (Some(ShadowUpdates::Never), false),
        (Some(usual), true),
        (Some(ShadowUpdates::Always), true),
        (None, false),
        (Some(ShadowUpdates::Never), false),
        (None, true),
        (Some(usual), false),
        (None, false),
    ] {
        let is_news_of = change(&mut app, updates) != none;
        assert_eq!(is_news_of, is_news, "{updates:?}");
        for _ in 0..150 {
            app.update();
        }
        for _ in 0..3 {
            let again = updates.is_some() && change(&mut app, updates) != none;
            assert!(!again, "{updates:?} once more");
        }
    }
    // Where maps have it need not be where it is.
    change(&mut app, Some(ShadowUpdates::Never));
    lift(&mut app, &boxes[..1], 500.0);
    app.update();
    assert_eq!(change(&mut app, Some(usual)), CasterChanges::Anywhere);

    // Who hides it meanwhile has it rest, too.
    change(&mut app, Some(ShadowUpdates::Always));
    app.world_mut()
        .entity_mut(caster)
        .insert(Visibility::Hidden);
    change(&mut app, Some(ShadowUpdates::Always));
    app.world_mut()
        .entity_mut(caster)
        .insert(Visibility::Inherited);
    change(&mut app, Some(ShadowUpdates::Never));
    let moving = app.world().resource::<ChangedCasters>().moving();
    assert!(!moving.contains(caster));
}

/// Joints that move and weights that are written are found, whoever has them.
#[test]
fn poses_are_followed() {
    let (mut app, boxes, ..) = at_rest();
    let world = app.world_mut();
    let joint = world.spawn(Transform::default()).id();
    let weights = world.spawn(MorphWeights::default()).id();
    let [skinned, morphed, referring] = [boxes[0], boxes[1], boxes[2]];
    world.entity_mut(skinned).insert(SkinnedMesh {
        joints: vec![joint],
        ..default()
    });
    let own = MeshMorphWeights::Value { weights: vec![0.0] };
    world.entity_mut(morphed).insert(own);
    let referred = MeshMorphWeights::Reference(weights);
    world.entity_mut(referring).insert(referred);
    let is_moving = |app: &App, caster| {
        let changed = app.world().resource::<ChangedCasters>();
        changed.moving().contains(caster)
    };
    let mut moves = |caster: Entity, change: &dyn Fn(&mut World)| {
        for _ in 0..150 {
            app.update();
        }
        assert!(!is_moving(&app, caster));
        change(app.world_mut());
        app.update();
        is_moving(&app, caster)
    };
    assert!(moves(skinned, &|world| {
        world.get_mut::<Transform>(joint).unwrap().translation.x = 1.0;
    }));
    assert!(moves(morphed, &|world| {
        world
            .get_mut::<MeshMorphWeights>(morphed)
            .unwrap()
            .set_changed();
    }));
    assert!(moves(referring, &|world| {
        world
            .get_mut::<MorphWeights>(weights)
            .unwrap()
            .set_changed();
    }));
    assert!(!moves(skinned, &|_| ()));
}

/// What has `ShadowUpdates` is compared only once it has been written to, and what is always drawn in each frame.
#[test]
fn updates_that_change_nothing_cost_nothing() {
    let (mut app, boxes, view, light) = at_rest();
    for caster in &boxes[..400] {
        app.world_mut()
            .entity_mut(*caster)
            .insert(ShadowUpdates::Never);
    }
    let near = *boxes.iter().max_by_key(|it| it.index()).unwrap();
    app.world_mut()
        .entity_mut(near)
        .insert((ShadowUpdates::Always, Transform::from_xyz(0.0, 0.5, -12.0)));
    for _ in 0..5 {
        app.update();
    }
    let moving = || app.world().resource::<ChangedCasters>().moving();
    assert!(moving().contains(near));
    assert_eq!(moving().len(), 1);
    for _ in 0..100 {
        app.update();
    }
    let casters = app.world().get::<CasterCascades>(light).unwrap();
    assert!(
        !casters.moving[&view].is_empty(),
        "it is drawn all the same"
    );
}
