//! What a frame costs, side by side, and how that has been of late.

mod cascades;
mod gpu;
mod plot;
mod text;

use core::time::Duration;

use bevy::{
    camera::visibility::VisibilitySystems,
    diagnostic::DiagnosticsStore,
    light::SimulationLightSystems,
    platform::time::Instant,
    prelude::*,
    render::{Render, RenderApp, RenderSystems, diagnostic::RenderDiagnosticsPlugin},
};
use bevy_pssm::{PssmSystems, config::MAX_CASCADES, plan::Redraw};

use super::{
    maps::{SideMapsPlugin, find_side_maps},
    sides::Side,
};
use cascades::{Eye, Sun, cascades_of};
use gpu::{GpuReport, Heard, Maps, listen};
pub use plot::PLOT_SIZE;
use plot::{Plot, ground};

/// Figures that change faster cannot be read.
const TEXT_INTERVAL: Duration = Duration::from_millis(250);
const PLOT_INTERVAL: Duration = Duration::from_millis(100);

/// Of the last frame in the mean of planning's time.
const PLANNING_SHARE: f64 = 0.1;

/// Keeps [`Counters`] up to date.
pub struct CountersPlugin;

impl Plugin for CountersPlugin {
    fn build(&self, app: &mut App) {
        if !app.is_plugin_added::<RenderDiagnosticsPlugin>() {
            app.add_plugins(RenderDiagnosticsPlugin);
        }
        if !app.is_plugin_added::<SideMapsPlugin>() {
            app.add_plugins(SideMapsPlugin);
        }
        let heard = Heard::default();
        app.insert_resource(heard.clone())
            .init_resource::<Counters>()
            .add_systems(
                PostUpdate,
                (
                    begin
                        .after(VisibilitySystems::CheckVisibility)
                        .after(SimulationLightSystems::UpdateDirectionalLightCascades)
                        .before(PssmSystems::PlanCascades),
                    (end, count).chain().after(PssmSystems::CullCasters),
                ),
            );
        if let Some(render_app) = app.get_sub_app_mut(RenderApp) {
            let listen = listen
                .in_set(RenderSystems::PrepareViews)
                .after(find_side_maps);
            render_app
                .insert_resource(heard)
                .add_systems(Render, listen);
        }
    }
}

/// What the frame costs.
#[derive(Resource, Debug)]
pub struct Counters {
    /// They are shown.
    pub on: bool,
    /// From when the plugin could begin to plan until it has culled (milliseconds, a mean of the last frames).
    pub planning: f64,
    began: Option<Instant>,
    /// Of the last frame.
    pub latest: Figures,
    /// Milliseconds of frames, vertices of all shadow passes and maps drawn in a frame.
    pub plots: [Plot; 3],
    /// Means of some frames, as the text has them.
    shown: Figures,
    window: Window,
    report: GpuReport,
    reported: Option<Instant>,
    painted: Option<Instant>,
}

/// Figures of a frame, or their means.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Figures {
    /// From frame to frame (milliseconds).
    pub frame: f64,
    /// The GPU's time for the main passes of all cameras (milliseconds); none where it has no clock.
    pub main: Option<f64>,
    /// What all shadow maps of directional and spot lights take (bytes).
    pub bytes: u64,
    /// Left and right.
    pub sides: [SideFigures; 2],
}

/// Figures of a side.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SideFigures {
    /// None while the side is not shown or has no shadows.
    pub cascades: Vec<CascadeFigures>,
    /// Maps drawn in a frame.
    pub drawn: f64,
    /// What its shadow passes cost; none where Bevy draws the maps, as it does not count.
    pub passes: Option<PassFigures>,
}

/// Figures of a cascade.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CascadeFigures {
    /// Depth at which it ends (meters).
    pub far: f64,
    /// Casters in its map.
    pub casters: usize,
    /// Casters that are drawn over it in each frame.
    pub moving: usize,
    /// What becomes of its map.
    pub map: MapState,
    /// Texels across a pixel, where they are predicted to be fewest.
    pub texels_per_pixel: Option<f64>,
    /// Side of a texel, where it is largest (meters).
    pub texel: Option<f64>,
}

/// What becomes of a map in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MapState {
    /// Nothing to be shadowed is seen: there is none.
    #[default]
    Missing,
    /// It stays as it is.
    Held,
    /// It is drawn, for a reason.
    Drawn(Redraw),
    /// Bevy draws it, as in each frame.
    BuiltIn,
}

/// What shadow passes cost in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PassFigures {
    /// Vertex shader invocations; none where the GPU does not count.
    pub vertices: Option<f64>,
    /// Primitives that reached the clipper.
    pub primitives: Option<f64>,
    /// The GPU's time (milliseconds); none where it has no clock.
    pub milliseconds: Option<f64>,
}

impl MapState {
    fn is_drawn(self) -> bool {
        matches!(self, Self::Drawn(_) | Self::BuiltIn)
    }
}

impl FromWorld for Counters {
    fn from_world(world: &mut World) -> Self {
        let mut images = world.get_resource_mut::<Assets<Image>>();
        let mut plot = |title, color| {
            let image = images.as_mut().map(|images| images.add(ground()));
            Plot::new(title, color, image.unwrap_or_default())
        };
        Self {
            on: true,
            planning: 0.0,
            began: None,
            latest: Figures::default(),
            plots: [
                plot("frame (ms)", [120, 200, 255]),
                plot("shadow vertices", [255, 180, 90]),
                plot("maps drawn", [140, 230, 140]),
            ],
            shown: Figures::default(),
            window: Window::default(),
            report: GpuReport::default(),
            reported: None,
            painted: None,
        }
    }
}

/// The frames since the text was last written.
#[derive(Debug, Default)]
struct Window {
    since: Option<Instant>,
    frames: u32,
    seconds: f64,
    reports: u32,
    report: GpuReport,
    drawn: [usize; 2],
    /// The last reasons for which maps were drawn.
    redrawn: [[Option<MapState>; MAX_CASCADES]; 2],
}

impl Window {
    fn add(&mut self, seconds: f64, news: Option<GpuReport>, sides: &[Vec<CascadeFigures>; 2]) {
        self.frames += 1;
        self.seconds += seconds;
        if let Some(news) = news {
            self.reports += 1;
            self.report = self.report.plus(news);
        }
        for (side, cascades) in sides.iter().enumerate() {
            self.drawn[side] += drawn(cascades);
            for (last, cascade) in self.redrawn[side].iter_mut().zip(cascades) {
                if cascade.map.is_drawn() {
                    *last = Some(cascade.map);
                }
            }
        }
    }

    /// Means, beside what is true now. What is seldom drawn shows why all the same.
    fn means(&self, now: &Figures) -> Figures {
        let frames = f64::from(self.frames.max(1));
        let reports = f64::from(self.reports.max(1));
        let mut means = now.clone();
        means.frame = 1e3 * self.seconds / frames;
        if self.reports > 0 {
            means.main = self.report.main_of(reports);
        }
        for side in Side::BOTH {
            let index = side.index();
            let figures = &mut means.sides[index];
            figures.drawn = self.drawn[index] as f64 / frames;
            if self.reports > 0 && figures.passes.is_some() {
                figures.passes = Some(self.report.passes_of(side, reports));
            }
            for (cascade, last) in figures.cascades.iter_mut().zip(self.redrawn[index]) {
                cascade.map = last.unwrap_or(cascade.map);
            }
        }
        means
    }
}

fn drawn(cascades: &[CascadeFigures]) -> usize {
    cascades.iter().filter(|it| it.map.is_drawn()).count()
}

fn begin(mut counters: ResMut<Counters>) {
    counters.began = Some(Instant::now());
}

/// Lights of both sides and of probes together; what else runs meanwhile takes its share of the cores.
fn end(mut counters: ResMut<Counters>) {
    if let Some(began) = counters.began.take() {
        let milliseconds = 1e3 * began.elapsed().as_secs_f64();
        counters.planning += PLANNING_SHARE * (milliseconds - counters.planning);
    }
}

fn count(
    mut counters: ResMut<Counters>,
    heard: Res<Heard>,
    store: Option<Res<DiagnosticsStore>>,
    time: Res<Time<Real>>,
    suns: Query<Sun>,
    eyes: Query<Eye>,
    mut images: ResMut<Assets<Image>>,
) {
    let counters = &mut *counters;
    let maps = heard.maps().unwrap_or_default();
    let seconds = time.delta_secs_f64();
    let news = store
        .as_deref()
        .and_then(|store| GpuReport::of_latest(store, &maps.layers, &mut counters.reported));
    counters.report = news.unwrap_or(counters.report);
    let cascades = Side::BOTH.map(|side| cascades_of(side, &suns, &eyes));
    counters.window.add(seconds, news, &cascades);
    counters.latest = figures(seconds, &counters.report, &maps, cascades);
    counters.plot();

    let now = Instant::now();
    if is_due(&mut counters.window.since, now, TEXT_INTERVAL) {
        counters.shown = counters.window.means(&counters.latest);
        counters.window = Window {
            since: Some(now),
            ..default()
        };
    }
    if is_due(&mut counters.painted, now, PLOT_INTERVAL) {
        for plot in &counters.plots {
            plot.paint(&mut images);
        }
    }
}

fn is_due(last: &mut Option<Instant>, now: Instant, interval: Duration) -> bool {
    let is_due = last.is_none_or(|last| now.duration_since(last) >= interval);
    if is_due {
        *last = Some(now);
    }
    is_due
}

fn figures(
    seconds: f64,
    report: &GpuReport,
    maps: &Maps,
    cascades: [Vec<CascadeFigures>; 2],
) -> Figures {
    let mut sides = <[SideFigures; 2]>::default();
    for (side, cascades) in Side::BOTH.into_iter().zip(cascades) {
        let has_layers = maps.layers[side.index()].iter().any(Option::is_some);
        sides[side.index()] = SideFigures {
            drawn: drawn(&cascades) as f64,
            passes: has_layers.then(|| report.passes_of(side, 1.0)),
            cascades,
        };
    }
    Figures {
        frame: 1e3 * seconds,
        main: report.main_of(1.0),
        bytes: maps.bytes,
        sides,
    }
}

impl Counters {
    fn plot(&mut self) {
        let sides = &self.latest.sides;
        let vertices = sides.iter().filter_map(|side| side.passes?.vertices);
        let vertices: f64 = vertices.sum();
        let drawn: f64 = sides.iter().map(|side| side.drawn).sum();
        let values = [self.latest.frame, vertices, drawn];
        for (plot, value) in self.plots.iter_mut().zip(values) {
            plot.push(value);
        }
    }
}
