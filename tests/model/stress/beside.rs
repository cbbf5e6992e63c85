//! Bevy's built-in shadows at the same extremes and in the same bad worlds, before the same judge.

use core::{cell::RefCell, fmt, iter::zip, panic::AssertUnwindSafe};
use std::panic::catch_unwind;

use bevy::math::{DVec2, DVec3, Vec3};
use bevy_pssm::{geometry::slice::ViewVolume, plan::CascadePlan, prelude::*};

use super::{
    bad_worlds::{bad_worlds, fate, turned_at_zenith},
    built_in::built_in,
    case::*,
};

/// Over points that a camera sees, of cascades.
struct Verdict {
    /// Share of points that no map holds of those that their depth asks for, but for rounding.
    lost: f64,
    /// Texels between where `f32` and `f64` look a point up, at most.
    off: f64,
    /// Texels over the picture's height, at the median point.
    texels: f64,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self { lost, off, texels } = self;
        write!(f, "{:.1} %, {off:.2}, {texels:.0}", 100.0 * lost)
    }
}

fn judge(view: &ViewVolume, plans: &[CascadePlan], points: &[DVec3]) -> Verdict {
    let mut off = 0.0_f64;
    let mut texels = Vec::new();
    for point in points {
        let depth = view.depth_of(*point);
        let asked = asked_for(plans, *point, depth, view.eye);
        let mut maps = asked.filter_map(|plan| Some((plan, plan.map.as_ref()?)));
        let found = maps.find(|(plan, map)| {
            // With no guard only rounding is excused, and nothing where nothing is a number.
            map.clip_from_world.is_finite() && covers(plan, *point, LEAST_GUARD)
        });
        if let Some((plan, map)) = found {
            off = off.max(apart(plan, map, *point).max_element());
            texels.push(view.image_height(depth) / map.texel.max_element());
        }
    }
    texels.sort_by(f64::total_cmp);
    Verdict {
        lost: 1.0 - texels.len() as f64 / points.len() as f64,
        off,
        texels: texels.get(texels.len() / 2).copied().unwrap_or(0.0),
    }
}

/// A frame as it is planned by the plugin and by Bevy, whose plans are none if it panics.
struct Beside {
    view: ViewVolume,
    plans: [Vec<CascadePlan>; 2],
    /// Such as either's slices end at, before both ranges' ends.
    points: Vec<DVec3>,
}

impl Beside {
    fn new(planned: &Planned) -> Self {
        let Planned { case, config, .. } = *planned;
        let ours = planned.plans.iter().cloned().map(as_drawn).collect();
        let built_in = catch_unwind(AssertUnwindSafe(|| built_in(planned))).unwrap_or_default();
        let mut points = case.points(&planned.view, config, &built_in, planned.things);
        points.extend(&planned.points);
        let far = built_in.last().map_or(f64::INFINITY, |plan| plan.far);
        points.retain(|point| planned.view.depth_of(*point) < far);
        Self {
            view: planned.view,
            plans: [ours, built_in],
            points,
        }
    }

    fn verdicts(&self) -> [Option<Verdict>; 2] {
        let judge = |plans: &Vec<CascadePlan>| {
            let is_planned = !plans.is_empty();
            is_planned.then(|| judge(&self.view, plans, &self.points))
        };
        self.plans.each_ref().map(judge)
    }

    /// Of one of the two.
    fn texels(&self, side: usize) -> Vec<Option<DVec2>> {
        let plans = self.plans[side].iter();
        let texel = |plan: &CascadePlan| Some(plan.map.as_ref()?.texel);
        plans.map(texel).collect()
    }
}

/// With the matrix that casters are drawn and points are looked up by: of Bevy's, which is planned in
/// `f32`, there is no other.
fn as_drawn(mut plan: CascadePlan) -> CascadePlan {
    if let Some(map) = &mut plan.map {
        map.clip_from_world = map.clip_from_world.as_mat4().as_dmat4();
    }
    plan
}

/// All of a case, in which everything must hold of the plugin's plans.
fn frames(case: &Case) -> Vec<Beside> {
    let frames = RefCell::new(Vec::new());
    let seen = case.run(|planned| {
        everything_holds(planned)?;
        frames.borrow_mut().push(Beside::new(planned));
        Ok(())
    });
    assert!(matches!(seen, Ok(1..)), "{seen:?}: {case:?}");
    frames.into_inner()
}

/// One frame each, with the default fit.
fn extremes() -> Vec<(&'static str, Case)> {
    let [fov, aspect, near] = [60.0, 1.6, 0.1];
    let everywhere = |case: Case| Case {
        scene: Scene::Everywhere,
        ..case
    };
    let seen = |fov: f32, aspect: f32| Case::with_lens(Lens::Endless { fov, aspect, near });
    let between = |near: f32, far: f32| Case {
        lenses: vec![Lens::Endless { fov, aspect, near }],
        ..Case::with_config(ParallelSplitShadows {
            near,
            far,
            ..Default::default()
        })
    };
    let parallel = |height: f32, near: f32, [first, last]: [f32; 2]| {
        let lens = Lens::Orthographic {
            height,
            aspect,
            near,
            far: last,
        };
        let lenses = vec![lens];
        everywhere(Case {
            lenses,
            ..between(first, last)
        })
    };
    let away = |distance: f32| Case {
        eye: distance * Vec3::new(0.6, 0.1, -0.79),
        ..Case::ordinary()
    };
    let along = |axis: usize| Case {
        sun: Sun::Beside {
            axis,
            sign: 1.0,
            tilt: 0.0,
            side: 0.7,
        },
        ..Case::ordinary()
    };
    let of_texels = |size: u32| {
        Case::with_config(ParallelSplitShadows {
            map_size: MapSize::Same(size),
            ..Default::default()
        })
    };
    // At the origin, or a small camera would see less than `f32` tells apart.
    let scaled = |scale: f32| Case {
        scale,
        eye: Vec3::ZERO,
        ..everywhere(Case::ordinary())
    };
    let boxes = |half: f64, spots: &[Spot]| {
        let placed = spots.iter().map(|at| Placed {
            at: *at,
            half: DVec3::splat(half),
        });
        Scene::Boxes(placed.collect())
    };
    let spots = [[0.2, -0.3, 0.6], [-0.5, 0.1, 0.8]];
    let millimeters = Case {
        scene: boxes(5e-4, &spots),
        eye: Vec3::ZERO,
        ..between(1e-3, 0.1)
    };
    let point = Case {
        scene: boxes(0.0, &spots[..1]),
        ..Case::ordinary()
    };
    vec![
        ("nothing extreme", Case::ordinary()),
        ("the same, all of the view", everywhere(Case::ordinary())),
        ("`far` 1e8 times `near`", between(1e-4, 1e4)),
        ("`far` 1.0001 times `near`", between(1e4 / 1.0001, 1e4)),
        ("field of view of 0.1°", seen(0.1, aspect)),
        ("field of view of 175°", seen(175.0, aspect)),
        ("aspect of 100", seen(fov, 100.0)),
        ("orthographic, 1 cm", parallel(0.01, 0.0, [1e-3, 0.1])),
        ("orthographic, 100 km", parallel(1e5, 0.0, [1e3, 1e6])),
        ("sees behind its eye", parallel(60.0, -200.0, [1.0, 200.0])),
        ("10 km from the origin", away(1e4)),
        ("100 km from the origin", away(1e5)),
        ("1000 km from the origin", away(1e6)),
        ("sun along the camera's up", along(1)),
        ("sun along the view", along(2)),
        ("maps of 64 texels", of_texels(64)),
        ("maps of 16,384 texels", of_texels(MAX_MAP_SIZE)),
        ("boxes of a millimeter", millimeters),
        ("one point", point),
        ("camera's scale 1e-4", scaled(1e-4)),
        ("camera's scale 0.01", scaled(0.01)),
        ("camera's scale 100", scaled(100.0)),
    ]
}

/// Share of a zoom's steps of one percent at which a map's texels change.
fn changes_by_zoom() -> [f64; 2] {
    let lens = |step: i32| Lens::Endless {
        fov: 60.0 * 0.99_f32.powi(step),
        aspect: 1.6,
        near: 0.1,
    };
    let frames = frames(&Case {
        lenses: (0..100).map(lens).collect(),
        frames: (0..100).map(|lens| Frame { lens, ..STILL }).collect(),
        scene: Scene::Everywhere,
        ..Case::ordinary()
    });
    [0, 1].map(|side| {
        let pairs = frames.windows(2);
        let steps = pairs.flat_map(|pair| zip(pair[0].texels(side), pair[1].texels(side)));
        let is_change: Vec<bool> = steps.map(|(before, now)| before != now).collect();
        let changes = is_change.iter().filter(|it| **it).count();
        changes as f64 / is_change.len() as f64
    })
}

/// How far texels move over what stands still, at most, when a floating origin moves the world (texels).
fn moved_by_origin() -> [f64; 2] {
    let by = Vec3::new(-512.375, 0.0, 256.625);
    // Grids are moved along, where there is a way to.
    let case = Case {
        scene: Scene::Everywhere,
        is_anchored: true,
        ..Case::ordinary()
    };
    let moved = Case {
        eye: case.eye + by,
        ..case.clone()
    };
    let [here, there] = [case, moved].map(|case| frames(&case).swap_remove(0));
    let point = here.points[0];
    [0, 1].map(|side| {
        let pairs = here.plans[side].iter().zip(&there.plans[side]);
        let moves = pairs.filter_map(|(here, there)| {
            let at = |plan: &CascadePlan, point: DVec3| {
                let ndc = plan.map.as_ref()?.clip_from_world.project_point3(point);
                Some(0.5 * ndc.truncate() * plan.map_size.as_dvec2())
            };
            let moved: DVec2 = at(there, point + by.as_dvec3())? - at(here, point)?;
            Some((moved - moved.round()).abs().max_element())
        });
        moves.fold(0.0, f64::max)
    })
}

#[expect(clippy::print_stdout, reason = "a table for the docs")]
fn print_row(world: &str, ours: &str, built_in: &str) {
    println!("| {world} | {ours} | {built_in} |");
}

/// Its rows: points lost (%), texels that lookups are off by at most, and texels over the picture's
/// height at the median point; or what is said.
#[test]
fn bevys_built_in_beside_ours() {
    print_row("world", "bevy_pssm", "Bevy's built-in");
    print_row("---", "---", "---");
    for (name, case) in extremes() {
        let verdicts = frames(&case).swap_remove(0).verdicts();
        let is_lossless = verdicts[0].as_ref().is_some_and(|ours| ours.lost == 0.0);
        let [ours, built_in] = verdicts
            .map(|verdict| verdict.map_or_else(|| "panics".to_owned(), |it| it.to_string()));
        print_row(name, &ours, &built_in);
        assert!(is_lossless, "{name}: {ours}");
    }

    let shares = changes_by_zoom();
    let [ours, built_in] = shares.map(|it| format!("texels change at {:.0} %", 100.0 * it));
    print_row("zoom in steps of 1 %", &ours, &built_in);
    assert!(shares[0] < 0.3, "{ours}");

    let moves = moved_by_origin();
    let [ours, built_in] = moves.map(|it| format!("texels move by {it:.2}"));
    print_row("floating origin", &ours, &built_in);
    assert!(moves[0] < LEAST_ROUNDING, "{ours}");

    let turns = [true, false].map(turned_at_zenith);
    let [ours, built_in] = turns.map(|it| format!("axes turn by {it:.1}°"));
    print_row("sun through the zenith", &ours, &built_in);
    assert!(turns[0] < 1.0, "{ours}");

    for (name, harm) in bad_worlds() {
        let [ours, built_in] = [true, false].map(|is_ours| fate(is_ours, harm));
        print_row(name, &ours, &built_in);
        assert!(!ours.contains("no numbers"), "{name}: {ours}");
        // What panics with both is Bevy's.
        assert!(ours != "panics" || built_in == ours, "{name}: {ours}");
    }
}
