//! The true shadows of what is seen, by rays in the background, and what is wrong with the sides'
//! pictures of them.

use core::{
    sync::atomic::{AtomicUsize, Ordering},
    time::Duration,
};

use bevy::{
    asset::RenderAssetUsages,
    math::{DMat4, DVec3},
    platform::{
        sync::{Arc, Mutex},
        time::Instant,
    },
    prelude::*,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
    tasks::{AsyncComputeTaskPool, Task, TaskPool, futures_lite::future::yield_now},
};

use super::{
    probe::{Errand, Probe, ProbePlugin, Scenery, Shares, Subject, View},
    sides::{Compare, Side},
};
use crate::truth::{
    accuracy::{Accuracy, Fault, Figures, Truth},
    gather::{Geometry, Surface},
    trace::{Lens, Sample, Tracer},
};

/// Frames after which what has not changed has come to rest.
const REST: usize = 10;
/// … where haste is asked for.
const HASTY_REST: usize = 2;
/// Pixels from ray to ray, pass by pass.
const STRIDES: [usize; 4] = [8, 4, 2, 1];
/// What part of the time rays may take on their thread.
const BUSY: f64 = 0.35;
/// They rest after so much work.
const SHIFT: Duration = Duration::from_millis(4);
/// More is not shown before the figures are final.
const ALMOST: f32 = 0.99;

const LEAK: [u8; 4] = [230, 60, 40, 255];
const ACNE: [u8; 4] = [40, 110, 255, 255];
const STAIN: [u8; 4] = [240, 200, 40, 255];
const CLEAR: [u8; 4] = [0; 4];

/// The true shadows of what is seen, and what is wrong with the pictures.
#[derive(Resource)]
pub struct TruthView {
    /// Wanted. The scene's time stands still meanwhile.
    pub on: bool,
    /// How far the rays are, 0 to 1; 1: all are traced for what is seen now.
    pub progress: f32,
    /// All cores, as fast as they can; otherwise one thread that leaves the picture its time.
    pub hasty: bool,
    /// By side; none while unknown.
    pub results: [Option<SideResult>; 2],
    /// By side: transparent but for wrong pixels.
    pub marks: [Handle<Image>; 2],
    /// Which of them are not blank.
    painted: [bool; 2],
    /// The scene's time has been stopped.
    has_paused: bool,
    work: Work,
}

/// What is wrong with a side's picture.
#[derive(Debug, Clone)]
pub struct SideResult {
    /// Of the pixels that have been traced; without stains until all are.
    pub figures: Figures,
    /// By pixel.
    pub faults: Vec<Fault>,
}

/// What is under way, and what has come of it.
#[derive(Default)]
struct Work {
    /// What was seen in the last frame; none while nothing is wanted.
    subject: Option<Subject>,
    /// For how many frames the view has been the same.
    view_rests: usize,
    /// For how many frames everything has been the same.
    all_rests: usize,
    building: Errand<Stage>,
    stage: Option<Arc<Stage>>,
    trace: Option<Trace>,
    found: Option<Arc<Pass>>,
    judging: Errand<Judgement>,
    /// What is judged, or was last.
    judged: Option<(Arc<Pass>, Arc<Shares>)>,
    /// The results are of all rays, and of what is seen now.
    is_final: bool,
}

impl FromWorld for TruthView {
    fn from_world(world: &mut World) -> Self {
        let mut images = world.get_resource_mut::<Assets<Image>>();
        let mut blank = || {
            let image = Image::new_fill(
                Extent3d::default(),
                TextureDimension::D2,
                &CLEAR,
                TextureFormat::Rgba8UnormSrgb,
                RenderAssetUsages::default(),
            );
            let added = images.as_mut().map(|images| images.add(image));
            added.unwrap_or_default()
        };
        Self {
            on: false,
            progress: 0.0,
            hasty: false,
            results: [None, None],
            marks: [blank(), blank()],
            painted: [false; 2],
            has_paused: false,
            work: Work::default(),
        }
    }
}

impl TruthView {
    fn rest(&self) -> usize {
        if self.hasty { HASTY_REST } else { REST }
    }

    /// Begins anew, as for another scene.
    pub fn forget(&mut self) {
        self.work = Work::default();
        self.results = [None, None];
        self.progress = 0.0;
    }

    /// Whether figures of all shown sides are there, of all rays and of what is seen now.
    pub fn is_final(&self, compare: &Compare) -> bool {
        let subject = self.work.subject.as_ref();
        let is_current = subject.is_some_and(|subject| {
            let mut shown = Side::BOTH
                .into_iter()
                .filter(|side| subject.technique(*side).is_some());
            subject.is_as(compare) && shown.all(|side| self.results[side.index()].is_some())
        });
        self.on && self.work.is_final && is_current
    }

    /// Takes note of what is seen now, and drops what is not true of it.
    fn look(&mut self, subject: Option<Subject>) {
        let work = &mut self.work;
        let before = core::mem::replace(&mut work.subject, subject);
        let now = &work.subject;
        let view = |subject: &Option<Subject>| subject.as_ref().map(|subject| subject.view);
        let (is_same, is_same_view) = (before == *now, view(&before) == view(now));
        for side in Side::BOTH {
            let shown = |subject: &Option<Subject>| {
                let subject = subject.as_ref();
                subject.and_then(|subject| subject.technique(side))
            };
            if !is_same_view || shown(&before) != shown(now) {
                self.results[side.index()] = None;
            }
        }
        work.all_rests += 1;
        work.view_rests += 1;
        if !is_same {
            work.all_rests = 0;
            work.is_final = false;
        }
        if !is_same_view {
            work.view_rests = 0;
            work.trace = None;
            work.found = None;
            work.judging = Errand::default();
            self.progress = 0.0;
        }
    }
}

/// Traces, compares and marks while [`TruthView::on`].
pub struct TruthPlugin;

impl Plugin for TruthPlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(ProbePlugin)
            .init_resource::<TruthView>()
            .add_systems(
                Last,
                (
                    watch,
                    gather.run_if(wants_geometry),
                    keep_tracing,
                    judge,
                    wipe_marks,
                )
                    .chain(),
            );
    }
}

/// Stops the scene's time, and notes what is seen.
fn watch(
    mut truth: ResMut<TruthView>,
    mut probe: ResMut<Probe>,
    mut time: ResMut<Time<Virtual>>,
    scenery: Scenery,
    changed: Query<(), Changed<Mesh3d>>,
    mut removed: RemovedComponents<Mesh3d>,
) {
    let is_another = removed.read().count() > 0 || !changed.is_empty();
    let is_switched = truth.on != truth.has_paused;
    if is_switched {
        if truth.on {
            time.pause();
        } else {
            time.unpause();
        }
        truth.has_paused = truth.on;
    }
    if is_switched || is_another {
        truth.forget();
    }
    let subject = if truth.on { scenery.subject() } else { None };
    truth.look(subject);
    let subject = truth.work.subject.as_ref();
    let rests = truth.work.all_rests >= truth.rest();
    let wanted = subject.filter(|subject| rests && subject.shows_light());
    if probe.wanted.as_ref() != wanted {
        probe.wanted = wanted.cloned();
    }
}

fn wants_geometry(truth: Res<TruthView>) -> bool {
    let work = &truth.work;
    let is_there = work.stage.is_some() || work.building.is_under_way();
    work.subject.is_some() && work.view_rests >= truth.rest() && !is_there
}

/// Runs once after it is switched on, and for another scene.
fn gather(world: &mut World) {
    let geometry = Geometry::gather(world);
    if let Some(mut truth) = world.get_resource_mut::<TruthView>() {
        let subject = truth.work.subject.as_ref();
        let sky = subject.and_then(|subject| subject.view.sky);
        truth.work.building.start(move || Stage::new(geometry, sky));
    }
}

/// Has what has come to rest traced.
fn keep_tracing(mut truth: ResMut<TruthView>) {
    let truth = &mut *truth;
    let rest = truth.rest();
    let work = &mut truth.work;
    if let Some(stage) = work.building.take() {
        work.stage = Some(Arc::new(stage));
    }
    let (Some(subject), Some(stage)) = (&work.subject, &work.stage) else {
        return;
    };
    if work.trace.is_none() && work.view_rests >= rest {
        let (stage, view) = (stage.clone(), subject.view);
        work.trace = Some(Trace::start(stage, view, truth.hasty));
    }
    let Some(trace) = &work.trace else {
        return;
    };
    if let Some(pass) = trace.take() {
        work.found = Some(Arc::new(pass));
    }
    let is_traced = work.found.as_ref().is_some_and(|pass| pass.stride == 1);
    truth.progress = if is_traced {
        1.0
    } else {
        trace.progress().min(ALMOST)
    };
}

/// Compares after each pass and after each probe.
fn judge(mut truth: ResMut<TruthView>, probe: Res<Probe>, mut images: ResMut<Assets<Image>>) {
    let truth = &mut *truth;
    let work = &mut truth.work;
    let judgement = work.judging.take();
    if let Some(judgement) = judgement
        && work.subject.as_ref() == Some(&judgement.subject)
    {
        work.is_final = judgement.is_final;
        let size = judgement.subject.view.lens.size;
        for (side, verdict) in Side::BOTH.into_iter().zip(judgement.sides) {
            let index = side.index();
            if let Some(Verdict { result, marks }) = verdict {
                paint(&mut images, &truth.marks[index], size, marks);
                truth.painted[index] = true;
                truth.results[index] = Some(result);
            }
        }
    }
    let (Some(pass), Some(shares)) = (&work.found, probe.shares()) else {
        return;
    };
    let is_known = work.judged.as_ref().is_some_and(|(known_pass, known)| {
        Arc::ptr_eq(known_pass, pass) && Arc::ptr_eq(known, shares)
    });
    if !is_known && work.subject.as_ref() == Some(&shares.subject) {
        let (pass, shares) = (pass.clone(), shares.clone());
        work.judged = Some((pass.clone(), shares.clone()));
        work.judging.start(move || Judgement::new(&pass, &shares));
    }
}

/// Marks go with the results.
fn wipe_marks(mut truth: ResMut<TruthView>, mut images: ResMut<Assets<Image>>) {
    let truth = &mut *truth;
    let sides = truth.results.iter().zip(&truth.marks);
    for ((result, marks), painted) in sides.zip(&mut truth.painted) {
        if result.is_none() && core::mem::take(painted) {
            paint(&mut images, marks, UVec2::ONE, CLEAR.into());
        }
    }
}

fn paint(images: &mut Assets<Image>, marks: &Handle<Image>, size: UVec2, pixels: Vec<u8>) {
    if let Some(mut image) = images.get_mut(marks) {
        image.texture_descriptor.size = Extent3d {
            width: size.x,
            height: size.y,
            depth_or_array_layers: 1,
        };
        image.data = Some(pixels);
    }
}

/// A scene for rays.
struct Stage {
    still: Option<Tracer>,
    /// What goes with the camera, and from its own to world space where it was gathered.
    sky: Option<(Tracer, DMat4)>,
}

impl Stage {
    fn new(mut geometry: Geometry, sky: Option<DMat4>) -> Self {
        let sky = sky.and_then(|place| {
            let sky = take_sky(&mut geometry);
            Some((tracer_of(sky)?, place))
        });
        Self {
            still: tracer_of(geometry),
            sky,
        }
    }

    fn picture(&self, view: &View) -> Vec<Option<Sample>> {
        let count = view.lens.size.element_product() as usize;
        self.trace(view, count, |tracer, lens| {
            tracer.picture(lens, view.to_sun)
        })
    }

    fn pixels(&self, view: &View, pixels: &[usize]) -> Vec<Option<Sample>> {
        self.trace(view, pixels.len(), |tracer, lens| {
            tracer.pixels(lens, view.to_sun, pixels)
        })
    }

    /// The nearer of what stands and of the sky, where it is now: as if it had been moved, rays
    /// go the other way.
    fn trace(
        &self,
        view: &View,
        count: usize,
        trace: impl Fn(&Tracer, &Lens) -> Vec<Option<Sample>>,
    ) -> Vec<Option<Sample>> {
        let mut samples = match &self.still {
            Some(tracer) => trace(tracer, &view.lens),
            None => vec![None; count],
        };
        if let (Some((tracer, then)), Some(now)) = (&self.sky, view.sky) {
            let moved = now * then.inverse();
            let lens = Lens {
                clip_from_world: view.lens.clip_from_world * moved,
                size: view.lens.size,
            };
            for (sample, sky) in samples.iter_mut().zip(trace(tracer, &lens)) {
                let sky = sky.map(|sky| Sample {
                    point: moved.transform_point3(sky.point),
                    normal: moved.transform_vector3(sky.normal),
                    ..sky
                });
                *sample = nearer(view.eye, *sample, sky);
            }
        }
        samples
    }
}

fn nearer(eye: DVec3, a: Option<Sample>, b: Option<Sample>) -> Option<Sample> {
    let distance = |sample: &Sample| sample.point.distance_squared(eye);
    let samples = [a, b].into_iter().flatten();
    samples.min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// Nothing, where there are no triangles.
fn tracer_of(geometry: Geometry) -> Option<Tracer> {
    (!geometry.triangles.is_empty()).then(|| Tracer::new(geometry))
}

/// Takes out what neither casts nor shows shadows. Its triangles shrink to points, that those of
/// cut-outs keep their indices.
fn take_sky(geometry: &mut Geometry) -> Geometry {
    let mut sky = Geometry::default();
    for (triangle, index) in geometry.triangles.iter_mut().zip(&geometry.surface_of) {
        let surface = &geometry.surfaces[*index as usize];
        if surface.casts || surface.receives {
            continue;
        }
        let [corner, ..] = *triangle;
        sky.triangles
            .push(core::mem::replace(triangle, [corner; 3]));
        sky.surface_of.push(*index);
    }
    let plain = |surface: &Surface| {
        let mut plain = Surface::plain();
        plain.casts = surface.casts;
        plain.receives = surface.receives;
        plain.culled = surface.culled;
        plain
    };
    sky.surfaces = geometry.surfaces.iter().map(plain).collect();
    sky
}

/// What rays have found so far of a view.
struct Pass {
    /// Of the pixels that have been traced, with the light of each one's center.
    truth: Truth,
    /// Pixels from one that has been traced to the next.
    stride: usize,
}

impl Pass {
    fn new(lens: Lens, samples: Vec<Option<Sample>>, stride: usize) -> Self {
        let share = |sample: &Option<Sample>| {
            let sample = sample.filter(|sample| sample.faces_sun)?;
            Some(f32::from(u8::from(sample.lit)))
        };
        let shares = samples.iter().map(share).collect();
        Self {
            truth: Truth::new(lens, samples, shares),
            stride,
        }
    }
}

/// Rays that are under way; they end when this is dropped.
struct Trace {
    pixels: usize,
    shared: Arc<Found>,
    _task: Task<()>,
}

/// What the thread of the rays hands over.
#[derive(Default)]
struct Found {
    /// Pixels that have been traced.
    done: AtomicUsize,
    /// The last pass that has not been taken.
    pass: Mutex<Option<Pass>>,
}

impl Trace {
    fn start(stage: Arc<Stage>, view: View, hasty: bool) -> Self {
        let shared = Arc::<Found>::default();
        let found = shared.clone();
        let pool = AsyncComputeTaskPool::get_or_init(TaskPool::default);
        let task = pool.spawn(async move {
            if hasty {
                let samples = stage.picture(&view);
                found.hand_over(Pass::new(view.lens, samples, 1));
            } else {
                trace_in_passes(&stage, &view, &found).await;
            }
        });
        Self {
            pixels: view.lens.size.element_product() as usize,
            shared,
            _task: task,
        }
    }

    fn progress(&self) -> f32 {
        let done = self.shared.done.load(Ordering::Relaxed);
        done as f32 / self.pixels.max(1) as f32
    }

    /// Never waits.
    fn take(&self) -> Option<Pass> {
        let mut pass = self.shared.pass.try_lock().ok()?;
        pass.take()
    }
}

impl Found {
    fn hand_over(&self, pass: Pass) {
        if let Ok(mut slot) = self.pass.lock() {
            *slot = Some(pass);
        }
    }
}

/// From coarse to fine. Others have their turn on the thread after each row.
async fn trace_in_passes(stage: &Stage, view: &View, found: &Found) {
    let [width, height] = view.lens.size.to_array().map(|side| side as usize);
    let mut samples = vec![None; width * height];
    let mut pace = Pace::default();
    for (pass, stride) in STRIDES.into_iter().enumerate() {
        let before = pass.checked_sub(1).map(|before| STRIDES[before]);
        for y in (0..height).step_by(stride) {
            let is_known =
                |x: usize| before.is_some_and(|it| x.is_multiple_of(it) && y.is_multiple_of(it));
            let columns = (0..width).step_by(stride).filter(|x| !is_known(*x));
            let pixels: Vec<usize> = columns.map(|x| y * width + x).collect();
            let row = pace.work(|| stage.pixels(view, &pixels));
            for (pixel, sample) in pixels.iter().zip(row) {
                samples[*pixel] = sample;
            }
            found.done.fetch_add(pixels.len(), Ordering::Relaxed);
            yield_now().await;
        }
        let so_far = samples.clone();
        found.hand_over(pace.work(|| Pass::new(view.lens, so_far, stride)));
    }
}

/// Sees to it that a thread works a part of the time only.
#[derive(Default)]
struct Pace {
    /// Since the last rest.
    worked: Duration,
}

impl Pace {
    fn work<T>(&mut self, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.worked += start.elapsed();
        if self.worked >= SHIFT {
            let worked = core::mem::take(&mut self.worked);
            std::thread::sleep(worked.mul_f64((1.0 - BUSY) / BUSY));
        }
        result
    }
}

/// What is wrong with the sides' pictures.
struct Judgement {
    subject: Subject,
    /// No pixel is left out.
    is_final: bool,
    sides: [Option<Verdict>; 2],
}

struct Verdict {
    result: SideResult,
    /// As an image's bytes.
    marks: Vec<u8>,
}

impl Judgement {
    fn new(pass: &Pass, shares: &Shares) -> Self {
        let [left, right] = &shares.sides;
        Self {
            subject: shares.subject.clone(),
            is_final: pass.stride == 1,
            sides: [left, right].map(|shares| Verdict::new(pass, shares.as_ref()?)),
        }
    }
}

impl Verdict {
    /// How far a pixel is from the edges of shadows is known only once all are traced: no stains
    /// until then. `None` if the picture is of another size.
    fn new(pass: &Pass, shares: &[Option<f32>]) -> Option<Self> {
        let truth = &pass.truth;
        if shares.len() != truth.samples.len() {
            return None;
        }
        let mut accuracy = Accuracy::default();
        accuracy.add(truth, shares);
        let mut figures = accuracy.figures();
        let has_stains = pass.stride == 1;
        if !has_stains {
            figures.stain_pct = 0.0;
        }
        let fault = |(pixel, share): (usize, &Option<f32>)| {
            let fault = share.and_then(|share| truth.fault(pixel, share));
            let counts = |fault: &Fault| has_stains || *fault != Fault::Stain;
            fault.filter(counts).unwrap_or(Fault::None)
        };
        let faults: Vec<Fault> = shares.iter().enumerate().map(fault).collect();
        let marks = marks_of(&faults, truth.size().x as usize, pass.stride);
        Some(Self {
            result: SideResult { figures, faults },
            marks,
        })
    }
}

/// Each pixel that has been traced stands for those after it.
fn marks_of(faults: &[Fault], width: usize, stride: usize) -> Vec<u8> {
    let mark = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        let traced = (y - y % stride) * width + x - x % stride;
        match faults[traced] {
            Fault::None => CLEAR,
            Fault::Acne => ACNE,
            Fault::Leak => LEAK,
            Fault::Stain => STAIN,
        }
    };
    (0..faults.len()).flat_map(mark).collect()
}
