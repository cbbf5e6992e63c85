//! Casters of any shape are listed where an exact test of each says that they matter, whether they rest or move.

use bevy::{
    camera::{primitives::Aabb, visibility::NoFrustumCulling},
    math::{DMat3, DVec3},
    prelude::*,
};
use bevy_pssm::{
    CasterCascades, ShadowPlans, geometry::oriented_box::OrientedBox, plan::CascadeMap, prelude::*,
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

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn casters_of_any_shape_are_listed_where_they_matter(
        shapes in prop::collection::vec(any_shape(), 1..40),
    ) {
        let mut app = app();
        let view = camera(&mut app);
        let light = sun(&mut app, ParallelSplitShadows::default());
        let world = app.world_mut();
        let casters: Vec<Entity> = shapes.iter().map(|shape| {
            let mut caster = world.spawn((Mesh3d::default(), shape.aabb, shape.place, Visibility::default()));
            match shape.reach {
                Reach::Meters(meters) => _ = caster.insert(BoundsMargin(meters)),
                Reach::Everywhere => _ = caster.insert(NoFrustumCulling),
                Reach::Nothing | Reach::OwnSize => {}
            }
            caster.id()
        }).collect();
        let is_displaced = |shape: &Shape| shape.reach == Reach::OwnSize;
        world.resource::<DisplacedMeshes>().update(|known| {
            let casters = casters.iter().zip(&shapes);
            known.extend(casters.filter(|(_, shape)| is_displaced(shape)).map(|(caster, _)| *caster));
        });
        // What is new or displaced counts as moving or not; then all move.
        for frame in 0..3 {
            app.update();
            let world = app.world();
            let plans = &world.get::<ShadowPlans>(light).expect("a light").views[&view];
            let lists = world.get::<CasterCascades>(light).expect("a light");
            for (caster, shape) in casters.iter().zip(&shapes) {
                let moves = frame > 0 || is_displaced(shape);
                let lists = if moves { &lists.moving } else { &lists.views };
                let hull = |map: &CascadeMap| if moves { map.hull_now.clone() } else { map.hull.clone() };
                let place = world.get::<GlobalTransform>(*caster).expect("a place");
                let bounds = bounds(shape, place);
                let matters = |index: &usize| {
                    let map = plans[*index].map.as_ref();
                    map.is_some_and(|map| bounds.as_ref().is_none_or(|bounds| hull(map).intersects_box(bounds)))
                };
                let expected: Vec<usize> = (0..plans.len()).filter(matters).collect();
                let listed = lists[&view].iter().find(|(it, _)| it == caster);
                let listed: Vec<usize> = listed.map(|(_, set)| set.iter().collect()).unwrap_or_default();
                prop_assert_eq!(listed, expected, "frame {}, {:?}", frame, shape);
            }
            for caster in &casters {
                app.world_mut().get_mut::<Transform>(*caster).expect("a place").translation.y += 0.01;
            }
        }
    }
}
