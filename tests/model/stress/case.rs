//! A view, a sun, a scene and settings, planned over some frames, and what must hold of the maps.

use bevy::math::{DMat4, DQuat, DVec2, DVec3, Mat4, Quat, Vec2, Vec3, proj};
use bevy_pssm::{
    geometry::{
        body::ConvexBody,
        fit::LookupReach,
        light_frame::{LightFrame, angle_between},
        receivers::{Extent, Receivers},
        slice::{Depth, ViewVolume},
    },
    plan::{CascadeMap, CascadePlan, CasterChanges, PlanHistory, PlanInputs, plan_cascades},
    prelude::*,
};
use proptest::prelude::*;

use crate::{
    fitted::{Thing, receivers_of},
    views::{in_picture, sees, volume_through},
};
/// What GPUs allow (texels).
pub const MAX_MAP_SIZE: u32 = 16_384;

/// What `f32` moves a lookup by at most, as a share of the point's distance from the world's origin: the
/// point, the matrix, their products and the sums of four of those are rounded by 2⁻²⁴ each, eight times
/// in all, which is 3.2 times 1.5e-7.
pub const ROUNDING: f64 = 4.0 * 1.5e-7;

/// Lookups that are off by less than this need not be excused by rounding (texels).
pub const LEAST_ROUNDING: f64 = 0.25;

/// Of the guard for filters, what a map may lack (texels).
pub const LEAST_GUARD: f64 = 0.5;

pub type Outcome = Result<(), TestCaseError>;

/// A camera's projection: fields of view in degrees, everything else in meters.
#[derive(Debug, Clone, Copy)]
pub enum Lens {
    /// Without a far plane, as Bevy's.
    Endless { fov: f32, aspect: f32, near: f32 },
    /// With one.
    Ending {
        fov: f32,
        aspect: f32,
        near: f32,
        far: f32,
    },
    Orthographic {
        height: f32,
        aspect: f32,
        near: f32,
        far: f32,
    },
}

impl Lens {
    pub fn clip_from_view(self) -> Mat4 {
        // Far before near: 1 is near.
        match self {
            Self::Endless { fov, aspect, near } => {
                proj::perspective_infinite_reverse(fov.to_radians(), aspect, near)
            }
            Self::Ending {
                fov,
                aspect,
                near,
                far,
            } => proj::perspective(fov.to_radians(), aspect, far, near),
            Self::Orthographic {
                height,
                aspect,
                near,
                far,
            } => {
                let [x, y] = [0.5 * height * aspect, 0.5 * height];
                proj::orthographic(-x, x, -y, y, far, near)
            }
        }
    }

    /// The same with so many times the distances, if it is in perspective.
    pub fn scaled(self, by: f32) -> Self {
        match self {
            Self::Endless { fov, aspect, near } => Self::Endless {
                fov,
                aspect,
                near: by * near,
            },
            Self::Ending {
                fov,
                aspect,
                near,
                far,
            } => Self::Ending {
                fov,
                aspect,
                near: by * near,
                far: by * far,
            },
            Self::Orthographic { .. } => self,
        }
    }
}

impl Lens {
    /// How thin what it shows is between two depths, and how far that reaches (meters).
    fn extents(self, [near, far]: [f64; 2]) -> [f64; 2] {
        let across = |fov: f32, aspect: f32, far: f64| {
            let height = 2.0 * far * (0.5 * f64::from(fov).to_radians()).tan();
            [height, height * f64::from(aspect)]
        };
        let (depths, [height, width]) = match self {
            Self::Endless { fov, aspect, .. } => ([near, far], across(fov, aspect, far)),
            Self::Ending {
                fov,
                aspect,
                near: first,
                far: last,
            } => {
                let far = far.min(last.into());
                ([near.max(first.into()), far], across(fov, aspect, far))
            }
            Self::Orthographic {
                height,
                aspect,
                near: first,
                far: last,
            } => {
                let depths = [near.max(first.into()), far.min(last.into())];
                (depths, [height, height * aspect].map(f64::from))
            }
        };
        let deep = depths[1] - depths[0];
        [deep.min(height).min(width), far.abs() + height + width]
    }
}

#[derive(Debug, Clone, Copy)]
pub enum Sun {
    Anywhere(DVec3),
    /// So far (radians) from the camera's right, up or back, or from the world's up.
    Beside {
        axis: usize,
        sign: f64,
        tilt: f64,
        side: f64,
    },
}

impl Sun {
    pub fn to_light(self, view: &ViewVolume) -> DVec3 {
        match self {
            Self::Anywhere(to_light) => to_light,
            Self::Beside {
                axis,
                sign,
                tilt,
                side,
            } => {
                let axes = view.axes;
                let axes = [axes.x_axis, axes.y_axis, axes.z_axis, DVec3::Y];
                let axis = sign * axes[axis].normalize();
                let (right, up) = axis.any_orthonormal_pair();
                axis + tilt * (side.cos() * right + side.sin() * up)
            }
        }
    }
}

/// A place in the picture, in half widths and heights from its middle, and how deep, from 0 to 1.
pub type Spot = [f64; 3];

/// A box at a place in the first picture.
#[derive(Debug, Clone, Copy)]
pub struct Placed {
    pub at: Spot,
    pub half: DVec3,
}

/// What receives shadows.
#[derive(Debug, Clone)]
pub enum Scene {
    Everywhere,
    Fog,
    Boxes(Vec<Placed>),
    /// Without height, at that of the first.
    Coplanar(Vec<Placed>),
}

/// One of the lenses, one of the settings, how far the camera has turned (radians) and moved
/// (meters) from where it stood at first, and what else is going on.
#[derive(Debug, Clone)]
pub struct Frame {
    pub lens: usize,
    pub config: usize,
    pub yaw: f32,
    pub step: f32,
    /// How far the sun has turned from where it stood at first, about the world's X (radians).
    pub sun: f64,
    pub changes: CasterChanges,
}

pub const STILL: Frame = Frame {
    lens: 0,
    config: 0,
    yaw: 0.0,
    step: 0.0,
    sun: 0.0,
    changes: CasterChanges::At(Vec::new()),
};

#[derive(Debug, Clone)]
pub struct Case {
    pub lenses: Vec<Lens>,
    pub configs: Vec<ParallelSplitShadows>,
    pub eye: Vec3,
    pub turn: Quat,
    /// Of the camera's axes.
    pub scale: f32,
    pub sun: Sun,
    pub scene: Scene,
    /// Whether texel grids are anchored at the eye, or else at the world's origin.
    pub is_anchored: bool,
    /// Of lookups (texels).
    pub reach: f64,
    pub frames: Vec<Frame>,
    /// Where else the picture is looked at.
    pub spots: Vec<Spot>,
}

/// What was planned for a frame.
pub struct Planned<'a> {
    pub case: &'a Case,
    pub lens: Lens,
    pub config: &'a ParallelSplitShadows,
    pub things: &'a [Thing],
    pub view: ViewVolume,
    pub to_light: DVec3,
    pub plans: Vec<CascadePlan>,
    /// Points that the camera sees, that receive shadows and that lie before the range's end.
    pub points: Vec<DVec3>,
}

impl Case {
    /// Whether no view is so thin that the GPU hardly tells its positions apart.
    pub fn is_told_apart(&self) -> bool {
        self.frames.iter().all(|frame| {
            let config = &self.configs[frame.config % self.configs.len()];
            let depths = [config.near, config.far].map(f64::from);
            let [thin, reach] = self.lenses[frame.lens % self.lenses.len()].extents(depths);
            let eye = self.eye.as_dvec3().abs().element_sum();
            thin > 100.0 * ROUNDING * (eye + reach)
        })
    }

    /// Plans frame by frame, with one history for all. How many points were seen.
    pub fn run(&self, check: impl Fn(&Planned) -> Outcome) -> Result<usize, TestCaseError> {
        let first = self.volume(self.lenses[0], self.eye, self.turn);
        let things = self.things(&first);
        let to_light = self.sun.to_light(&first);
        let origin = if self.is_anchored {
            first.eye
        } else {
            DVec3::ZERO
        };
        let mut history = PlanHistory::default();
        let mut seen = 0;
        for frame in &self.frames {
            let lens = self.lenses[frame.lens % self.lenses.len()];
            let config = &self.configs[frame.config % self.configs.len()];
            let valid = config.validate(MAX_MAP_SIZE);
            prop_assert!(valid.is_ok(), "{valid:?}");
            let turn = Quat::from_rotation_y(frame.yaw) * self.turn;
            let eye = self.eye + turn * (frame.step * Vec3::NEG_Z);
            let view = self.volume(lens, eye, turn);
            let to_light = DQuat::from_rotation_x(frame.sun) * to_light;
            let light = LightFrame::new(to_light).expect("a direction").at(origin);
            let inputs = PlanInputs {
                view: &view,
                light: &light,
                config,
                reach: LookupReach { texels: self.reach },
                receivers: &self.receivers(&view, &things),
                image_height: 1080.0,
                changes: &frame.changes,
            };
            let plans = plan_cascades(&inputs, &mut history);
            prop_assert_eq!(plans.len(), config.cascades as usize);
            let points = self.points(&view, config, &plans, &things);
            seen += points.len();
            check(&Planned {
                case: self,
                lens,
                config,
                things: &things,
                view,
                to_light: light.z,
                plans,
                points,
            })?;
        }
        Ok(seen)
    }

    fn volume(&self, lens: Lens, eye: Vec3, turn: Quat) -> ViewVolume {
        volume_through(&lens.clip_from_view(), eye, turn, self.scale)
    }

    pub fn things(&self, first: &ViewVolume) -> Vec<Thing> {
        let placed = |it: &Placed| Thing {
            center: at_spot(first, &self.configs[0], it.at),
            half: it.half,
        };
        match &self.scene {
            Scene::Everywhere | Scene::Fog => Vec::new(),
            Scene::Boxes(boxes) => boxes.iter().map(placed).collect(),
            Scene::Coplanar(boxes) => {
                let mut things: Vec<Thing> = boxes.iter().map(placed).collect();
                let height = things.first().map_or(0.0, |it| it.center.y);
                for thing in &mut things {
                    thing.center.y = height;
                    thing.half.y = 0.0;
                }
                things
            }
        }
    }

    pub fn receivers(&self, view: &ViewVolume, things: &[Thing]) -> Receivers {
        match self.scene {
            Scene::Everywhere => Receivers::everywhere(view),
            Scene::Fog => Receivers::fog(view),
            Scene::Boxes(_) | Scene::Coplanar(_) => receivers_of(view, things),
        }
    }

    /// Corners and middles of what is seen of each slice and thing, and places all over the picture.
    pub fn points(
        &self,
        view: &ViewVolume,
        config: &ParallelSplitShadows,
        plans: &[CascadePlan],
        things: &[Thing],
    ) -> Vec<DVec3> {
        let is_everywhere = config.comparison.focus == ShadowFocus::Off
            || matches!(self.scene, Scene::Everywhere | Scene::Fog);
        let depth = Depth::new(view);
        let mut points: Vec<DVec3> = self
            .spots
            .iter()
            .map(|spot| at_spot(view, config, *spot))
            .collect();
        let slices = plans.iter().map(|plan| view.slice(plan.near, plan.far));
        for slice in slices.flatten() {
            let whole = ConvexBody::of_slice(&slice);
            if is_everywhere {
                points.extend(corners_and_middle(&whole));
            }
            for thing in things {
                let [lo, hi] = thing.ends();
                let extent = Extent {
                    lo: lo.extend(f64::NEG_INFINITY),
                    hi: hi.extend(f64::INFINITY),
                };
                // Each clipped by the other: one of the two is more exact, whichever is smaller.
                for part in [
                    whole.clone().within(extent.planes(&depth)),
                    ConvexBody::of_box(lo, hi).within(whole.planes()),
                ] {
                    let corners = corners_and_middle(&part);
                    points.extend(corners.map(|corner| corner.clamp(lo, hi)));
                }
            }
        }
        let is_in = |point: DVec3, thing: &Thing| {
            let [lo, hi] = thing.ends();
            lo.cmple(point).all() && hi.cmpge(point).all()
        };
        let receives =
            |point: DVec3| is_everywhere || things.iter().any(|thing| is_in(point, thing));
        let far = f64::from(config.far);
        points.retain(|point| receives(*point) && sees(view, *point) && depth.of(*point) < far);
        points
    }
}

/// Depths are spread evenly, as powers, from well before the range to its end.
pub fn at_spot(view: &ViewVolume, config: &ParallelSplitShadows, [x, y, share]: Spot) -> DVec3 {
    let near = view.nearest().max(1e-3 * f64::from(config.near));
    let far = view.far.min(f64::from(config.far)).max(near);
    let depth = near * (far / near).powf(share);
    in_picture(view, DVec2::new(x, y), depth)
}

/// A hair inside, or rounding would say that the camera does not see them.
pub fn corners_and_middle(body: &ConvexBody) -> impl Iterator<Item = DVec3> {
    let middle = body.center();
    let corners = body.corners.iter();
    let corners = corners.map(move |corner| corner.lerp(middle, 1e-6));
    corners.chain((!body.is_empty()).then_some(middle))
}

/// How far off `f32` may look a point up.
pub struct Rounding {
    pub texels: DVec2,
    pub depth: f64,
}

impl Rounding {
    /// Without a warp [`ROUNDING`] times the distance over a texel's size. Under a warp the division may
    /// leave little of a matrix' rows, but as much of their rounding. `None` where the point is as close
    /// to the warp's center of projection as rounding reaches: there nothing is known.
    pub fn of(plan: &CascadePlan, map: &CascadeMap, point: DVec3) -> Option<Self> {
        let map = map.clip_from_world;
        let clip = map * point.extend(1.0);
        let ndc = clip.truncate() / clip.w;
        let moved = ROUNDING * point.length();
        let length = |row: usize| map.row(row).truncate().length();
        let w = clip.w - moved * length(3);
        let most = |row: usize| moved * (length(row) + ndc[row].abs() * length(3)) / w;
        (w > 0.0).then(|| Self {
            texels: 0.5 * plan.map_size.as_dvec2() * DVec2::new(most(0), most(1)),
            // And what depths from 0 to 1 are rounded by themselves.
            depth: most(2) + 1e-6,
        })
    }
}

/// NDC of a point, and w, as shaders work them out.
pub fn on_gpu(map: &CascadeMap, point: DVec3) -> (Vec3, f32) {
    let clip = map.clip_from_world.as_mat4() * point.as_vec3().extend(1.0);
    (clip.truncate() / clip.w, clip.w)
}

/// Whether a map holds a point, exactly.
pub fn holds(map: &DMat4, point: DVec3) -> bool {
    let clip = *map * point.extend(1.0);
    let ndc = clip.truncate() / clip.w;
    let is_inside = ndc.truncate().abs().cmple(DVec2::ONE).all();
    clip.w > 0.0 && is_inside && (0.0..=1.0).contains(&ndc.z)
}

/// Whether shaders find a point in a cascade's map with all that filters read about it, as far as
/// rounding allows.
pub fn covers(plan: &CascadePlan, point: DVec3, reach: f64) -> bool {
    let Some(map) = &plan.map else {
        return false;
    };
    let Some(rounding) = Rounding::of(plan, map, point) else {
        return true;
    };
    let (ndc, w) = on_gpu(map, point);
    let ndc = ndc.as_dvec3();
    let guard = reach - LEAST_GUARD - rounding.texels;
    let most = DVec2::ONE - 2.0 * guard / plan.map_size.as_dvec2();
    let depths = -rounding.depth..=1.0 + rounding.depth;
    w > 0.0 && ndc.truncate().abs().cmple(most).all() && depths.contains(&ndc.z)
}

/// Whether a cascade is for a point, of those of its slice.
pub fn is_for(plan: &CascadePlan, point: DVec3, eye: DVec3) -> bool {
    let moved = ROUNDING * (point.length() + point.distance(eye));
    plan.wedge.is_none_or(|wedge| {
        let mut planes = wedge.planes.iter();
        planes.all(|plane| plane.normal.dot(point) - plane.distance <= moved)
    })
}

/// The cascades that a point asks for, by its depth and its place before the eye.
pub fn asked_for(
    plans: &[CascadePlan],
    point: DVec3,
    depth: f64,
    eye: DVec3,
) -> impl Iterator<Item = &CascadePlan> {
    plans
        .iter()
        .filter(move |plan| plan.near <= depth && depth <= plan.far && is_for(plan, point, eye))
}

/// Texels between where `f32` and `f64` look a point up.
pub fn apart(plan: &CascadePlan, map: &CascadeMap, point: DVec3) -> DVec2 {
    let clip = map.clip_from_world * point.extend(1.0);
    let exact = clip.truncate().truncate() / clip.w;
    let exact = (exact * DVec2::new(0.5, -0.5) + 0.5) * plan.map_size.as_dvec2();
    let found = on_gpu(map, point).0.truncate();
    let found = (found * Vec2::new(0.5, -0.5) + 0.5) * plan.map_size.as_vec2();
    (found.as_dvec2() - exact).abs()
}

/// Matrices are finite, and in `f32` too they have an inverse, turn nothing around and put what is
/// nearer to the light at a greater depth.
pub fn maps_are_sound(planned: &Planned) -> Outcome {
    for map in planned.plans.iter().filter_map(|plan| plan.map.as_ref()) {
        for matrix in [
            map.clip_from_world,
            map.clip_from_cascade,
            map.world_from_cascade,
        ] {
            let is_finite = matrix.is_finite() && matrix.as_mat4().is_finite();
            prop_assert!(is_finite, "{matrix}");
        }
        // Of a sun that moves they may be off by a step.
        let to_light = map.world_from_cascade.z_axis.truncate();
        let behind = angle_between(to_light, planned.to_light);
        let asked = f64::from(planned.config.sun_step).to_radians();
        let coarse = (map.texel.min_element() / 10.0).min(4.0 * asked);
        let step = asked.max(coarse.min(1_f64.to_radians()));
        prop_assert!(behind <= step + 1e-9, "{behind}: {map:?}");
        let exact = map.clip_from_world;
        let rounded = exact.as_mat4().as_dmat4();
        let is_flat = map.strength == 0.0;
        let places = planned.points.iter().copied();
        let places = places.filter(|place| holds(&exact, *place));
        // Without a warp it is the same everywhere.
        for place in places.chain(is_flat.then_some(DVec3::ZERO)) {
            let clip = exact * place.extend(1.0);
            let ndc = clip.truncate() / clip.w;
            let gradients = |matrix: &DMat4| {
                [0, 1, 2].map(|row| {
                    let [of_ndc, of_w] = [row, 3].map(|row| matrix.row(row).truncate());
                    (of_ndc - ndc[row] * of_w) / clip.w
                })
            };
            let ([x, y, z], [exact_x, exact_y, _]) = (gradients(&rounded), gradients(&exact));
            let rise = z.dot(to_light);
            prop_assert!(rise > 0.0, "{rise} at {place}: {map:?}");
            if is_flat {
                let square = x.normalize().cross(y.normalize()).dot(to_light);
                let mut configs = planned.case.configs.iter();
                // Sheared by a sun 6° high, over a corner.
                let is_sheared = configs.any(|config| config.grid == TexelGrid::Ground);
                let least = if is_sheared { 0.19 } else { 0.999 };
                prop_assert!(square > least, "{square}: {map:?}");
            }
            // Of what the strongest warps leave for what is far, rounding may leave nothing.
            let most = |row: usize| {
                let [of_ndc, of_w] = [row, 3].map(|row| exact.row(row).truncate().length());
                (of_ndc + ndc[row].abs() * of_w) / clip.w
            };
            let off = most(0) * exact_y.length() + exact_x.length() * most(1);
            let least = 4.0 * f64::from(f32::EPSILON) * off;
            let area = |x: DVec3, y: DVec3| x.cross(y).dot(to_light);
            let [exact, found] = [area(exact_x, exact_y), area(x, y)];
            let is_right = exact > 0.0 && (found > 0.0 || exact <= least);
            prop_assert!(is_right, "{found} for {exact} at {place}: {map:?}");
        }
    }
    Ok(())
}

/// Each point is found in the map of at least one of the cascades that its depth and place ask for,
/// unless one of them may wait for its turn to be drawn.
pub fn nothing_is_missed(planned: &Planned) -> Outcome {
    let depth = Depth::new(&planned.view);
    let may_wait = |plan: &CascadePlan| {
        let map = plan.map.as_ref();
        planned.config.delay > 0 && map.is_some_and(|map| map.redraw.is_none())
    };
    for point in &planned.points {
        let at = depth.of(*point);
        let mut plans = asked_for(&planned.plans, *point, at, planned.view.eye);
        let is_covered =
            plans.any(|plan| covers(plan, *point, planned.case.reach) || may_wait(plan));
        prop_assert!(is_covered, "{point} at {at}: {:?}", planned.plans);
    }
    Ok(())
}

/// Lookups are off by a quarter of a texel, or by what rounding moves them.
pub fn lookups_agree(planned: &Planned) -> Outcome {
    for plan in &planned.plans {
        let Some(map) = &plan.map else {
            continue;
        };
        for point in &planned.points {
            if !holds(&map.clip_from_world, *point) {
                continue;
            }
            let Some(rounding) = Rounding::of(plan, map, *point) else {
                continue;
            };
            let apart = apart(plan, map, *point);
            let most = rounding.texels.max(DVec2::splat(LEAST_ROUNDING));
            let is_close = apart.cmple(most).all();
            prop_assert!(is_close, "{apart} of {most} at {point}: {map:?}");
        }
    }
    Ok(())
}

pub fn everything_holds(planned: &Planned) -> Outcome {
    maps_are_sound(planned)?;
    nothing_is_missed(planned)?;
    lookups_agree(planned)
}

/// The fit for so many cascades, of one for four.
pub fn for_cascades(fit: &CascadeFit, cascades: u32) -> CascadeFit {
    match fit {
        CascadeFit::PerCascade(fits) => CascadeFit::PerCascade(fits[..cascades as usize].to_vec()),
        _ => fit.clone(),
    }
}

/// A scheme over a range, of one with biases in hundredths of it and with planes as shares of slices.
pub fn over_range(splits: SplitScheme, [near, far]: [f32; 2], cascades: u32) -> SplitScheme {
    match splits {
        SplitScheme::Geometric { gamma, bias } => SplitScheme::Geometric {
            gamma,
            bias: 0.01 * bias * far,
        },
        SplitScheme::GeometricScaled { gamma, bias } => SplitScheme::GeometricScaled {
            gamma,
            bias: 0.01 * bias * far,
        },
        SplitScheme::Manual(shares) => {
            let planes = (1..cascades).zip(shares).map(|(slice, share)| {
                near + (far - near) * ((slice - 1) as f32 + share) / cascades as f32
            });
            SplitScheme::Manual(planes.collect())
        }
        other => other,
    }
}

/// Larger than everything.
pub const ALL: Placed = Placed {
    at: [0.0, 0.0, 0.5],
    half: DVec3::splat(1e8),
};
