//! Steadiness: points of surfaces followed while a camera goes its way.
//!
//! Nothing moves but the camera, so a point's truth stays the same (or the sun moves too, and points count whose
//! truth it leaves alone): whenever its answer changes, that is the shadows' doing. A picture answers at pixels'
//! centers only; what a point's answer was one frame before is what the four pixels around it then agreed on, if
//! their truth is the point's. Where they did not, an edge of the shadow passes there, and nothing is known.

use bevy::{
    math::{DQuat, DVec2, DVec3},
    platform::{collections::HashMap, sync::Arc},
    prelude::*,
};
use bevy_pssm::ShadowPlans;
use serde::Serialize;

use super::{
    drawn::{DrawnShare, Work, percent},
    gather::Geometry,
    light::Reference,
    maps::{Map, maps_of},
    settings::{Setting, Technique},
    studio::{Stance, Studio},
    trace::{Lens, Sample, Tracer},
};

/// Frames of a path.
pub const FRAMES: usize = 600;
/// … in a second.
const RATE: f32 = 60.0;
/// The first of those that are looked at whatever happens.
const FIRST: usize = 60;
/// Frames between cuts.
const PERIOD: usize = 120;
/// Points count under moving suns whose truth stays what it is while the sun goes so far either way (degrees).
const AROUND: [f64; 6] = [-0.3, -0.12, -0.05, 0.05, 0.12, 0.3];
/// A map keeps its grid if its texels move by whole texels, but for so many.
const SAME_GRID: f64 = 0.05;
/// No camera comes nearer to the ground than this (meters).
const LEAST_HEIGHT: f32 = 2.0;

/// Settings that are followed unless others are asked for.
pub const FOLLOWED: [&str; 6] = [
    "steady 2048",
    "stable 2048",
    "tight 2048",
    "warped 2048",
    "bevy 2048",
    "bevy 2048 tuned",
];

/// What a camera does, for ten seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Path {
    /// Nothing.
    Rest,
    /// Goes ahead over the ground for five seconds, then back (meters per second).
    Ahead(f32),
    /// The same, while the sun goes up (degrees per second).
    UnderSun(f32, f32),
    /// Turns to the left (degrees per second).
    Turn(f32),
    /// Looks down to its feet and back to the horizon, every four seconds.
    LookDown,
    /// Zooms in to a third of the view, and out again.
    Zoom,
    /// Cuts from pose to pose, at three frames of which each is looked at.
    Cuts,
}

impl Path {
    /// All under a sun that rests, with their names in tables.
    pub const ALL: [(&'static str, Self); 9] = [
        ("rest", Self::Rest),
        ("walk, 1.5 m/s", Self::Ahead(1.5)),
        ("run, 6 m/s", Self::Ahead(6.0)),
        ("drive, 50 m/s", Self::Ahead(50.0)),
        ("turn, 30°/s", Self::Turn(30.0)),
        ("turn, 90°/s", Self::Turn(90.0)),
        ("look down and up", Self::LookDown),
        ("zoom", Self::Zoom),
        ("three cuts", Self::Cuts),
    ];

    /// Under a sun that rests and one that moves, over points chosen alike.
    pub const UNDER_SUNS: [(&'static str, Self); 2] = [
        ("walk, sun at rest", Self::UnderSun(1.5, 0.0)),
        ("walk, sun 0.3°/s", Self::UnderSun(1.5, 0.3)),
    ];

    /// How closely it is looked at: steps of suns are many and small.
    fn looks(self) -> Looks {
        match self {
            Self::UnderSun(..) => Looks {
                period: 18,
                most_changes: 30,
                stride: 1,
            },
            _ => Looks {
                period: PERIOD,
                most_changes: 4,
                stride: 2,
            },
        }
    }

    /// Frames whose predecessors are looked at too, under every setting.
    pub fn regular_frames(self) -> impl ExactSizeIterator<Item = usize> {
        (FIRST..FRAMES).step_by(self.looks().period)
    }

    /// How camera and sun stand at a frame. `ground` is its height at (x, z).
    pub fn stance(
        self,
        poses: &[Stance],
        frame: usize,
        ground: &dyn Fn(f32, f32) -> f32,
    ) -> Stance {
        let seconds = frame as f32 / RATE;
        let whole = FRAMES as f32 / RATE;
        let there_and_back = whole / 2.0 - (seconds - whole / 2.0).abs();
        let mut stance = poses[0].clone();
        let camera = &mut stance.camera;
        if let Self::UnderSun(_, speed) = self {
            let degrees = speed * (seconds - whole / 2.0);
            let rise = rise(stance.sun.back().as_dvec3(), f64::from(degrees));
            stance.sun.rotate(rise.as_quat());
        }
        match self {
            Self::Rest => (),
            Self::Ahead(speed) | Self::UnderSun(speed, _) => {
                let forward = *camera.forward() * Vec3::new(1.0, 0.0, 1.0);
                camera.translation += forward.normalize_or(Vec3::NEG_Z) * (speed * there_and_back);
                let floor = ground(camera.translation.x, camera.translation.z) + LEAST_HEIGHT;
                camera.translation.y = camera.translation.y.max(floor);
            }
            Self::Turn(speed) => camera.rotate_y((speed * seconds).to_radians()),
            Self::LookDown => {
                let (yaw, _, _) = camera.rotation.to_euler(EulerRot::YXZ);
                let pitch = -40.0 * (1.0 - (seconds * core::f32::consts::FRAC_PI_2).cos());
                camera.rotation = Quat::from_euler(EulerRot::YXZ, yaw, pitch.to_radians(), 0.0);
            }
            Self::Zoom => {
                if let Projection::Perspective(lens) = &mut stance.projection {
                    let share = 1.0 / (1.0 + 2.0 * there_and_back / (whole / 2.0));
                    lens.fov = 2.0 * ((0.5 * lens.fov).tan() * share).atan();
                }
            }
            Self::Cuts => {
                let done = (1..=3).filter(|cut| frame >= Self::cut(*cut)).count();
                return poses[done % poses.len()].clone();
            }
        }
        stance
    }

    /// The frame of a cut: the one after it is among those looked at.
    fn cut(index: usize) -> usize {
        FIRST + PERIOD * index - 1
    }

    fn is_cut(self, frame: usize) -> bool {
        self == Self::Cuts && (1..=3).any(|index| Self::cut(index) == frame)
    }
}

/// How a sun turns as it goes up.
fn rise(to_sun: DVec3, degrees: f64) -> DQuat {
    let level = to_sun.cross(DVec3::Y).normalize_or(DVec3::X);
    DQuat::from_axis_angle(level, degrees.to_radians())
}

/// What is looked at of a path.
struct Looks {
    /// Frames between those that are looked at whatever happens.
    period: usize,
    /// Of the frames in which a map changes its grid, so many are looked at, evenly spread.
    most_changes: usize,
    /// Points are so many pixels apart, both ways.
    stride: usize,
}

/// How steady and how right a setting is along a path.
#[derive(Debug, Default, Clone, Copy, PartialEq)]
pub struct Steadiness {
    /// Points whose answer changes, in percent of those that face the sun, per second.
    pub changed_pct: f64,
    /// Frames in which a map's texels do not stay where they were, but for those of cuts.
    pub grid_changes: usize,
    /// Points whose answer is not the truth, in the frames looked at (percent).
    pub wrong_pct: f64,
    /// What is drawn where maps are held while they serve, in percent of drawing them in each frame.
    pub drawn: DrawnShare,
}

/// A frame of a path, as needed to read pictures of it.
struct Waypoint {
    stance: Stance,
    lens: Lens,
    reference: Reference,
}

/// Two frames of a path, one after the other.
struct Pair {
    before: Waypoint,
    now: Waypoint,
    /// By pixel of the second, points that face the sun.
    points: Vec<(usize, Sample)>,
    to_sun: DVec3,
}

/// A path through a scene, and what is known of it before any setting is.
pub struct Route {
    path: Path,
    stances: Vec<Stance>,
    tracer: Arc<Tracer>,
    /// By second frame, those that are looked at under each setting.
    pairs: HashMap<usize, Pair>,
}

impl Studio {
    /// What rays along paths meet: the scene as it is before a pose.
    pub fn tracer(&mut self, pose: &Stance) -> Arc<Tracer> {
        self.place(pose);
        self.headless.settle();
        Arc::new(Tracer::new(Geometry::gather(self.world())))
    }

    /// Traces the truth along a path from some poses.
    pub fn explore(
        &mut self,
        path: Path,
        tracer: &Arc<Tracer>,
        poses: &[Stance],
        ground: &dyn Fn(f32, f32) -> f32,
    ) -> Route {
        let stances = (0..FRAMES).map(|frame| path.stance(poses, frame, ground));
        let mut route = Route {
            path,
            stances: stances.collect(),
            tracer: tracer.clone(),
            pairs: HashMap::default(),
        };
        for frame in path.regular_frames() {
            let pair = self.pair(&route, frame);
            route.pairs.insert(frame, pair);
        }
        route
    }

    fn pair(&mut self, route: &Route, frame: usize) -> Pair {
        let to_sun = route.stances[frame].sun.back().as_dvec3().normalize();
        let now = self.waypoint(route, frame);
        let stride = route.path.looks().stride;
        let mut points = route.tracer.every(&now.lens, to_sun, stride);
        if let Path::UnderSun(..) = route.path {
            let suns = AROUND.map(|degrees| rise(to_sun, degrees) * to_sun);
            points.retain(|(_, sample)| route.tracer.is_same_under(sample, &suns));
        }
        Pair {
            before: self.waypoint(route, frame - 1),
            points,
            to_sun,
            now,
        }
    }

    fn waypoint(&mut self, route: &Route, frame: usize) -> Waypoint {
        let stance = route.stances[frame].clone();
        self.place(&stance);
        Waypoint {
            reference: self.reference(),
            lens: self.lens(),
            stance,
        }
    }

    /// Goes along a path under the setting that is in force. `done` is called after each pair of frames
    /// looked at.
    pub fn travel(
        &mut self,
        route: &Route,
        setting: &Setting,
        mut done: impl FnMut(),
    ) -> Steadiness {
        let Passage {
            changes,
            held,
            work: every,
        } = self.pass_along(route, setting);
        let drawn = self.share_drawn(&route.stances, every);
        let step = changes
            .len()
            .div_ceil(route.path.looks().most_changes)
            .max(1);
        let mut looked_at: Vec<usize> = route.path.regular_frames().collect();
        looked_at.extend(changes.iter().step_by(step));
        looked_at.sort_unstable();
        looked_at.dedup();

        // Of frames that keep all grids, of those that do not.
        let mut followed = [Answers::default(); 2];
        for frame in looked_at {
            let found;
            let pair = match route.pairs.get(&frame) {
                Some(pair) => pair,
                None => {
                    found = self.pair(route, frame);
                    &found
                }
            };
            self.recall(held.get(&frame));
            let shares = [&pair.before, &pair.now].map(|waypoint| {
                self.place(&waypoint.stance);
                let picture = self.expose();
                waypoint.reference.shares(&picture)
            });
            followed[usize::from(changes.contains(&frame))] += pair.answers(route, &shares);
            done();
        }
        let [kept, jumped] = followed.map(Answers::changed_share);
        let (all, of_changes) = (FRAMES as f64, changes.len() as f64);
        let mut sum = followed[0];
        sum += followed[1];
        Steadiness {
            changed_pct: 100.0
                * f64::from(RATE)
                * (kept * (all - of_changes) + jumped * of_changes)
                / all,
            grid_changes: changes.len(),
            wrong_pct: percent(sum.wrong, sum.points),
            drawn,
        }
    }

    /// Has maps laid along a path, without pictures.
    fn pass_along(&mut self, route: &Route, setting: &Setting) -> Passage {
        let near = match &setting.technique {
            Technique::Pssm(config) => f64::from(config.near),
            Technique::Bevy(stock) => f64::from(stock.near),
        };
        let (camera, sun, height) = (self.camera, self.sun, f64::from(self.size.y));
        self.forget();
        let mut passage = Passage::default();
        let mut last: Vec<Map> = Vec::new();
        // As before the frame before the last, and before the last.
        let mut held = [None, self.held()];
        for (frame, stance) in route.stances.iter().enumerate() {
            self.pass(stance);
            passage.work += self.work();
            let maps = maps_of(self.world(), camera, sun, near, height);
            let is_kept = |now: &Map| {
                let mut last = last.iter().filter(|last| last.cascade == now.cascade);
                last.all(|last| has_same_grid(last, now))
            };
            let is_change = !maps.iter().all(is_kept) && !route.path.is_cut(frame);
            if is_change {
                passage.changes.push(frame);
            }
            let [before, now] = held;
            if (is_change || route.path.regular_frames().any(|it| it == frame))
                && let Some(before) = before
            {
                passage.held.insert(frame, before);
            }
            held = [now, self.held()];
            last = maps;
        }
        passage
    }

    /// What the plugin holds on to.
    fn held(&mut self) -> Option<ShadowPlans> {
        let sun = self.sun;
        self.world().get::<ShadowPlans>(sun).cloned()
    }

    fn recall(&mut self, held: Option<&ShadowPlans>) {
        let sun = self.sun;
        if let (Some(held), Some(mut plans)) = (held, self.world().get_mut::<ShadowPlans>(sun)) {
            *plans = held.clone();
        }
    }
}

/// What passing along a path has shown.
#[derive(Default)]
struct Passage {
    /// The frames in which a map's texels do not stay where they were.
    changes: Vec<usize>,
    /// By frame that may be looked at, what was held before the frame before it.
    held: HashMap<usize, ShadowPlans>,
    work: Work,
}

/// How points fared.
#[derive(Default, Clone, Copy)]
struct Answers {
    points: usize,
    wrong: usize,
    followed: usize,
    changed: usize,
}

impl Answers {
    fn changed_share(self) -> f64 {
        self.changed as f64 / self.followed.max(1) as f64
    }
}

impl core::ops::AddAssign for Answers {
    fn add_assign(&mut self, other: Self) {
        self.points += other.points;
        self.wrong += other.wrong;
        self.followed += other.followed;
        self.changed += other.changed;
    }
}

impl Pair {
    /// What the points of the second frame say in both, by the pixels' shares of light.
    fn answers(&self, route: &Route, [before, now]: &[Vec<Option<f32>>; 2]) -> Answers {
        let mut answers = Answers::default();
        let lens = &self.before.lens;
        for (pixel, point) in &self.points {
            let Some(is_lit) = now[*pixel].map(|share| share > 0.5) else {
                continue;
            };
            answers.points += 1;
            answers.wrong += usize::from(is_lit != point.lit);
            let Some(pixels) = around(lens, point.point) else {
                continue;
            };
            answers.followed += 1;
            let differs = |pixel: usize| before[pixel].is_some_and(|share| (share > 0.5) != is_lit);
            let is_changed = pixels.into_iter().all(differs)
                && route.tracer.agree(lens, pixels, point, self.to_sun);
            answers.changed += usize::from(is_changed);
        }
        answers
    }
}

/// Whether one map's texels lie where the other's do, or whole texels beside.
fn has_same_grid(last: &Map, now: &Map) -> bool {
    let world_from_clip = last.clip_from_world.inverse();
    let moved = |x: f64, y: f64| {
        let point = world_from_clip.project_point3(DVec3::new(x, y, 0.5));
        now.texel_at(point) - last.texel_at(point)
    };
    let center = moved(0.0, 0.0);
    let is_close = |offset: DVec2| offset.abs().max_element() < SAME_GRID;
    last.size == now.size
        && is_close(center - center.round())
        && [(1.0, 0.0), (0.0, 1.0)]
            .into_iter()
            .all(|(x, y)| is_close(moved(x, y) - center))
}

/// The four pixels whose centers lie around a point.
fn around(lens: &Lens, point: DVec3) -> Option<[usize; 4]> {
    let clip = lens.clip_from_world * point.extend(1.0);
    let ndc = clip.truncate().truncate() / clip.w;
    let size = lens.size.as_dvec2();
    let corner = (0.5 + 0.5 * DVec2::new(ndc.x, -ndc.y)) * size - 0.5;
    let corner = corner.floor();
    let is_inside = clip.w > 0.0 && corner.min_element() >= 0.0 && (corner + 1.0).cmplt(size).all();
    is_inside.then(|| {
        let width = lens.size.x as usize;
        let first = corner.y as usize * width + corner.x as usize;
        [first, first + 1, first + width, first + width + 1]
    })
}

/// One line of `paths.csv`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PathRow {
    /// Name of the scene.
    pub scene: String,
    /// Name of the setting.
    pub setting: String,
    /// Name of the path.
    pub path: &'static str,
    /// Points whose answer changes though their truth does not, in percent per second.
    pub changed_pct_per_second: f64,
    /// Frames, of 600, in which texels do not stay where they were.
    pub grid_changes: usize,
    /// Points whose answer is not the truth, in the frames looked at (percent).
    pub wrong_pct: f64,
    /// Maps drawn where those that serve are held, in percent of all in each frame.
    pub maps_drawn_pct: f64,
    /// Triangles drawn into them, in percent of all maps' in each frame.
    pub triangles_drawn_pct: f64,
    /// The same, with one in a hundred casters moving.
    pub triangles_drawn_moving_pct: f64,
    /// And with all of them.
    pub triangles_drawn_all_moving_pct: f64,
}
