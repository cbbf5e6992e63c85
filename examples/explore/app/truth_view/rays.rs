//! Rays in the background, coarse to fine.

use core::{
    sync::atomic::{AtomicUsize, Ordering},
    time::Duration,
};

use bevy::{
    math::{DMat4, DVec3},
    platform::{
        sync::{Arc, Mutex},
        time::Instant,
    },
    tasks::{AsyncComputeTaskPool, Task, TaskPool, futures_lite::future::yield_now},
};

use super::super::probe::View;
use crate::truth::{
    accuracy::Truth,
    gather::{Geometry, Surface},
    trace::{Lens, Sample, Tracer},
};

/// Pixels from ray to ray, pass by pass.
const STRIDES: [usize; 4] = [8, 4, 2, 1];

/// What part of the time rays may take on their thread.
const BUSY: f64 = 0.35;
/// They rest after so much work.
const SHIFT: Duration = Duration::from_millis(4);

/// A scene for rays.
pub(super) struct Stage {
    still: Option<Tracer>,
    /// What goes with the camera, and from its own to world space where it was gathered.
    sky: Option<(Tracer, DMat4)>,
}

impl Stage {
    pub(super) fn new(mut geometry: Geometry, sky: Option<DMat4>) -> Self {
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
pub(super) struct Pass {
    /// Of the pixels that have been traced, with the light of each one's center.
    pub(super) truth: Truth,
    /// Pixels from one that has been traced to the next.
    pub(super) stride: usize,
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
pub(super) struct Trace {
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
    pub(super) fn start(stage: Arc<Stage>, view: View, hasty: bool) -> Self {
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

    pub(super) fn progress(&self) -> f32 {
        let done = self.shared.done.load(Ordering::Relaxed);
        done as f32 / self.pixels.max(1) as f32
    }

    /// Never waits.
    pub(super) fn take(&self) -> Option<Pass> {
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
