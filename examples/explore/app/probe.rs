//! The share of the sun's light that the sides show, by linear pictures: a camera stands where the
//! sides' do, one for each of them after the other, then one that sees all of the sun's light and one
//! that sees none. The sides' pictures stay as they are meanwhile, so that a frame costs no more.

mod subject;

use core::sync::atomic::{AtomicBool, Ordering};

use bevy::{
    camera::{RenderTarget, visibility::RenderLayers},
    core_pipeline::tonemapping::{DebandDither, Tonemapping},
    light::ShadowFilteringMethod,
    platform::sync::Arc,
    prelude::*,
    render::{
        Render, RenderApp, RenderSystems,
        gpu_readback::{ReadbackComplete, ReadbackOnce},
        render_resource::{PipelineCache, TextureFormat, TextureUsages},
        renderer::RenderDevice,
    },
};

use super::{
    errand::Errand,
    sides::{LIT_LAYER, Pictures, Side, SideCamera, SideSun},
};
use crate::truth::light::{Picture, Reference};

pub use subject::{Scenery, Subject, View};

/// Left, right, with all of the sun's light, without any.
const SHOTS: usize = 4;
/// Before all cameras that are seen.
const FIRST_ORDER: isize = -10;
/// Frames without waiting pipelines after which a picture is final.
const QUIET_FRAMES: usize = 4;
/// Frames after which pictures that have not arrived are taken anew.
const PATIENCE: usize = 120;
const FORMAT: TextureFormat = TextureFormat::Rgba16Float;
/// Bytes of a pixel.
const PIXEL: usize = 8;

/// What the sides show of the sun's light.
pub struct Shares {
    /// Of what.
    pub subject: Subject,
    /// By side, if it is shown, and by pixel, where the sun's light would show.
    pub sides: [Option<Vec<Option<f32>>>; 2],
}

/// Finds [`Shares`] of what is wanted.
#[derive(Resource, Default)]
pub struct Probe {
    /// What has come to rest and is to be pictured.
    pub wanted: Option<Subject>,
    films: Films,
    state: State,
}

impl Probe {
    /// What was found of what was wanted last.
    pub fn shares(&self) -> Option<&Arc<Shares>> {
        match &self.state {
            State::Done(shares) => Some(shares),
            _ => None,
        }
    }
}

#[derive(Default)]
enum State {
    #[default]
    Idle,
    Shooting(Session),
    Developing(Subject, Errand<Shares>),
    Done(Arc<Shares>),
}

impl State {
    fn subject(&self) -> Option<&Subject> {
        match self {
            Self::Idle => None,
            Self::Shooting(session) => Some(&session.subject),
            Self::Developing(subject, _) => Some(subject),
            Self::Done(shares) => Some(&shares.subject),
        }
    }
}

/// What cameras draw into.
#[derive(Default)]
struct Films {
    size: UVec2,
    images: [Handle<Image>; SHOTS],
}

impl Films {
    /// Whether they had that size already: the renderer has new ones a frame later.
    fn have_size(&mut self, images: &mut Assets<Image>, size: UVec2) -> bool {
        if self.size == size {
            return true;
        }
        self.size = size;
        self.images = core::array::from_fn(|_| {
            let mut image = Image::new_target_texture(size.x, size.y, FORMAT, None);
            image.texture_descriptor.usage |= TextureUsages::COPY_SRC;
            images.add(image)
        });
        false
    }
}

/// The camera that stands there, and what others have taken before it.
struct Session {
    subject: Subject,
    /// A sun without shadows.
    sun: Entity,
    shot: usize,
    /// The shot's camera, and its picture if that is on its way.
    entities: Vec<Entity>,
    /// Frames in a row without waiting pipelines.
    quiet: usize,
    /// Frames since the picture was asked for.
    asked: Option<usize>,
    pictures: [Option<Vec<u8>>; SHOTS],
    /// Whether the sides' pictures would stay as they are anyway.
    were_held: bool,
}

/// Which picture is on its way.
#[derive(Component)]
struct Shot(usize);

impl Session {
    /// One more frame has been drawn.
    fn step(&mut self, commands: &mut Commands, films: &Films, pipelines_wait: bool) {
        if let Some(frames) = &mut self.asked {
            *frames += 1;
            return;
        }
        self.quiet = if pipelines_wait { 0 } else { self.quiet + 1 };
        if self.quiet >= QUIET_FRAMES {
            self.asked = Some(0);
            let readback = ReadbackOnce::texture(films.images[self.shot].clone());
            let picture = commands.spawn((readback, Shot(self.shot)));
            self.entities.push(picture.id());
        }
    }

    /// The next shot that has no picture yet, if the present one is done.
    fn next_shot(&self) -> Option<(usize, usize)> {
        let layers = self.subject.layers().into_iter().enumerate();
        let mut missing = layers.filter(|(shot, _)| self.pictures[*shot].is_none());
        missing.find_map(|(shot, layer)| Some((shot, layer?)))
    }

    fn is_lost(&self) -> bool {
        self.asked.is_some_and(|frames| frames > PATIENCE)
    }

    fn despawn(&mut self, commands: &mut Commands) {
        for entity in self.entities.drain(..) {
            commands.entity(entity).try_despawn();
        }
    }

    fn end(&mut self, commands: &mut Commands, pictures: &mut Pictures) {
        self.despawn(commands);
        commands.entity(self.sun).try_despawn();
        pictures.held = self.were_held;
    }
}

/// Keeps the [`Probe`] at work.
pub struct ProbePlugin;

impl Plugin for ProbePlugin {
    fn build(&self, app: &mut App) {
        let wait = PipelinesWait::default();
        app.init_resource::<Probe>()
            .insert_resource(wait.clone())
            // Early, as cascades are planned for each camera later in the frame.
            .add_systems(PreUpdate, take_pictures)
            .add_observer(receive);
        if let Some(render_app) = app.get_sub_app_mut(RenderApp) {
            render_app.insert_resource(wait).add_systems(
                Render,
                note_waiting_pipelines.in_set(RenderSystems::Cleanup),
            );
        }
    }
}

/// Whether pipelines were missing in the last frame that was drawn; both worlds have it.
#[derive(Resource, Clone, Default)]
struct PipelinesWait(Arc<AtomicBool>);

fn note_waiting_pipelines(cache: Res<PipelineCache>, wait: Res<PipelinesWait>) {
    let waits = cache.waiting_pipelines().next().is_some();
    wait.0.store(waits, Ordering::Relaxed);
}

fn take_pictures(
    mut commands: Commands,
    mut probe: ResMut<Probe>,
    wait: Res<PipelinesWait>,
    mut images: ResMut<Assets<Image>>,
    pictures: Option<ResMut<Pictures>>,
    cameras: Query<(&SideCamera, &Transform, &Projection, &ShadowFilteringMethod)>,
    suns: Query<(&SideSun, &Transform, &DirectionalLight)>,
) {
    let Some(mut pictures) = pictures else {
        return;
    };
    let Probe {
        wanted,
        films,
        state,
    } = &mut *probe;
    let is_lost = matches!(state, State::Shooting(session) if session.is_lost());
    if is_lost || state.subject() != wanted.as_ref() {
        if let State::Shooting(session) = state {
            session.end(&mut commands, &mut pictures);
        }
        *state = State::Idle;
    }
    let Some(wanted) = wanted else {
        return;
    };
    match state {
        State::Idle => {
            let sun = suns.iter().find(|(it, ..)| it.0 == Side::Left);
            let (Some((_, sun, light)), true) =
                (sun, films.have_size(&mut images, wanted.view.lens.size))
            else {
                return;
            };
            *state = State::Shooting(Session {
                subject: wanted.clone(),
                sun: spawn_sun(&mut commands, sun, light),
                shot: SHOTS,
                entities: Vec::new(),
                quiet: 0,
                asked: None,
                pictures: default(),
                were_held: pictures.held,
            });
            pictures.held = true;
        }
        State::Shooting(session) => {
            let camera = cameras.iter().find(|(it, ..)| it.0 == Side::Left);
            match (session.next_shot(), camera) {
                (Some((shot, _)), _) if shot == session.shot => {
                    session.step(&mut commands, films, wait.0.load(Ordering::Relaxed));
                }
                (Some((shot, layer)), Some((_, place, lens, filter))) => {
                    session.despawn(&mut commands);
                    (session.shot, session.quiet, session.asked) = (shot, 0, None);
                    let camera = commands.spawn((
                        linear_camera(layer, &films.images[shot]),
                        (*place, lens.clone(), *filter),
                    ));
                    session.entities.push(camera.id());
                }
                (Some(_), None) => {}
                (None, _) => {
                    session.end(&mut commands, &mut pictures);
                    let pictures = core::mem::take(&mut session.pictures);
                    let subject = wanted.clone();
                    let mut errand = Errand::default();
                    errand.start(move || develop(subject, pictures));
                    *state = State::Developing(wanted.clone(), errand);
                }
            }
        }
        State::Developing(_, errand) => {
            if let Some(shares) = errand.take() {
                *state = State::Done(Arc::new(shares));
            }
        }
        State::Done(_) => {}
    }
}

/// The left sun once more, with nothing to hold its light back.
fn spawn_sun(commands: &mut Commands, place: &Transform, light: &DirectionalLight) -> Entity {
    let light = DirectionalLight {
        shadow_maps_enabled: false,
        ..*light
    };
    let layers = RenderLayers::layer(LIT_LAYER);
    commands.spawn((light, *place, layers)).id()
}

/// A camera whose picture is linear in the sun's light.
fn linear_camera(layer: usize, image: &Handle<Image>) -> impl Bundle + use<> {
    (
        Camera3d::default(),
        Camera {
            order: FIRST_ORDER,
            ..default()
        },
        RenderTarget::from(image.clone()),
        RenderLayers::layer(layer),
        Tonemapping::None,
        DebandDither::Disabled,
        Msaa::Off,
    )
}

fn receive(mut picture: On<ReadbackComplete>, shots: Query<&Shot>, mut probe: ResMut<Probe>) {
    // Those of a session that has ended are not there any more.
    let Ok(Shot(shot)) = shots.get(picture.entity) else {
        return;
    };
    if let State::Shooting(session) = &mut probe.state
        && let Some(slot) = session.pictures.get_mut(*shot)
    {
        *slot = Some(core::mem::take(&mut picture.event_mut().data));
    }
}

fn develop(subject: Subject, pictures: [Option<Vec<u8>>; SHOTS]) -> Shares {
    let size = subject.view.lens.size;
    let picture = |bytes: Option<Vec<u8>>| {
        let bytes = without_padding(&bytes?, size);
        Some(Picture::from_bytes(&bytes))
    };
    let [left, right, lit, dark] = pictures.map(picture);
    let reference = lit.zip(dark).map(|(lit, dark)| Reference { lit, dark });
    let shares = |picture: Option<Picture>| Some(reference.as_ref()?.shares(&picture?));
    Shares {
        sides: [left, right].map(shares),
        subject,
    }
}

/// The GPU copies rows of certain lengths only.
fn without_padding(bytes: &[u8], size: UVec2) -> Vec<u8> {
    let row = size.x as usize * PIXEL;
    let padded = RenderDevice::align_copy_bytes_per_row(row);
    let rows = bytes.chunks(padded).filter_map(|padded| padded.get(..row));
    rows.flatten().copied().collect()
}
