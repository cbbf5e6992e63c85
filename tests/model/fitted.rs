//! Maps that are fitted to what receives shadows, warped or not: what they must cover, and what they
//! must not do.

use bevy::math::{DMat3, DVec2, DVec3, Quat, Vec3};
use bevy_pssm::{
    geometry::{
        body::ConvexBody,
        face::Wedge,
        fit::LookupReach,
        light_frame::LightFrame,
        receivers::Receivers,
        slice::ViewVolume,
        warp::{self, WarpFrame, body_vertices},
    },
    plan::{CascadePlan, PlanHistory, PlanInputs, plan_cascades},
    prelude::*,
};
use proptest::prelude::*;

use crate::views::{any_direction, any_turn, perspective, volume};

const REACH: LookupReach = LookupReach { texels: 6.0 };
const SIZE: u32 = 1024;

/// A box along the world's axes.
#[derive(Debug, Clone, Copy)]
struct Thing {
    centre: DVec3,
    half: DVec3,
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
        let mut receivers = Receivers::new(view);
        for thing in &self.things {
            receivers.add(thing.centre, &DMat3::from_diagonal(thing.half));
        }
        receivers
    }

    fn plan(&self, config: &ParallelSplitShadows, to_light: DVec3) -> Vec<CascadePlan> {
        let view = self.view();
        let inputs = PlanInputs {
            view: &view,
            light: &LightFrame::new(to_light).expect("a direction"),
            config,
            reach: REACH,
            receivers: &self.receivers(&view),
            image_height: 1080.0,
        };
        plan_cascades(&inputs, &mut PlanHistory::default())
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
            centre: DVec3::from(at) * DVec3::new(1.0, 0.2, 1.0),
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
            things.iter_mut().for_each(|it| it.centre += offset);
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
        (0.0..1.0_f64).prop_map(|share| CascadeFit::Auto {
            prefer: Preference::Between(share)
        }),
        warp().prop_map(CascadeFit::Warped),
        Just(CascadeFit::List(vec![
            MapFit::Stable,
            MapFit::Tight,
            MapFit::Warped(MapWarp::Minimax),
            MapFit::Warped(MapWarp::Strength(1.0)),
        ])),
    ]
}

fn warp() -> impl Strategy<Value = MapWarp> {
    prop_oneof![
        Just(MapWarp::Minimax),
        Just(MapWarp::Lispsm),
        (-1.0..1.0_f64).prop_map(|eta| MapWarp::Lloyd { eta }),
        (0.01..0.8_f64).prop_map(|focus| MapWarp::Trapezoid { focus }),
        (0.0..1.0_f64).prop_map(MapWarp::Strength),
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
        slack in prop_oneof![Just(0.0), 0.01..0.5_f64],
        axis in prop_oneof![Just(WarpAxis::View), Just(WarpAxis::Middle)],
        spots in prop::collection::vec((0..6_usize, prop::array::uniform3(-1.0..1.0_f64)), 40),
        // Where in the picture, and how deep.
        rays in prop::collection::vec(prop::array::uniform3(0.0..1.0_f64), 20),
        way in 0.0..500.0_f64,
    ) {
        let config = ParallelSplitShadows {
            fit,
            slack,
            warp_axis: axis,
            map_size: MapSize::Same(SIZE),
            far: 400.0,
            ..Default::default()
        };
        let view = scene.view();
        let plans = scene.plan(&config, to_light);
        let within = |point: DVec3| {
            scene.things.iter().any(|it| (point - it.centre).abs().cmple(it.half).all())
        };
        let of_boxes = spots.iter().map(|(index, at)| {
            let thing = scene.things[index % scene.things.len()];
            thing.centre + thing.half * DVec3::from(*at)
        });
        let of_rays = rays.iter().map(|[x, y, depth]| {
            let depth = 0.1 * 4000_f64.powf(*depth);
            let lo = view.min[0] + depth * view.min[1];
            let hi = view.max[0] + depth * view.max[1];
            let at = lo + (hi - lo) * DVec2::new(*x, *y);
            view.eye + view.axes * at.extend(-depth)
        });
        let seen = |point: &DVec3| {
            let local = view.axes.inverse() * (*point - view.eye);
            let depth = -local.z;
            let lo = view.min[0] + depth * view.min[1];
            let hi = view.max[0] + depth * view.max[1];
            depth > view.near && local.x > lo.x && local.x < hi.x && local.y > lo.y && local.y < hi.y
        };
        for point in of_boxes.chain(of_rays).filter(|point| seen(point) && within(*point)) {
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
                let caster = DMat3::from_diagonal(DVec3::splat(0.1));
                prop_assert!(map.hull.intersects_box(point + way * to_light, &caster));
            }
            prop_assert!(depth >= config.far || found > 0, "nothing is for {point} at {depth}");
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
        let bounds = scene.receivers(&view).bounds_between(&[(1.0, 300.0)])[0];
        let body = ConvexBody::of_slice(&slice).within(ConvexBody::planes_of_box(bounds));
        prop_assume!(body.faces().len() > 3);
        let (frame, strength) =
            warp::lay(MapWarp::Minimax, forward(&view), &view, to_light, &body).unwrap();
        let vertices = body_vertices(&view, &body);
        let storage = |strength| frame.worst_aliasing(&vertices, strength).unwrap().storage();
        prop_assert!(strength >= 0.0 && strength.is_finite());
        let [warped, unwarped] = [strength, 0.0].map(storage);
        prop_assert!(warped <= 1.02 * unwarped, "{warped} {unwarped}");
    }
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
    match warp::lay(warp, forward(&view), &view, to_light, &body) {
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
    fn maps_converge_to_unwarped_ones(scene in scene(), warp in warp(), side in 0.0..6.28_f64) {
        let view = scene.view();
        let slice = view.slice(2.0, 150.0).expect("not empty");
        let body = ConvexBody::of_slice(&slice);
        let vertices = body_vertices(&view, &body);
        let across = view.axes * DVec3::new(side.cos(), side.sin(), 0.0);
        let differences = [1e-3, 1e-5].map(|angle| {
            let to_light = (view.axes.z_axis + angle * across).normalize();
            let (frame, strength) =
                warp::lay(warp, forward(&view), &view, to_light, &body).unwrap();
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
                centre: DVec3::ZERO,
                half: DVec3::new(400.0, 0.1, 400.0),
            },
            // Something that moves.
            Thing {
                centre: DVec3::new(3.0, 1.0, -20.0 + 0.02 * f64::from(step)),
                half: DVec3::ONE,
            },
        ],
    };
    let changes = |slack: f64| {
        let config = ParallelSplitShadows {
            fit: CascadeFit::Tight,
            slack,
            ..Default::default()
        };
        let light = LightFrame::new(DVec3::new(0.3, 0.7, -0.45)).unwrap();
        let mut history = PlanHistory::default();
        let mut before: Option<Vec<CascadePlan>> = None;
        let mut changes = 0;
        for step in 0..100 {
            let scene = scene(step);
            let view = scene.view();
            let inputs = PlanInputs {
                view: &view,
                light: &light,
                config: &config,
                reach: REACH,
                receivers: &scene.receivers(&view),
                image_height: 1080.0,
            };
            let plans = plan_cascades(&inputs, &mut history);
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
            centre: DVec3::ZERO,
            half: DVec3::new(900.0, 5.0, 900.0),
        }],
    };
    let with = |fit, focus| {
        let config = ParallelSplitShadows {
            fit,
            focus,
            far: 800.0,
            ..Default::default()
        };
        scene.plan(&config, DVec3::new(0.5, 0.8, 0.1).normalize())
    };
    let focused = with(CascadeFit::Tight, ShadowFocus::Receivers);
    assert!(focused.iter().all(|cascade| cascade.map.is_some()));
    assert!(focused[0].far > 200.0, "{}", focused[0].far);
    let last = &focused[3];
    assert!(last.far < 700.0, "{}", last.far);
    assert_eq!(last.blend_start, last.far, "nothing to fade");

    // Stable maps keep their planes, and those in the air stay empty.
    let stable = with(CascadeFit::Stable, ShadowFocus::Receivers);
    assert_eq!(stable[3].far, 800.0);
    assert!(stable[0].map.is_none() && stable[3].map.is_some());
    let whole = with(CascadeFit::Tight, ShadowFocus::Off);
    assert!(whole.iter().all(|cascade| cascade.map.is_some()));
    assert_eq!(whole[3].far, 800.0);
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
            centre: DVec3::new(0.0, 0.0, 50.0),
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
    let (near, far, share) = (5.0, 100.0, 0.4);
    let body = ConvexBody::of_slice(&view.slice(near, far).unwrap());
    let warp = MapWarp::Trapezoid { focus: share };
    let (frame, strength) = warp::lay(warp, forward(&view), &view, DVec3::Y, &body).unwrap();
    assert!(strength > 0.0);
    let map = frame.clip_from_world(&body_vertices(&view, &body), strength);
    let focus = DVec3::NEG_Z * (near + share * (far - near));
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
    let vertices = body_vertices(&view, &body);
    let worst = |eta| {
        let strength = frame.lloyd_strength(eta, near, far);
        frame.worst_aliasing(&vertices, strength).unwrap().z
    };
    for [a, b, c] in [[-1.0, -0.5, 0.0], [0.0, 0.5, 1.0]] {
        let middle = 0.5 * (worst(a) + worst(c));
        approx::assert_relative_eq!(worst(b), middle, max_relative = 1e-6);
    }
}
