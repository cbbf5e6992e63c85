//! The true shadows of what is seen, by rays in the background, and what is wrong with the sides'
//! pictures of them.

mod judge;
mod rays;

use core::time::Duration;

use bevy::{
    asset::RenderAssetUsages,
    platform::{sync::Arc, time::Instant},
    prelude::*,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};

use super::{
    errand::Errand,
    probe::{Probe, ProbePlugin, Scenery, Shares, Subject},
    sides::{Compare, Side},
};
use crate::truth::{
    accuracy::{Fault, Figures},
    gather::Geometry,
};
use judge::{Judgement, Verdict};
use rays::{Pass, Stage, Trace};

/// Frames after which what has not changed has come to rest.
const REST: usize = 10;
/// … where haste is asked for.
const HASTY_REST: usize = 2;
/// The most of a frame that gathering the scene's triangles takes.
const GATHERING: Duration = Duration::from_millis(8);
/// More is not shown before the figures are final.
const ALMOST: f32 = 0.99;

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
    /// What is still to be gathered, and what has been.
    gathering: Option<(Vec<Entity>, Geometry)>,
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
            // The sky goes with the camera.
            work.gathering = None;
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
    let is_another = truth.on && (removed.read().count() > 0 || !changed.is_empty());
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

/// Goes through the scene after it is switched on, and through another one, in pieces that no
/// frame has to wait for.
fn gather(world: &mut World) {
    let since = Instant::now();
    let Some(mut truth) = world.get_resource_mut::<TruthView>() else {
        return;
    };
    let is_hasty = truth.hasty;
    let (mut entities, mut geometry) = match truth.work.gathering.take() {
        Some(gathering) => gathering,
        None => {
            let mut entities = Geometry::entities(world);
            entities.reverse();
            (entities, Geometry::default())
        }
    };
    while let Some(entity) = entities.pop() {
        geometry.push(world, entity);
        if since.elapsed() > GATHERING && !is_hasty {
            break;
        }
    }
    let Some(mut truth) = world.get_resource_mut::<TruthView>() else {
        return;
    };
    if entities.is_empty() {
        let subject = truth.work.subject.as_ref();
        let sky = subject.and_then(|subject| subject.view.sky);
        truth.work.building.start(move || Stage::new(geometry, sky));
    } else {
        truth.work.gathering = Some((entities, geometry));
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
