//! Steadiness: points of surfaces followed while a camera goes its way.
//!
//! Nothing moves but the camera, so a point's truth stays the same (or the sun moves too, and points count whose
//! truth it leaves alone): whenever its answer changes, that is the shadows' doing. A picture answers at pixels'
//! centers only; what a point's answer was one frame before is what the four pixels around it then agreed on, if
//! their truth is the point's. Where they did not, an edge of the shadow passes there, and nothing is known.

use bevy::{
    math::{DVec2, DVec3},
    platform::{collections::HashMap, sync::Arc},
    prelude::*,
};
use bevy_pssm::ShadowPlans;
use serde::Serialize;

use super::{
    drawn::{Drawn, Work, percent},
    gather::Geometry,
    light::Reference,
    maps::{Map, maps_of},
    path::{FRAMES, Looks, Path, RATE, rise},
    row::rounded,
    settings::{Setting, Technique},
    studio::{Stance, Studio},
    trace::{Lens, Sample, Tracer},
};

/// Points count under moving suns whose truth stays what it is while the sun goes so far either way (degrees).
const AROUND: [f64; 6] = [-0.3, -0.12, -0.05, 0.05, 0.12, 0.3];
/// A map keeps its grid if its texels move by whole texels, but for so many.
const SAME_GRID: f64 = 0.05;
/// Settings that are followed unless others are asked for.
pub const FOLLOWED: [&str; 7] = [
    "steady 2048",
    "steady 2048 delay 4",
    "stable 2048",
    "tight 2048",
    "warped 2048",
    "bevy 2048",
    "bevy 2048 tuned",
];

/// How steady and how right a setting is along a path.
#[derive(Debug, Default, Clone, Copy, PartialEq)]
pub struct Steadiness {
    /// Points whose answer changes, in percent of those that face the sun, per second.
    pub changed_pct: f64,
    /// Frames in which a map's texels do not stay where they were, but for those of cuts.
    pub grid_changes: usize,
    /// Points whose answer is not the truth, in the frames looked at (percent).
    pub wrong_pct: f64,
    /// What is drawn into maps.
    pub drawn: Drawn,
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
    looks: Looks,
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

    /// Traces the truth along a path from some poses, in one of so many frames.
    pub fn explore(
        &mut self,
        path: Path,
        every: usize,
        tracer: &Arc<Tracer>,
        poses: &[Stance],
        ground: &dyn Fn(f32, f32) -> f32,
    ) -> Route {
        let stances = (0..FRAMES).map(|frame| path.stance(poses, frame, ground));
        let mut route = Route {
            path,
            looks: path.looks(every),
            stances: stances.collect(),
            tracer: tracer.clone(),
            pairs: HashMap::default(),
        };
        for frame in route.looks.frames.clone() {
            let pair = self.pair(&route, frame);
            route.pairs.insert(frame, pair);
        }
        route
    }

    fn pair(&mut self, route: &Route, frame: usize) -> Pair {
        let to_sun = route.stances[frame].sun.back().as_dvec3().normalize();
        let now = self.waypoint(route, frame);
        let stride = route.looks.stride;
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
        let drawn = self.drawn_along(&route.stances, every);
        let step = changes.len().div_ceil(route.looks.most_changes).max(1);
        let mut looked_at = route.looks.frames.clone();
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
            if (is_change || route.looks.frames.contains(&frame))
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
    /// What is drawn in all frames if all maps are: maps,
    pub maps_always: usize,
    /// casters into maps,
    pub casters_always: usize,
    /// their triangles,
    pub triangles_always: usize,
    /// and texels that are cleared.
    pub texels_always: u64,
    /// The same where maps that serve are held; texels that are copied count, too.
    pub maps: usize,
    /// …
    pub casters: usize,
    /// …
    pub triangles: usize,
    /// …
    pub texels: u64,
    /// The same with one in a hundred casters moving.
    pub casters_moving: usize,
    /// …
    pub triangles_moving: usize,
    /// …
    pub texels_moving: u64,
    /// And with all of them.
    pub casters_all_moving: usize,
    /// …
    pub triangles_all_moving: usize,
    /// …
    pub texels_all_moving: u64,
}

impl PathRow {
    /// What one setting is worth along one path of a scene.
    pub fn new(scene: &str, setting: &str, path: &'static str, found: &Steadiness) -> Self {
        let Drawn {
            always,
            still,
            few,
            all,
        } = found.drawn;
        Self {
            scene: scene.to_owned(),
            setting: setting.to_owned(),
            path,
            changed_pct_per_second: rounded(found.changed_pct),
            grid_changes: found.grid_changes,
            wrong_pct: rounded(found.wrong_pct),
            maps_always: always.maps,
            casters_always: always.casters,
            triangles_always: always.triangles,
            texels_always: always.texels,
            maps: still.maps,
            casters: still.casters,
            triangles: still.triangles,
            texels: still.texels,
            casters_moving: few.casters,
            triangles_moving: few.triangles,
            texels_moving: few.texels,
            casters_all_moving: all.casters,
            triangles_all_moving: all.triangles,
            texels_all_moving: all.texels,
        }
    }
}
