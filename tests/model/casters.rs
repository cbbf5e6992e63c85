//! Casters of any shape are listed where an exact test of each says that they matter, whether they rest or move.

use bevy::{
    camera::{primitives::Aabb, visibility::NoFrustumCulling},
    math::{DMat3, DVec3, Vec3A},
    prelude::*,
};
use bevy_pssm::{
    CascadeSet, CasterCascades, ShadowPlans,
    geometry::{hull::CasterHull, oriented_box::OrientedBox},
    plan::{CascadeMap, CascadePlan},
    prelude::*,
    systems::DisplacedMeshes,
};
use proptest::prelude::*;

use crate::lights::{app, camera, sun};

/// By how much a caster may reach out of its box.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Reach {
    Nothing,
    Meters(f32),
    OwnSize,
    Everywhere,
}

#[derive(Debug, Clone)]
struct Shape {
    place: Transform,
    aabb: Aabb,
    reach: Reach,
}

fn any_shape() -> impl Strategy<Value = Shape> {
    let coordinates = |half: f32| prop::array::uniform3(-half..half).prop_map(Vec3::from_array);
    let scale = prop_oneof![Just(0.0), 0.1..4.0_f32];
    let scale = prop::array::uniform3(scale).prop_map(Vec3::from_array);
    let reach = prop_oneof![
        4 => Just(Reach::Nothing),
        3 => (0.0..200.0_f32).prop_map(Reach::Meters),
        2 => Just(Reach::OwnSize),
        1 => Just(Reach::Everywhere),
    ];
    let parts = (
        coordinates(250.0),
        coordinates(3.0),
        scale,
        coordinates(9.0),
        coordinates(12.0),
    );
    (parts, reach).prop_map(|((place, turn, scale, center, half), reach)| Shape {
        place: Transform::from_translation(place)
            .with_rotation(Quat::from_scaled_axis(turn))
            .with_scale(scale),
        aabb: Aabb {
            center: center.into(),
            half_extents: half.abs().into(),
        },
        reach,
    })
}

/// What a hull is asked about; `None` for everywhere.
fn bounds(shape: &Shape, place: &GlobalTransform) -> Option<OrientedBox> {
    let affine = place.affine();
    let axis = |axis: Vec3| affine.transform_vector3(axis).as_dvec3();
    let axes = DMat3::from_cols(axis(Vec3::X), axis(Vec3::Y), axis(Vec3::Z));
    let half = DMat3::from_diagonal(shape.aabb.half_extents.as_dvec3());
    let half_axes = axes * half;
    let sides = [half_axes.x_axis, half_axes.y_axis, half_axes.z_axis];
    let margin = match shape.reach {
        Reach::Nothing => None,
        Reach::Meters(meters) => Some(f64::from(meters)),
        Reach::OwnSize => Some(sides.map(DVec3::length).into_iter().fold(0.0, f64::max)),
        Reach::Everywhere => return None,
    };
    let around: DVec3 = sides.map(DVec3::abs).into_iter().sum();
    Some(OrientedBox {
        center: axes * shape.aabb.center.as_dvec3() + affine.translation.as_dvec3(),
        half_axes: margin.map_or(half_axes, |margin| DMat3::from_diagonal(around + margin)),
    })
}

/// The cascades whose maps a caster matters to, by one of their hulls.
fn matters(
    plans: &[CascadePlan],
    bounds: Option<&OrientedBox>,
    hull: fn(&CascadeMap) -> &CasterHull,
) -> Vec<usize> {
    let is_met = |index: &usize| {
        let map = plans[*index].map.as_ref();
        map.is_some_and(|map| bounds.is_none_or(|bounds| hull(map).intersects_box(bounds)))
    };
    (0..plans.len()).filter(is_met).collect()
}

fn listed(casters: &[(Entity, CascadeSet)], caster: Entity) -> Vec<usize> {
    let mut found = casters.iter().filter(|(it, _)| *it == caster);
    found
        .next()
        .map_or_else(Vec::new, |(_, cascades)| cascades.iter().collect())
}

/// An app with some shapes in it, its camera and its sun.
struct Crowd {
    app: App,
    view: Entity,
    light: Entity,
    casters: Vec<(Entity, Shape)>,
}

impl Crowd {
    fn new(shadows: ParallelSplitShadows, shapes: Vec<Shape>) -> Self {
        let mut app = app();
        let view = camera(&mut app);
        let light = sun(&mut app, shadows);
        let world = app.world_mut();
        let spawned = shapes.into_iter().map(|shape| {
            let parts = (
                Mesh3d::default(),
                shape.aabb,
                shape.place,
                Visibility::default(),
            );
            let mut caster = world.spawn(parts);
            match shape.reach {
                Reach::Meters(meters) => _ = caster.insert(BoundsMargin(meters)),
                Reach::Everywhere => _ = caster.insert(NoFrustumCulling),
                Reach::Nothing | Reach::OwnSize => {}
            }
            (caster.id(), shape)
        });
        let casters: Vec<(Entity, Shape)> = spawned.collect();
        let displaced = casters
            .iter()
            .filter(|(_, shape)| shape.reach == Reach::OwnSize);
        let displaced = displaced.map(|(caster, _)| *caster);
        world
            .resource::<DisplacedMeshes>()
            .update(|known| known.extend(displaced));
        Self {
            app,
            view,
            light,
            casters,
        }
    }

    fn lift(&mut self) {
        for (caster, _) in &self.casters {
            let mut place = self
                .app
                .world_mut()
                .get_mut::<Transform>(*caster)
                .expect("a place");
            place.translation.y += 0.01;
        }
    }

    /// Updates, and compares what is listed with what should be.
    fn update(&mut self, moves: impl Fn(&Shape) -> bool) {
        self.app.update();
        let world = self.app.world();
        let lists = world.get::<CasterCascades>(self.light).expect("a light");
        let (held, moving) = (&lists.views[&self.view], &lists.moving[&self.view]);
        for (caster, shape) in &self.casters {
            let place = world.get::<GlobalTransform>(*caster).expect("a place");
            let bounds = bounds(shape, place);
            let expected = if moves(shape) {
                [
                    Vec::new(),
                    matters(self.plans(), bounds.as_ref(), |map| &map.hull_now),
                ]
            } else {
                [
                    matters(self.plans(), bounds.as_ref(), |map| &map.hull),
                    Vec::new(),
                ]
            };
            let found = [held, moving].map(|list| listed(list, *caster));
            assert_eq!(found, expected, "{shape:?}");
        }
    }

    fn plans(&self) -> &[CascadePlan] {
        &self
            .app
            .world()
            .get::<ShadowPlans>(self.light)
            .expect("a light")
            .views[&self.view]
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn casters_of_any_shape_are_listed_where_they_matter(
        shapes in prop::collection::vec(any_shape(), 1..40),
    ) {
        let mut crowd = Crowd::new(ParallelSplitShadows::default(), shapes);
        // What is new rests, unless it is displaced; then all move.
        crowd.update(|shape| shape.reach == Reach::OwnSize);
        for _ in 0..2 {
            crowd.lift();
            crowd.update(|_| true);
        }
    }
}

/// What is needed may have left the maps that wait: what moves there is drawn over them all the same.
#[test]
fn what_moves_is_listed_while_its_map_waits() {
    let places = (0..400).map(|i| Vec3::new((i % 20) as f32, 0.05, (i / 20) as f32));
    let shapes = places.map(|place| Shape {
        place: Transform::from_translation(12.0 * (place - Vec3::new(10.0, 0.0, 10.0))),
        aabb: Aabb::from_min_max(Vec3::splat(-0.5), Vec3::splat(0.5)),
        reach: Reach::Nothing,
    });
    let shadows = ParallelSplitShadows {
        delay: 8,
        ..default()
    };
    let mut crowd = Crowd::new(shadows, shapes.collect());
    crowd.update(|_| false);
    let mut left_behind = 0;
    for _ in 0..60 {
        crowd.lift();
        let camera = crowd.app.world_mut().get_mut::<Transform>(crowd.view);
        camera.expect("a camera").rotate_y(0.05);
        crowd.update(|_| true);
        let world = crowd.app.world();
        let is_beyond = |(caster, shape): &&(Entity, Shape)| {
            let place = world.get::<GlobalTransform>(*caster).expect("a place");
            let bounds = bounds(shape, place);
            let needed = matters(crowd.plans(), bounds.as_ref(), |map| &map.hull_now);
            needed != matters(crowd.plans(), bounds.as_ref(), |map| &map.hull) && !needed.is_empty()
        };
        left_behind += crowd.casters.iter().filter(is_beyond).count();
    }
    assert!(left_behind > 0, "no map waited");
}

/// Sticks reach along the diagonal as far as a vertex shader may move them, which is farthest beyond their spheres.
#[test]
fn displaced_casters_are_listed_as_far_as_they_reach() {
    for updates in [ShadowUpdates::Automatic, ShadowUpdates::Never] {
        let across = Vec3::new(1.0, 1.0, 0.0).normalize();
        let shape = |away: f32| Shape {
            place: Transform::from_translation(Vec3::new(0.0, 0.0, -20.0) + away * across)
                .with_rotation(Quat::from_rotation_arc(Vec3::X, Vec3::ONE.normalize()))
                .with_scale(Vec3::X),
            aabb: Aabb {
                half_extents: Vec3A::X * 30.0,
                ..default()
            },
            reach: Reach::OwnSize,
        };
        let shapes = (-300..300).map(|away| shape(away as f32)).collect();
        let mut crowd = Crowd::new(ParallelSplitShadows::default(), shapes);
        for (caster, _) in &crowd.casters {
            crowd.app.world_mut().entity_mut(*caster).insert(updates);
        }
        crowd.update(|_| updates == ShadowUpdates::Automatic);
    }
}
