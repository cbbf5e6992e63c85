//! Maps that are fitted to what receives shadows, warped or not: what they must cover, and what they
//! must not do.

use bevy::math::{DMat3, DVec2, DVec3, DVec4, Quat, UVec2, Vec3};
use bevy_pssm::{
    geometry::{
        body::ConvexBody,
        face::Wedge,
        fit::LookupReach,
        hysteresis::{Hold, Kept, SHRINK_DELAY, Slack},
        light_frame::LightFrame,
        mesh_boxes::part_boxes,
        oriented_box::OrientedBox,
        receivers::{Extent, Receivers},
        slice::{Depth, Slice, ViewVolume},
        warp::WarpFrame,
    },
    plan::{
        CascadePlan, CasterChanges, PlanHistory, PlanInputs, Redraw, plan_cascades, warp_frame,
    },
    prelude::*,
};
use proptest::prelude::*;

use crate::views::{any_direction, any_turn, in_picture, perspective, sees, volume};

const REACH: LookupReach = LookupReach { texels: 6.0 };
const SIZE: u32 = 1024;

/// A box along the world's axes.
#[derive(Debug, Clone, Copy)]
pub struct Thing {
    pub center: DVec3,
    pub half: DVec3,
}

impl Thing {
    /// Its lower and its upper corner.
    pub fn ends(&self) -> [DVec3; 2] {
        [self.center - self.half, self.center + self.half]
    }
}

/// Things that a camera sees, if they are there.
pub fn receivers_of(view: &ViewVolume, things: &[Thing]) -> Receivers {
    let mut receivers = Receivers::new(view);
    for thing in things {
        receivers.add(&OrientedBox {
            center: thing.center,
            half_axes: DMat3::from_diagonal(thing.half),
        });
    }
    receivers
}

/// A camera and what there is.
#[derive(Debug, Clone)]
struct Scene {
    eye: DVec3,
    turn: Quat,
    fov: f32,
    aspect: f32,
    things: Vec<Thing>,
}

impl Scene {
    fn view(&self) -> ViewVolume {
        let lens = perspective(self.fov, self.aspect);
        volume(&lens, self.eye.as_vec3(), self.turn)
    }

    fn receivers(&self, view: &ViewVolume) -> Receivers {
        receivers_of(view, &self.things)
    }

    fn plan(&self, config: &ParallelSplitShadows, to_light: DVec3) -> Vec<CascadePlan> {
        self.plan_after(config, to_light, &mut PlanHistory::default())
    }

    fn plan_after(
        &self,
        config: &ParallelSplitShadows,
        to_light: DVec3,
        history: &mut PlanHistory,
    ) -> Vec<CascadePlan> {
        let view = self.view();
        let inputs = PlanInputs {
            view: &view,
            light: &LightFrame::new(to_light).expect("a direction"),
            config,
            reach: REACH,
            receivers: &self.receivers(&view),
            image_height: 1080.0,
            changes: &CasterChanges::At(Vec::new()),
        };
        plan_cascades(&inputs, history)
    }
}

fn forward(view: &ViewVolume) -> DVec3 {
    -view.axes.z_axis
}

fn scene() -> impl Strategy<Value = Scene> {
    let thing = (
        prop::array::uniform3(-300.0..300.0_f64),
        prop::array::uniform3(-2.0..2.5_f64),
    )
        .prop_map(|(at, size)| Thing {
            center: DVec3::from(at) * DVec3::new(1.0, 0.2, 1.0),
            half: DVec3::from(size.map(|size| 10_f64.powf(size))),
        });
    (
        prop::array::uniform3(-50.0..50.0_f32),
        any_turn(),
        0.2..2.2_f32,
        0.4..3.0_f32,
        prop::collection::vec(thing, 1..6),
        prop::bool::weighted(0.3),
    )
        .prop_map(|(eye, turn, fov, aspect, mut things, far_off)| {
            // 20 km from the origin, too.
            let offset = if far_off {
                DVec3::new(20_000.0, 0.0, -20_000.0)
            } else {
                DVec3::ZERO
            };
            things.iter_mut().for_each(|it| it.center += offset);
            Scene {
                eye: (Vec3::from(eye).as_dvec3() + offset).as_vec3().as_dvec3(),
                turn,
                fov,
                aspect,
                things,
            }
        })
}

fn fit() -> impl Strategy<Value = CascadeFit> {
    prop_oneof![
        Just(CascadeFit::Stable),
        Just(CascadeFit::Tight),
        Just(CascadeFit::Faces),
        (0.0..1.0_f32).prop_map(|share| CascadeFit::Auto { sharpness: share }),
        warp().prop_map(CascadeFit::Warped),
        Just(CascadeFit::PerCascade(vec![
            MapFit::Stable,
            MapFit::Tight,
            MapFit::Warped(MapWarp::Minimax),
            MapFit::Warped(MapWarp::Strength(1.0)),
        ])),
    ]
}

pub fn warp() -> impl Strategy<Value = MapWarp> {
    prop_oneof![
        Just(MapWarp::Minimax),
        Just(MapWarp::Lispsm),
        (-1.0..1.0_f32).prop_map(|eta| MapWarp::Lloyd { eta }),
        (0.01..0.8_f32).prop_map(|focus| MapWarp::Trapezoid { focus }),
        (0.0..1.0_f32).prop_map(MapWarp::Strength),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10_000))]

    /// Whatever of a receiver lies in a slice lies in the map, guard and all, with a positive w, and
    /// what is above it on its ray of light has the same place, nearer to the light.
    #[test]
    fn receivers_in_the_slice_are_in_the_map(
        scene in scene(),
        to_light in any_direction(),
        fit in fit(),
        slack in prop_oneof![Just(0.0), 0.01..0.5_f32],
        axis in prop_oneof![Just(WarpAxis::View), Just(WarpAxis::BodyCenter)],
        spots in prop::collection::vec((0..6_usize, prop::array::uniform3(-1.0..1.0_f64)), 40),
        // Where in the picture, and how deep.
        rays in prop::collection::vec(prop::array::uniform3(0.0..1.0_f64), 20),
        way in 0.0..500.0_f64,
    ) {
        let config = ParallelSplitShadows {
            fit,
            slack,
            comparison: Comparison {
                warp_axis: axis,
                ..Default::default()
            },
            map_size: MapSize::Same(SIZE),
            far: 400.0,
            ..Default::default()
        };
        let view = scene.view();
        let plans = scene.plan(&config, to_light);
        let within = |point: DVec3| {
            scene.things.iter().any(|it| (point - it.center).abs().cmple(it.half).all())
        };
        let of_boxes = spots.iter().map(|(index, at)| {
            let thing = scene.things[index % scene.things.len()];
            thing.center + thing.half * DVec3::from(*at)
        });
        let of_rays = rays.iter().map(|[x, y, depth]| {
            let depth = 0.1 * 4000_f64.powf(*depth);
            in_picture(&view, 2.0 * DVec2::new(*x, *y) - 1.0, depth)
        });
        let is_seen = |point: &DVec3| sees(&view, *point) && within(*point);
        for point in of_boxes.chain(of_rays).filter(is_seen) {
            let depth = view.depth_of(point);
            let mut found = 0;
            for (index, cascade) in plans.iter().enumerate() {
                // Cascades that are not used end where the last one does.
                let unused = plans[..index].iter().any(|it| it.far == cascade.far);
                let outside = |wedge: &Wedge| {
                    wedge.planes.iter().any(|it| it.normal.dot(point) > it.distance)
                };
                if depth < cascade.near
                    || depth >= cascade.far
                    || (unused && cascade.wedge.is_none())
                    || cascade.wedge.as_ref().is_some_and(outside)
                {
                    continue;
                }
                found += 1;
                let map = cascade.map.as_ref();
                prop_assert!(map.is_some(), "no map for {point} at {depth}");
                let map = map.unwrap();
                for matrix in [map.clip_from_world, map.clip_from_cascade, map.world_from_cascade] {
                    prop_assert!(matrix.as_mat4().is_finite());
                }
                let clip = map.clip_from_world * point.extend(1.0);
                prop_assert!(clip.w >= 1.0 - 1e-9, "w is {}", clip.w);
                let ndc = clip.truncate() / clip.w;
                // Half a texel.
                let most = 1.0 - (2.0 * REACH.texels - 1.0) / f64::from(SIZE);
                prop_assert!(ndc.truncate().abs().max_element() <= most, "{ndc} in {map:?}");
                prop_assert!((0.0..=1.0).contains(&ndc.z), "{ndc}");

                let above = map.clip_from_world * (point + way * to_light).extend(1.0);
                let moved = above.truncate() / above.w - ndc;
                prop_assert!(moved.truncate().abs().max_element() < 1e-6, "{moved}");
                prop_assert!(moved.z >= -1e-9, "{moved}");
                let caster = OrientedBox {
                    center: point + way * to_light,
                    half_axes: DMat3::from_diagonal(DVec3::splat(0.1)),
                };
                prop_assert!(map.hull.intersects_box(&caster));
            }
            prop_assert!(depth >= f64::from(config.far) || found > 0, "nothing is for {point} at {depth}");
        }
    }

}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 10_000,
        // Half the scenes have nothing in the slice.
        max_global_rejects: 100_000,
        ..ProptestConfig::default()
    })]

    /// The default warp is no worse than none, as predicted, but for a hundredth.
    #[test]
    fn the_default_warp_never_costs_storage(scene in scene(), to_light in any_direction()) {
        let view = scene.view();
        let slice = view.slice(1.0, 300.0).expect("not empty");
        let found = scene.receivers(&view).in_slices([Some(&slice)])[0];
        prop_assume!(!found.is_empty());
        let body = ConvexBody::of_slice(&slice).within(found.planes(&Depth::new(&view)));
        prop_assume!(body.faces().len() > 3);
        let (frame, strength) =
            warp_frame(MapWarp::Minimax, forward(&view), &view, to_light, &body).unwrap();
        let vertices = body.vertices(&view);
        let storage = |strength| frame.worst_aliasing(&vertices, strength).unwrap().storage();
        prop_assert!(strength >= 0.0 && strength.is_finite());
        let [warped, unwarped] = [strength, 0.0].map(storage);
        prop_assert!(warped <= 1.02 * unwarped, "{warped} {unwarped}");
    }
}

/// The box around what things have in a slice, each clipped by itself.
fn exact_extent(scene: &Scene, view: &ViewVolume, slice: &Slice) -> [DVec4; 2] {
    let parts = scene.things.iter().map(|thing| {
        let [lo, hi] = thing.ends();
        ConvexBody::of_box(lo, hi).within(ConvexBody::of_slice(slice).planes())
    });
    let corners = parts.flat_map(|part| part.corners);
    let at = corners.map(|corner| corner.extend(view.depth_of(corner)));
    at.fold([DVec4::INFINITY, DVec4::NEG_INFINITY], |[lo, hi], at| {
        [lo.min(at), hi.max(at)]
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    #[test]
    fn receivers_are_clipped_exactly(scene in scene(), near in 0.0..200.0_f64, length in 1.0..400.0_f64) {
        let view = scene.view();
        let slice = view.slice(near, near + length).expect("not empty");
        let found = scene.receivers(&view).in_slices([Some(&slice)])[0];
        let [lo, hi] = exact_extent(&scene, &view, &slice);
        // Boxes that only touch the slice may count or not.
        let exact = Extent { lo, hi };
        if found.is_empty() || exact.is_empty() {
            let size = |it: &Extent| (it.hi - it.lo).max_element();
            prop_assert!(size(&found).max(size(&exact)) < 1e-3, "{found:?} {exact:?}");
        } else {
            let off = (found.lo - lo).abs().max((found.hi - hi).abs()).max_element();
            prop_assert!(off < 1e-6 * slice.radius, "{found:?} {exact:?}");
        }
    }

    /// Every triangle is wholly in a part, and parts are no larger than they must be.
    #[test]
    fn parts_hold_their_triangles(
        size in prop::array::uniform3(0.0..100.0_f32),
        places in prop::collection::vec(prop::array::uniform9(0.0..1.0_f32), 0..400),
        has_nan in prop::bool::ANY,
    ) {
        let mut triangles: Vec<[Vec3; 3]> = places
            .iter()
            .map(|at| {
                let corner = |i: usize| Vec3::new(at[i], at[i + 1], at[i + 2]);
                let first = corner(0);
                [first, first + 0.1 * corner(3), first + 0.1 * corner(6)]
                    .map(|corner| corner * Vec3::from(size))
            })
            .collect();
        let sound = triangles.clone();
        if has_nan {
            triangles.push([Vec3::NAN; 3]);
        }
        let found = part_boxes(|| triangles.iter().copied());
        prop_assert!(found.len() <= sound.len().min(1024));
        for triangle in &sound {
            let holds = |[lo, hi]: &[Vec3; 2]| {
                triangle.iter().all(|at| lo.cmple(*at).all() && hi.cmpge(*at).all())
            };
            prop_assert!(found.iter().any(holds), "{triangle:?}");
        }
        let corner = |at: &Vec3| sound.iter().flatten().any(|corner| corner.cmpeq(*at).any());
        for part in &found {
            prop_assert!(part.iter().all(corner), "{part:?}");
        }
    }
}

/// A terrain of one piece is known by its parts.
#[test]
fn parts_of_a_terrain_are_small() {
    let height = |x: f32, z: f32| 200.0 * (0.01 * x).sin() * (0.01 * z).cos();
    let at = |i: usize, j: usize| {
        let (x, z) = (10.0 * i as f32, 10.0 * j as f32);
        Vec3::new(x, height(x, z), z)
    };
    let cells = || (0..100).flat_map(|i| (0..100).map(move |j| (i, j)));
    let ground = || {
        cells().flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)];
            [[a, b, c], [c, b, d]]
        })
    };
    // Walls below its far ends.
    let walls = || {
        (0..100).flat_map(|i| {
            [[at(100, i), at(100, i + 1)], [at(i, 100), at(i + 1, 100)]]
                .map(|[a, b]| [a, b, a - 5.0 * Vec3::Y])
        })
    };
    // And standing on either side.
    let turns: [fn(Vec3) -> Vec3; 3] = [
        |it| it,
        |it| Vec3::new(it.y, it.x, it.z),
        |it| Vec3::new(it.x, it.z, it.y),
    ];
    for turn in turns {
        let triangles = || ground().chain(walls());
        let found = part_boxes(|| triangles().map(move |triangle| triangle.map(turn)));
        assert!((100..250).contains(&found.len()), "{}", found.len());
        for [lo, hi] in found {
            let size = turn(hi - lo);
            assert!(size.max_element() <= 260.0 && size.x.max(size.z) <= 100.0);
        }
    }
    assert!(part_boxes(core::iter::empty).is_empty());
}

/// The strength at a moment of a motion of sun and camera, in units of what makes it matter: the
/// reciprocal of the body's length.
fn strength_at(scene: &Scene, warp: MapWarp, to_light: DVec3, time: f64) -> f64 {
    let swing = DVec3::new((3.0 * time).sin(), (2.0 * time).cos(), time.sin());
    let to_light = (to_light + 0.3 * swing).normalize();
    let lens = perspective(scene.fov, scene.aspect);
    let still = volume(&lens, Vec3::ZERO, Quat::IDENTITY);
    let turn =
        DMat3::from_quat(scene.turn.as_dquat().normalize()) * DMat3::from_rotation_y(0.2 * time);
    let view = ViewVolume {
        eye: scene.eye + 5.0 * time * DVec3::X,
        axes: turn,
        ..still
    };
    let slice = view.slice(2.0, 150.0).expect("not empty");
    let body = ConvexBody::of_slice(&slice);
    match warp_frame(warp, forward(&view), &view, to_light, &body) {
        Some((_, strength)) => strength * slice.radius,
        None => f64::NAN,
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    /// Where the strength changes much between two moments, it is found to change little between
    /// moments that are near each other.
    #[test]
    fn strengths_are_continuous(scene in scene(), warp in warp(), to_light in any_direction(), start in 0.0..6.0_f64) {
        let at = |time| strength_at(&scene, warp, to_light, time);
        let (mut before, mut after) = (start, start + 0.01);
        let mut ends = [at(before), at(after)];
        // Halving time halves a steep change, and leaves a jump.
        for _ in 0..36 {
            let middle = 0.5 * (before + after);
            let value = at(middle);
            if (value - ends[0]).abs() > (ends[1] - value).abs() {
                (after, ends[1]) = (middle, value);
            } else {
                (before, ends[0]) = (middle, value);
            }
        }
        let jump = (ends[1] - ends[0]).abs();
        prop_assert!(jump < 1e-3, "{warp:?} jumps by {jump} at {before}");
    }

    /// As the light turns to the view's direction, the map becomes the unwarped one.
    #[test]
    fn maps_converge_to_unwarped_ones(scene in scene(), warp in warp(), side in 0.0..core::f64::consts::TAU) {
        let view = scene.view();
        let slice = view.slice(2.0, 150.0).expect("not empty");
        let body = ConvexBody::of_slice(&slice);
        let vertices = body.vertices(&view);
        let across = view.axes * DVec3::new(side.cos(), side.sin(), 0.0);
        let differences = [1e-3, 1e-5].map(|angle| {
            let to_light = (view.axes.z_axis + angle * across).normalize();
            let (frame, strength) =
                warp_frame(warp, forward(&view), &view, to_light, &body).unwrap();
            let map = |strength| frame.clip_from_world(&vertices, strength);
            let [warped, plain] = [map(strength), map(0.0)];
            slice
                .corners
                .iter()
                .map(|corner| warped.project_point3(*corner) - plain.project_point3(*corner))
                .map(|difference| difference.truncate().abs().max_element())
                .fold(0.0, f64::max)
        });
        prop_assert!(differences[1] <= 0.02, "{differences:?}");
        prop_assert!(differences[1] <= differences[0] + 1e-9, "{differences:?}");
    }
}

/// A fitted map of a resting scene does not change while the camera moves and turns a little.
#[test]
fn slack_holds_maps_still() {
    let scene = |step: u32| Scene {
        eye: DVec3::new(0.0, 1.7, 0.01 * f64::from(step)),
        turn: Quat::from_rotation_y(0.3 + 0.0005 * step as f32),
        fov: 1.0,
        aspect: 1.6,
        things: vec![
            Thing {
                center: DVec3::ZERO,
                half: DVec3::new(400.0, 0.1, 400.0),
            },
            // Something that moves.
            Thing {
                center: DVec3::new(3.0, 1.0, -20.0 + 0.02 * f64::from(step)),
                half: DVec3::ONE,
            },
        ],
    };
    let changes = |slack: f32| {
        let config = ParallelSplitShadows {
            fit: CascadeFit::Tight,
            slack,
            ..Default::default()
        };
        let to_light = DVec3::new(0.3, 0.7, -0.45);
        let mut history = PlanHistory::default();
        let mut before: Option<Vec<CascadePlan>> = None;
        let mut changes = 0;
        for step in 0..100 {
            let plans = scene(step).plan_after(&config, to_light, &mut history);
            for (now, before) in plans.iter().zip(before.iter().flatten()) {
                let texel = |plan: &CascadePlan| plan.map.as_ref().unwrap().texel;
                changes += usize::from(texel(now) != texel(before) || now.far != before.far);
            }
            before = Some(plans);
        }
        changes
    };
    let [held, loose] = [0.1, 0.0].map(changes);
    assert!(held <= 8, "{held} of 396 maps changed");
    assert!(loose > 300, "{loose} of 396 maps changed");
}

/// From above, over flat ground, cascades are not spent on the air in between.
#[test]
fn splits_are_spread_where_there_is_anything() {
    let scene = Scene {
        eye: DVec3::new(0.0, 300.0, 0.0),
        turn: Quat::from_rotation_x(-1.2),
        fov: 0.8,
        aspect: 1.6,
        things: vec![Thing {
            center: DVec3::ZERO,
            half: DVec3::new(900.0, 5.0, 900.0),
        }],
    };
    let with = |fit, focus| {
        let config = ParallelSplitShadows {
            fit,
            comparison: Comparison {
                focus,
                ..Default::default()
            },
            far: 800.0,
            ..Default::default()
        };
        scene.plan(&config, DVec3::new(0.5, 0.8, 0.1).normalize())
    };
    let focused = with(CascadeFit::Tight, ShadowFocus::Receivers);
    assert!(focused.iter().all(|cascade| cascade.map.is_some()));
    assert!(focused[0].far > 200.0, "{}", focused[0].far);
    let last = &focused[3];
    assert!(focused[2].far < 600.0, "{}", focused[2].far);

    // Stable maps keep their planes, and those in the air stay empty.
    let stable = with(CascadeFit::Stable, ShadowFocus::Receivers);
    assert_eq!(stable[3].far, 800.0);
    assert!(stable[0].map.is_none() && stable[3].map.is_some());
    let whole = with(CascadeFit::Tight, ShadowFocus::Off);
    assert!(whole.iter().all(|cascade| cascade.map.is_some()));
    assert_eq!((last.far, whole[3].far), (800.0, 800.0));
    assert_eq!(
        last.blend_start, whole[3].blend_start,
        "fading does not move"
    );
    let texel = |plan: &CascadePlan| plan.map.as_ref().unwrap().texel.max_element();
    assert!(texel(last) < 0.8 * texel(&whole[3]));
}

#[test]
fn nothing_to_shadow_is_no_map() {
    let scene = Scene {
        eye: DVec3::ZERO,
        turn: Quat::IDENTITY,
        fov: 1.0,
        aspect: 1.0,
        things: vec![Thing {
            center: DVec3::new(0.0, 0.0, 50.0),
            half: DVec3::ONE,
        }],
    };
    for fit in [
        CascadeFit::Stable,
        CascadeFit::Tight,
        CascadeFit::Warped(MapWarp::Minimax),
    ] {
        let config = ParallelSplitShadows {
            fit,
            ..Default::default()
        };
        let plans = scene.plan(&config, DVec3::Y);
        assert!(plans.iter().all(|cascade| cascade.map.is_none()));
    }
}

/// Trapezoidal maps give what lies nearer than the focus four fifths of the map.
#[test]
fn trapezoids_put_the_focus_on_their_line() {
    let lens = perspective(0.6, 1.0);
    let view = volume(&lens, Vec3::ZERO, Quat::IDENTITY);
    let (near, far, share) = (5.0, 100.0, 0.4_f32);
    let body = ConvexBody::of_slice(&view.slice(near, far).unwrap());
    let warp = MapWarp::Trapezoid { focus: share };
    let (frame, strength) = warp_frame(warp, forward(&view), &view, DVec3::Y, &body).unwrap();
    assert!(strength > 0.0);
    let map = frame.clip_from_world(&body.vertices(&view), strength);
    let focus = DVec3::NEG_Z * (near + f64::from(share) * (far - near));
    approx::assert_relative_eq!(map.project_point3(focus).y, 0.6, epsilon = 1e-9);
}

/// The family of Lloyd et al. 2006 has the others in it.
#[test]
fn etas_are_known_warps() {
    let view = volume(&perspective(1.0, 1.0), Vec3::ZERO, Quat::IDENTITY);
    let frame = WarpFrame::of_view(&view, DVec3::Y).unwrap();
    let (near, far) = (2.0, 300.0);
    assert_eq!(frame.lloyd_strength(-1.0, near, far), 0.0);
    let strength = frame.lloyd_strength(0.0, near, far);
    assert_eq!(strength, frame.lispsm_strength(near, far));
    approx::assert_relative_eq!(frame.lloyd_strength(1.0, near, far), 0.5);
    // The greatest error along the warp is linear in the size of eta (Lloyd et al. 2006, Eq. 11).
    let body = ConvexBody::of_slice(&view.slice(near, far).unwrap());
    let vertices = body.vertices(&view);
    let worst = |eta| {
        let strength = frame.lloyd_strength(eta, near, far);
        frame.worst_aliasing(&vertices, strength).unwrap().z
    };
    for [a, b, c] in [[-1.0, -0.5, 0.0], [0.0, 0.5, 1.0]] {
        let middle = 0.5 * (worst(a) + worst(c));
        approx::assert_relative_eq!(worst(b), middle, max_relative = 1e-6);
    }
}

/// Kept values grow at once, jitter about a boundary does not move them, and they shrink late.
#[test]
fn what_is_held_does_not_flip() {
    for slack in [0.01_f64, 0.05, 0.1, 0.25, 1.0] {
        for power in 1..60 {
            let boundary = (1.0 + slack).powi(power);
            let mut held = [Kept::default(); 2];
            let mut changes = [0; 2];
            let mut before: Option<[f64; 2]> = None;
            for frame in 0..100 {
                let jitter = 1.0 + 1e-4 * f64::from(frame % 2) - 5e-5;
                let [a, b] = &mut held;
                let now = [
                    Slack(slack).round_up(boundary * jitter, a),
                    Slack(slack).round_down(boundary * jitter, b),
                ];
                assert!(now[0] >= boundary * jitter * (1.0 - 1e-8));
                assert!(now[1] <= boundary * jitter * (1.0 + 1e-8));
                for (changes, (now, before)) in changes
                    .iter_mut()
                    .zip(now.iter().zip(before.iter().flatten()))
                {
                    *changes += usize::from(now != before);
                }
                before = Some(now);
            }
            assert!(
                changes.iter().all(|count| *count <= 1),
                "{slack} {power}: {changes:?}"
            );
        }
        let mut held = Kept::default();
        let mut changes = 0;
        for frame in 0..100 {
            let shift = 1e-3 * f64::from(frame % 2);
            let needed = [-3.0 - shift, 40.0 * slack + shift];
            let before = held;
            let [low, high] = Slack(slack).interval(needed, 10.0, &mut held);
            assert!(low <= needed[0] + 1e-6 && high >= needed[1] - 1e-6);
            changes += usize::from(frame > 0 && before != held);
        }
        assert!(changes <= 1, "{slack}: {changes}");
    }
    let slack = Slack(0.1);
    let mut held = Kept::default();
    let wide = slack.round_up(100.0, &mut held);
    for _ in 0..SHRINK_DELAY {
        assert_eq!(slack.round_up(80.0, &mut held), wide);
    }
    assert!(slack.round_up(80.0, &mut held) < 89.0);
    // Much too large is not held at all.
    assert!(slack.round_up(40.0, &mut held) < 45.0);
    assert!(slack.round_up(120.0, &mut held) >= 120.0);
    for none in [0.0, 1e-17] {
        assert_eq!(Slack(none).round_up(50.0, &mut Kept::default()), 50.0);
    }
}

/// What is to change seldom has half a step to spare when it is new.
#[test]
fn what_is_held_long_has_something_to_spare() {
    let (slack, half_step) = (Slack(0.1), 1.1_f64.sqrt());
    let held = || Kept::with(Hold::LONG);
    for tenth in 0..40 {
        let needed = 1.1_f64.powf(0.1 * f64::from(tenth));
        let [more, less] = [
            slack.round_up(needed, &mut held()),
            slack.round_down(needed, &mut held()),
        ];
        assert!(more >= needed * half_step * (1.0 - 1e-8), "{needed} {more}");
        assert!(less <= needed / half_step * (1.0 + 1e-8), "{needed} {less}");
    }
}

/// What nothing is needed of for a while is let go, as what is much too large is.
#[test]
fn what_is_not_needed_is_not_held_for_ever() {
    let slack = Slack(0.1);
    let mut held = Kept::with(Hold::LONG);
    let long = slack.round_up(100.0, &mut held);
    let wait = |held: &mut Kept<f64>| (0..300).for_each(|_| held.wait());
    wait(&mut held);
    assert_eq!(slack.round_up(60.0, &mut held), long);
    wait(&mut held);
    assert!(slack.round_up(60.0, &mut held) < 70.0);
}

/// What grows steadily leaves more room each time, so that it grows less often.
#[test]
fn what_keeps_growing_changes_seldom() {
    let mut held = Kept::with(Hold::LONG);
    // By thirty steps in all.
    let mut lengths: Vec<f64> = (0..=300)
        .map(|tenth| Slack(0.1).round_up(1.1_f64.powf(0.1 * f64::from(tenth)), &mut held))
        .collect();
    lengths.dedup();
    assert!(lengths.len() <= 12, "{lengths:?}");
}

/// Two lengths of a map grow in fewer frames than if neither knew of the other.
#[test]
fn lengths_of_one_map_grow_together() {
    let slack = Slack(0.1);
    for offset in [0.2, 0.5, 0.8] {
        let needed = |tenth: i32| {
            let steps = 0.1 * f64::from(tenth);
            DVec2::new(steps, 40.0 + offset + 0.9 * steps).map(|steps| 1.1_f64.powf(steps))
        };
        let changes = |round: &mut dyn FnMut(DVec2) -> DVec2| {
            let mut lengths = Vec::new();
            for tenth in 0..=300 {
                let (needed, length) = (needed(tenth), round(needed(tenth)));
                assert!(length.cmpge(needed).all(), "{length} at {tenth}");
                let is_close = length.cmplt(1.1_f64.powi(6) * needed).all();
                assert!(is_close, "{length} at {tenth}");
                lengths.push(length);
            }
            lengths.dedup();
            lengths.len()
        };
        let mut kept = [Kept::with(Hold::LONG); 2];
        let together = changes(&mut |needed| slack.round_up_both(needed, &mut kept));
        let [mut x, mut y] = [Kept::with(Hold::LONG); 2];
        let alone = changes(&mut |needed| {
            DVec2::new(
                slack.round_up(needed.x, &mut x),
                slack.round_up(needed.y, &mut y),
            )
        });
        assert!(
            4 * together <= 3 * alone,
            "{together} lengths, {alone} alone, {offset} steps apart"
        );
    }
}

/// Over flat ground.
fn ground(eye: f64, pitch: f32) -> Scene {
    Scene {
        eye: DVec3::new(0.0, eye, 0.0),
        turn: Quat::from_rotation_x(pitch),
        fov: 0.8,
        aspect: 1.6,
        things: vec![Thing {
            center: DVec3::ZERO,
            half: DVec3::new(900.0, 5.0, 900.0),
        }],
    }
}

/// Things before a camera at the origin that looks along −z.
fn before_the_eye(things: Vec<Thing>) -> Scene {
    Scene {
        things,
        ..ground(0.0, 0.0)
    }
}

/// A steady map of next to nothing is no finer than the picture has a use for.
#[test]
fn steady_maps_are_no_finer_than_pixels() {
    let scene = before_the_eye(vec![Thing {
        center: 40.0 * DVec3::NEG_Z,
        half: DVec3::splat(1e-3),
    }]);
    let config = ParallelSplitShadows {
        fit: CascadeFit::Steady,
        ..Default::default()
    };
    let plans = scene.plan(&config, DVec3::new(0.3, 0.7, -0.45));
    let texel = plans[0].map.as_ref().expect("it is seen").texel;
    // A quarter of a pixel, where the configuration begins.
    let pixel = scene.view().image_height(1.0) / 1080.0;
    assert!(texel.min_element() >= 0.25 * pixel, "{texel} {pixel}");
}

/// What is a hair beyond the end of a slice may be looked up in its map, by the GPU's reckoning.
#[test]
fn slices_have_what_lies_at_their_ends() {
    let scene = before_the_eye(vec![Thing {
        center: DVec3::new(0.0, 0.0, -125.0001),
        half: DVec3::new(10.0, 10.0, 24.9999),
    }]);
    let config = ParallelSplitShadows {
        fit: CascadeFit::Tight,
        splits: SplitScheme::Manual(vec![100.0, 200.0, 300.0]),
        ..Default::default()
    };
    let plans = scene.plan(&config, DVec3::new(0.3, 0.7, -0.45));
    let map = plans[0].map.as_ref().expect("it is at the slice's end");
    let ndc = map.clip_from_world.project_point3(100.0002 * DVec3::NEG_Z);
    assert!(ndc.truncate().abs().max_element() < 1.0 && (0.0..1.0).contains(&ndc.z));
}

/// What rounding has moved out of a view, far from the origin, is still seen.
#[test]
fn views_have_what_lies_on_their_borders() {
    for distance in [1e3, 1e4, 1e5, 1e6] {
        let view = ViewVolume {
            eye: distance * DVec3::X,
            axes: DMat3::IDENTITY,
            min: [DVec2::ZERO, DVec2::NEG_ONE],
            max: [DVec2::ZERO, DVec2::ONE],
            near: 0.0,
            far: f64::INFINITY,
        };
        let thing = Thing {
            center: in_picture(&view, DVec2::X, 2.0) + 4.0 * f64::EPSILON * view.eye,
            half: DVec3::ZERO,
        };
        let slice = view.slice(1.0, 3.0).expect("not empty");
        let found = receivers_of(&view, &[thing]).in_slices([Some(&slice)])[0];
        assert!(!found.is_empty(), "{distance}");
    }
}

/// No cascade gives way before it has taken over, wherever shadows would begin to fade.
#[test]
fn nothing_fades_before_its_slice_begins() {
    let scene = before_the_eye(vec![Thing {
        center: 365.0 * DVec3::NEG_Z,
        half: DVec3::new(10.0, 10.0, 115.0),
    }]);
    let config = ParallelSplitShadows {
        fit: CascadeFit::Tight,
        fade: 1.0,
        ..Default::default()
    };
    let plans = scene.plan(&config, DVec3::new(0.3, 0.7, -0.45));
    assert_eq!(fits_of(&plans), [MapFit::Tight; 4]);
    for pair in plans.windows(2) {
        assert!(pair[1].blend_start >= pair[0].far, "{pair:?}");
    }
}

const NEAR_BY: Thing = Thing {
    center: DVec3::new(0.0, -3.0, -30.0),
    half: DVec3::new(10.0, 1.0, 10.0),
};

/// Where splits are spread over other depths, slices hold on to nothing of what they were.
#[test]
fn other_slices_are_fitted_anew() {
    let far_off = Thing {
        center: DVec3::new(0.0, -3.0, -100.0),
        half: DVec3::ONE,
    };
    let config = ParallelSplitShadows {
        cascades: 1,
        fit: CascadeFit::Tight,
        ..Default::default()
    };
    let mut history = PlanHistory::default();
    before_the_eye(vec![NEAR_BY, far_off]).plan_after(&config, DVec3::Y, &mut history);
    let scene = before_the_eye(vec![NEAR_BY]);
    let plans = [
        scene.plan_after(&config, DVec3::Y, &mut history),
        scene.plan(&config, DVec3::Y),
    ];
    let [after, fresh] = plans.map(|plans| plans[0].map.clone().expect("it is seen"));
    assert_eq!(after.clip_from_world, fresh.clip_from_world);
}

/// Of what has changed while there was no map, nobody knows.
#[test]
fn maps_that_come_back_are_drawn() {
    let (something, nothing) = (before_the_eye(vec![NEAR_BY]), before_the_eye(Vec::new()));
    for fit in [CascadeFit::Stable, CascadeFit::Steady, CascadeFit::Tight] {
        let config = ParallelSplitShadows {
            fit: fit.clone(),
            ..Default::default()
        };
        let mut history = PlanHistory::default();
        let redraws = [&something, &something, &nothing, &something].map(|scene| {
            let plans = scene.plan_after(&config, DVec3::Y, &mut history);
            let map = plans.iter().find_map(|plan| plan.map.as_ref());
            map.map(|map| map.redraw)
        });
        let new = Some(Some(Redraw::New));
        assert_eq!(redraws, [new, Some(None), None, new], "{fit:?}");
    }
}

/// Budgets are kept, equally sharp maps get what they need, and stable ones do not depend on what
/// is in them.
#[test]
fn budgets_are_shared() {
    const BUDGET: u32 = 4 << 20;
    let to_light = DVec3::new(0.3, 0.7, -0.45).normalize();
    let with = |fit, map_size| ParallelSplitShadows {
        fit,
        map_size,
        splits: SplitScheme::Practical { lambda: 0.97 },
        slack: 0.0,
        ..Default::default()
    };
    let texels = |plans: &[CascadePlan]| -> u64 {
        let area = |plan: &CascadePlan| u64::from(plan.map_size.x) * u64::from(plan.map_size.y);
        plans.iter().map(area).sum()
    };
    let sharpness = |plans: &[CascadePlan]| {
        let of = plans
            .iter()
            .filter_map(|plan| plan.texels_per_pixel(1080.0));
        of.fold((f64::INFINITY, 0.0_f64), |(lo, hi), it| {
            (lo.min(it), hi.max(it))
        })
    };
    let scene = ground(10.0, -0.1);
    for fit in [CascadeFit::Tight, CascadeFit::Warped(MapWarp::Minimax)] {
        let plans = scene.plan(&with(fit.clone(), MapSize::Budget(BUDGET)), to_light);
        assert!(texels(&plans) <= u64::from(BUDGET));
        assert!(
            texels(&plans) > u64::from(BUDGET) * 7 / 10,
            "{}",
            texels(&plans)
        );
        let (least, most) = sharpness(&plans);
        let (even, uneven) = sharpness(&scene.plan(&with(fit, MapSize::Same(1024)), to_light));
        assert!(least > even, "{least} {even}");
        assert!(
            most / least < uneven / even,
            "{most} {least} {uneven} {even}"
        );
    }
    // A bound for what is drawn, and twice that for what is allocated, however small.
    for budget in [4 << 14, BUDGET] {
        for eye in [1.0, 1.7, 10.0, 60.0] {
            for pitch in [0.0, -0.3, -1.5] {
                for fit in [
                    CascadeFit::Steady,
                    CascadeFit::Stable,
                    CascadeFit::Tight,
                    CascadeFit::Warped(MapWarp::Minimax),
                    CascadeFit::Auto { sharpness: 1.0 },
                    CascadeFit::Faces,
                    CascadeFit::PerCascade(vec![
                        MapFit::Warped(MapWarp::Minimax),
                        MapFit::Tight,
                        MapFit::Steady,
                        MapFit::Stable,
                    ]),
                ] {
                    let config = with(fit.clone(), MapSize::Budget(budget));
                    let plans = ground(eye, pitch).plan(&config, to_light);
                    let layer = plans.iter().map(|plan| plan.map_size);
                    let layer = layer.reduce(UVec2::max).unwrap_or_default();
                    let allocated = u64::from(layer.x) * u64::from(layer.y) * plans.len() as u64;
                    assert!(texels(&plans) <= u64::from(budget), "{fit:?} {eye} {pitch}");
                    assert!(allocated <= 2 * u64::from(budget), "{fit:?} {eye} {pitch}");
                }
            }
        }
    }
    let stable = with(CascadeFit::Stable, MapSize::Budget(BUDGET));
    let sizes = |scene: &Scene| -> Vec<_> {
        let plans = scene.plan(&stable, to_light);
        plans.iter().map(|plan| plan.map_size).collect()
    };
    assert_eq!(sizes(&scene)[..3], sizes(&ground(12.0, -0.3))[..3]);
}

/// However long and thin what is seen is, its map takes no more than its share.
#[test]
fn flat_maps_keep_to_budgets() {
    const BUDGET: u32 = 2 * 128 * 128;
    let strip = Thing {
        center: DVec3::new(0.0, -3.0, -100.0),
        half: DVec3::new(20.0, 0.5, 0.5),
    };
    let config = ParallelSplitShadows {
        cascades: 2,
        fit: CascadeFit::Tight,
        splits: SplitScheme::Manual(vec![50.0]),
        map_size: MapSize::Budget(BUDGET),
        ..Default::default()
    };
    let plans = before_the_eye(vec![NEAR_BY, strip]).plan(&config, DVec3::new(0.0, 1.0, 0.1));
    assert_eq!(fits_of(&plans), [MapFit::Tight; 2]);
    let sizes: Vec<UVec2> = plans.iter().map(|plan| plan.map_size).collect();
    let texels: u32 = sizes.iter().map(|size| size.element_product()).sum();
    assert!(texels <= BUDGET, "{sizes:?}");
}

/// Even without slack: with the largest map all memory is allocated anew.
#[test]
fn shares_of_budgets_change_in_steps() {
    let config = ParallelSplitShadows {
        fit: CascadeFit::Tight,
        map_size: MapSize::Budget(4 << 20),
        slack: 0.0,
        ..Default::default()
    };
    let mut history = PlanHistory::default();
    let sizes: Vec<Vec<UVec2>> = (0..60)
        .map(|step| {
            let scene = ground(10.0, -0.1 - 0.002 * step as f32);
            let plans = scene.plan_after(&config, DVec3::new(0.3, 0.7, -0.45), &mut history);
            plans.iter().map(|plan| plan.map_size).collect()
        })
        .collect();
    let pairs = sizes
        .windows(2)
        .flat_map(|pair| pair[0].iter().zip(&pair[1]));
    let changes = pairs.filter(|(before, now)| before != now).count();
    assert!(changes <= 12, "{changes} of 236 maps changed");
}

/// Of the maps that there are.
fn fits_of(plans: &[CascadePlan]) -> Vec<MapFit> {
    let maps = plans.iter().filter_map(|plan| plan.map.as_ref());
    maps.map(|map| map.fit).collect()
}

/// Choices are held, and released when they are no longer worth it.
#[test]
fn auto_chooses_what_is_worth_it() {
    let to_light = DVec3::new(0.3, 0.9, -0.1).normalize();
    let fits = |sharpness, size, scene: &Scene| -> Vec<MapFit> {
        let config = ParallelSplitShadows {
            fit: CascadeFit::Auto { sharpness },
            map_size: MapSize::Same(size),
            ..Default::default()
        };
        fits_of(&scene.plan(&config, to_light))
    };
    let scene = ground(10.0, -0.1);
    let stable = fits(0.0, 1024, &scene);
    assert!(
        stable.iter().all(|fit| *fit == MapFit::Stable),
        "{stable:?}"
    );
    let sharp = fits(1.0, 512, &scene);
    assert!(sharp.iter().all(|fit| *fit != MapFit::Stable), "{sharp:?}");
    let some = fits(0.2, 512, &scene);
    let steady = |fits: &[MapFit]| fits.iter().filter(|it| **it == MapFit::Stable).count();
    assert!(steady(&some) >= steady(&sharp), "{some:?}");
    // Maps that are fine enough need nothing.
    let fine = fits(0.1, 16384, &scene);
    assert!(steady(&fine) > 0, "{fine:?}");

    // From straight above one depth holds everything.
    let count = |scene: &Scene| fits(1.0, 1024, scene).len();
    assert_eq!(count(&scene), 4);
    assert!(count(&ground(300.0, -1.57)) <= 2);
}

/// While a camera rests, choices do, however near to each other fits are.
#[test]
fn choices_rest_with_the_camera() {
    let scene = ground(10.0, -0.1);
    for percent in (10..=60).step_by(2) {
        let config = ParallelSplitShadows {
            fit: CascadeFit::Auto {
                sharpness: 0.01 * percent as f32,
            },
            map_size: MapSize::Same(512),
            ..Default::default()
        };
        let mut history = PlanHistory::default();
        let [first, second] = [(); 2].map(|()| {
            let to_light = DVec3::new(0.3, 0.9, -0.1);
            fits_of(&scene.plan_after(&config, to_light, &mut history))
        });
        assert_eq!(first, second, "{percent} %");
    }
}

/// As the view turns from the horizon to the feet, cascades that have gained something are let go.
#[test]
fn cascades_that_gain_nothing_are_let_go() {
    let config = ParallelSplitShadows {
        fit: CascadeFit::Auto { sharpness: 1.0 },
        map_size: MapSize::Same(16384),
        ..Default::default()
    };
    let to_light = DVec3::new(0.3, 0.9, -0.1);
    let mut history = PlanHistory::default();
    let counts: Vec<usize> = (0..=40)
        .map(|step| {
            let scene = ground(10.0, -1.57 * step as f32 / 40.0);
            fits_of(&scene.plan_after(&config, to_light, &mut history)).len()
        })
        .collect();
    let fresh = fits_of(&ground(10.0, -1.57).plan(&config, to_light)).len();
    assert!(counts[0] > fresh && counts[40] == fresh, "{counts:?}");
}

/// While a camera moves, choices and layouts change seldom, and not to and fro.
#[test]
fn choices_do_not_flip() {
    let to_light = DVec3::new(0.05, 1.0, 0.02).normalize();
    for fit in [CascadeFit::Faces, CascadeFit::Auto { sharpness: 0.5 }] {
        let config = ParallelSplitShadows {
            fit: fit.clone(),
            map_size: MapSize::Same(1024),
            ..Default::default()
        };
        let mut history = PlanHistory::default();
        let mut before = None;
        let mut changes = 0;
        for frame in 0..200 {
            // Nodding about the horizon.
            let scene = ground(6.0, 0.02 * (0.7 * frame as f32).sin());
            let plans = scene.plan_after(&config, to_light, &mut history);
            let ends: Vec<_> = plans.iter().map(|plan| (plan.far * 1e3) as i64).collect();
            let layout = (fits_of(&plans).len(), ends);
            changes += usize::from(before.as_ref().is_some_and(|before| *before != layout));
            before = Some(layout);
        }
        // Faces come and go with the horizon, slices do not come back.
        let most = if fit == CascadeFit::Faces { 90 } else { 6 };
        assert!(changes <= most, "{fit:?}: {changes}");
    }
}

/// Shadows fade over the same depths whatever is seen.
#[test]
fn fading_does_not_depend_on_what_is_seen() {
    let last_fade = |far: f64| {
        let mut scene = ground(10.0, -0.05);
        scene.things[0].half = DVec3::new(far, 5.0, far);
        let config = ParallelSplitShadows {
            fit: CascadeFit::Tight,
            ..Default::default()
        };
        let plans = scene.plan(&config, DVec3::new(0.3, 0.7, 0.2).normalize());
        (plans[3].blend_start, plans[3].far)
    };
    let whole = last_fade(900.0);
    assert_eq!(whole.1, 500.0);
    for far in [100.0, 300.0, 450.0, 480.0, 495.0, 500.0, 520.0] {
        assert_eq!(last_fade(far), whole);
    }
}

proptest! {
    /// Slices that begin a hair before the eye and end at the horizon lose nothing of what is in them.
    #[test]
    fn deep_slices_find_what_is_in_them(
        ratio in 0.0..8.0_f64,
        far in 0.0..5.0_f64,
        turn in any_turn(),
        at in (0.01..0.99_f64, 0.01..0.99_f64, 0.001..0.999_f64),
        eye in -1e6..1e6_f32,
    ) {
        let far = 10.0_f64.powf(far);
        let near = far / 10.0_f64.powf(ratio) * 0.99;
        let mut lens = perspective(0.8, 1.6);
        if let bevy::camera::Projection::Perspective(lens) = &mut lens {
            lens.near = 1e-9;
        }
        let view = volume(&lens, Vec3::new(eye, 0.0, -eye), turn);
        let slice = view.slice(near, far).expect("a slice");
        let c = &slice.corners;
        let on = |q: usize| {
            let bottom = c[q].lerp(c[q + 1], at.0);
            bottom.lerp(c[q + 3].lerp(c[q + 2], at.0), at.1)
        };
        let point = on(0).lerp(on(4), at.2);
        let mut receivers = Receivers::new(&view);
        receivers.add(&OrientedBox {
            center: point,
            half_axes: DMat3::from_diagonal(DVec3::splat(1e-6 * far)),
        });
        let found = receivers.in_slices([Some(&slice)])[0];
        prop_assert!(!found.is_empty(), "{} {} {}", near, far, point);
        let body = ConvexBody::of_slice(&slice);
        for plane in body.planes() {
            let farthest = body.corners.iter().map(|corner| plane.normal.dot(*corner));
            let farthest = farthest.fold(f64::NEG_INFINITY, f64::max);
            prop_assert!(farthest <= plane.distance, "{} {} {:?}", near, far, plane);
        }
    }
}
