//! Runs [`plan_cascades`](crate::plan::plan_cascades) for every managed light and 3D camera, over what
//! the camera sees.

use core::any::TypeId;

use bevy::{
    asset::Assets,
    camera::{
        Camera, Camera3d, Projection,
        visibility::{InheritedVisibility, NoCpuCulling, RenderLayers, VisibleEntities},
    },
    ecs::{
        component::Component,
        entity::{Entity, EntityHashMap, EntityHashSet},
        query::{Has, QueryData, With},
        reflect::ReflectResource,
        resource::Resource,
        system::{Local, Query, Res, ResMut},
    },
    light::{DirectionalLight, VolumetricFog, VolumetricLight},
    log::warn,
    math::DVec3,
    mesh::{Mesh, Mesh3d},
    reflect::{Reflect, std_traits::ReflectDefault},
    transform::components::GlobalTransform,
};

use super::{
    ChangedCasters, DisplacedMeshes, ManagedLight, MeshBoxes, ShadowMemoryLimit, ShadowUpdates,
    SharedViews, SharesShadowsWith,
    gather::{IsReceiver, ReceiverMesh, receivers, view_volume},
    memory::{OtherMaps, halvings_for, halvings_within},
    publish::PublishedCascades,
    share::Sharer,
};
use crate::{
    config::{ParallelSplitShadows, ShadowFocus},
    geometry::{light_frame::LightFrame, receivers::Receivers, slice::ViewVolume},
    plan::{CascadePlan, CasterChanges, PlanHistory, PlanInputs, lookup_reach, plan_cascades},
    support::ShadowSupport,
};

/// The plans of a managed light, one list of cascades for each active 3D camera that shares no other one's maps
/// ([`SharesShadowsWith`]).
#[derive(Component, Debug, Default, Clone)]
pub struct ShadowPlans {
    /// By camera.
    pub views: EntityHashMap<Vec<CascadePlan>>,
    history: EntityHashMap<PlanHistory>,
    /// Of the light when they were made.
    layers: RenderLayers,
    /// The light had [`ShadowUpdates::Always`].
    was_restless: bool,
    /// Up to when changes of casters have been heeded ([`ChangedCasters::frame`]).
    heeded: u64,
}

/// The point in world space on which texel grids are anchored (meters).
///
/// A game with a floating origin, which moves its whole world by an offset now and then, adds the same
/// offset here: then no texel moves, as exactly as the offset can be represented.
#[derive(Resource, Reflect, Debug, Default, Clone, Copy, PartialEq)]
#[reflect(Resource, Default, Debug, Clone, PartialEq)]
pub struct ShadowGridOrigin(pub DVec3);

impl ShadowGridOrigin {
    /// Where grids are anchored, whatever it says.
    pub(super) fn get(&self) -> DVec3 {
        if self.0.is_finite() {
            self.0
        } else {
            DVec3::ZERO
        }
    }
}

#[derive(QueryData)]
pub struct PlannedCamera {
    entity: Entity,
    transform: &'static GlobalTransform,
    projection: &'static Projection,
    camera: &'static Camera,
    visible: &'static VisibleEntities,
    layers: Option<&'static RenderLayers>,
    shares_with: Option<&'static SharesShadowsWith>,
    has_fog: Has<VolumetricFog>,
}

#[derive(QueryData)]
#[query_data(mutable)]
pub struct PlannedLight {
    entity: Entity,
    transform: &'static GlobalTransform,
    light: &'static DirectionalLight,
    managed: &'static ManagedLight,
    inherited: &'static InheritedVisibility,
    layers: Option<&'static RenderLayers>,
    is_volumetric: Has<VolumetricLight>,
    updates: Option<&'static ShadowUpdates>,
    plans: &'static mut ShadowPlans,
    published: PublishedCascades,
}

impl ShadowPlans {
    /// Forgets what was held for a camera.
    pub(super) fn forget(&mut self, camera: Entity) {
        self.history.remove(&camera);
    }

    /// Forgets what was held.
    pub(super) fn forget_all(&mut self) {
        self.history.clear();
    }
}

/// What a camera is to a light's shadows.
pub enum View {
    /// No managed light shines for it.
    Unlit,
    /// Its transform or projection is degenerate.
    Degenerate,
    Seen(Seen),
}

/// What a camera sees.
pub struct Seen {
    volume: ViewVolume,
    has_fog: bool,
    image_height: f64,
    /// So do its receivers.
    rests: bool,
}

/// The receivers before a camera, and what they were gathered from.
pub struct Gathered {
    volume: ViewVolume,
    /// Of the lights that they are for (meters).
    far: f64,
    visible: Vec<Entity>,
    receivers: Receivers,
    /// No more of them will be known in the next frame.
    is_settled: bool,
}

/// Whether a light casts shadows on anything.
pub(super) fn shines(light: &DirectionalLight, inherited: &InheritedVisibility) -> bool {
    light.shadow_maps_enabled && light.illuminance != 0.0 && inherited.get()
}

fn layers_of(layers: Option<&RenderLayers>) -> RenderLayers {
    layers.cloned().unwrap_or_default()
}

/// The configurations of the lights that cast shadows on anything that a camera of some render layers sees.
fn shining<'a>(
    lights: &'a Query<PlannedLight>,
    camera: &'a RenderLayers,
) -> impl Iterator<Item = &'a ParallelSplitShadows> {
    let lights = lights.iter().filter(|it| shines(it.light, it.inherited));
    let lights = lights.filter(|it| it.layers.unwrap_or_default().intersects(camera));
    lights.filter_map(|it| it.managed.config())
}

/// For each view and light the configuration of its maps, and how often they are halved as they are.
fn maps_of<'a>(
    lights: &'a Query<PlannedLight>,
    views: &'a [(Entity, RenderLayers, View)],
) -> impl Iterator<Item = (&'a ParallelSplitShadows, u32)> {
    views.iter().flat_map(move |(_, layers, view)| {
        let height = match view {
            View::Seen(seen) if seen.image_height > 1.0 => Some(seen.image_height),
            _ => None,
        };
        let maps = move |height| {
            let shining = shining(lights, layers);
            shining.map(move |config| (config, halvings_for(config, height)))
        };
        height.into_iter().flat_map(maps)
    })
}

/// Plans the cascades of every managed light for every active 3D camera. Runs in
/// [`PssmSystems::PlanCascades`](super::PssmSystems::PlanCascades).
pub fn plan_shadows(
    cameras: Query<PlannedCamera, With<Camera3d>>,
    meshes: Query<ReceiverMesh, IsReceiver>,
    unculled: Query<Entity, (With<NoCpuCulling>, IsReceiver)>,
    mut lights: Query<PlannedLight>,
    assets: Option<Res<Assets<Mesh>>>,
    mut parts: ResMut<MeshBoxes>,
    displaced: Res<DisplacedMeshes>,
    (origin, limit, support): (
        Res<ShadowGridOrigin>,
        Res<ShadowMemoryLimit>,
        Res<ShadowSupport>,
    ),
    others: OtherMaps,
    mut shared: ResMut<SharedViews>,
    changed: Res<ChangedCasters>,
    mut gathered: Local<EntityHashMap<Gathered>>,
    mut views: Local<Vec<(Entity, RenderLayers, View)>>,
    (mut warned, mut warned_of_memory): (Local<EntityHashSet>, Local<bool>),
) {
    let displaced = displaced.get();
    let active = || cameras.iter().filter(|it| it.camera.is_active);
    // Bevy's pass draws for each camera.
    let may_share = support.draws_maps() && active().nth(1).is_some();
    shared.update(|| {
        let sharers = active().filter(|_| may_share);
        sharers.map(|it| Sharer {
            camera: it.entity,
            with: it.shares_with.map(|it| it.0),
            layers: layers_of(it.layers),
            volume: view_volume(it.transform, it.projection, it.camera),
            is_drawn: it
                .camera
                .physical_target_size()
                .is_some_and(|size| size.min_element() > 0),
        })
    });
    views.clear();
    for it in active().filter(|it| shared.host_of(it.entity).is_none()) {
        let layers = layers_of(it.layers);
        let guests = || cameras.iter_many(shared.guests_of(it.entity)).flatten();
        let has_guests = guests().next().is_some();
        let meeting = || shining(&lights, &layers);
        let far = meeting()
            .map(|config| f64::from(config.far))
            .fold(0.0, f64::max);
        let own_volume = || view_volume(it.transform, it.projection, it.camera);
        let view = match shared.volume_of(it.entity).or_else(own_volume) {
            _ if meeting().next().is_none() => View::Unlit,
            None => View::Degenerate,
            Some(volume) => {
                let all = || guests().chain(cameras.get(it.entity));
                let heights = all().filter_map(|it| it.camera.physical_viewport_size());
                let height = heights.map(|size| size.y).max().unwrap_or(1);
                let is_focused =
                    meeting().any(|config| config.comparison.focus == ShadowFocus::Receivers);
                let visible = || {
                    let meshes = all().flat_map(|it| it.visible.get(TypeId::of::<Mesh3d>()));
                    meshes.copied().chain(&unculled).filter(|_| is_focused)
                };
                let is_same = |last: &Gathered| {
                    let is_known = last.is_settled && parts.are_settled();
                    let is_there = last.volume == volume && last.far == far;
                    is_known && is_there && visible().eq(last.visible.iter().copied())
                };
                let rests = !changed.have_receivers_changed()
                    && gathered.get(&it.entity).is_some_and(is_same);
                if !rests {
                    let last = gathered.remove(&it.entity);
                    let mut seen = last.map_or_else(Vec::new, |last| last.visible);
                    seen.clear();
                    seen.extend(visible());
                    let visible = seen;
                    let receivers = if is_focused {
                        // Of what several cameras see, each once.
                        let mut once = Vec::new();
                        if has_guests {
                            once.clone_from(&visible);
                            once.sort_unstable();
                            once.dedup();
                        }
                        let once = if has_guests { &once } else { &visible };
                        let assets = assets.as_deref();
                        receivers(&volume, far, &meshes, once, assets, &mut parts, &displaced)
                    } else {
                        Receivers::everywhere(&volume)
                    };
                    let gathered_now = Gathered {
                        volume,
                        far,
                        visible,
                        receivers,
                        is_settled: parts.take_is_settled(),
                    };
                    gathered.insert(it.entity, gathered_now);
                }
                View::Seen(Seen {
                    volume,
                    has_fog: all().any(|it| it.has_fog),
                    image_height: f64::from(height.max(1)),
                    rests,
                })
            }
        };
        views.push((it.entity, layers, view));
    }

    // What changes while nothing is gathered is not known afterwards.
    gathered.retain(|view, _| {
        let mut seen = views
            .iter()
            .filter(|(.., seen)| matches!(seen, View::Seen(_)));
        seen.any(|(active, ..)| active == view)
    });

    let others = others.layers(active().map(|it| layers_of(it.layers)));
    let maps = || maps_of(&lights, &views);
    let halvings = halvings_within(*limit, maps, others);
    if halvings > 0 && !core::mem::replace(&mut *warned_of_memory, true) {
        warn!(
            "Shadow maps would take more than {} MiB together: all are halved until they fit",
            limit.0 >> 20
        );
    }

    for mut it in &mut lights {
        let Some(config) = it.managed.config() else {
            *it.plans = ShadowPlans::default();
            continue;
        };
        let shines = shines(it.light, it.inherited);
        let layers = layers_of(it.layers);
        it.published.hide();

        let origin = origin.get();
        let frame = LightFrame::new(it.transform.rotation().as_dquat() * DVec3::Z);
        let frame = frame.map(|frame| frame.at(origin));
        let mut is_degenerate = frame.is_none();
        let ShadowPlans {
            views: planned,
            history,
            layers: known_layers,
            was_restless,
            heeded,
        } = &mut *it.plans;
        let is_restless = it.updates == Some(&ShadowUpdates::Always);
        let was_restless = core::mem::replace(was_restless, is_restless);
        // Lights may have been away, and Bevy's pass holds no maps.
        let has_heeded = *heeded + 1 == changed.frame();
        *heeded = if support.draws_maps() {
            changed.frame()
        } else {
            0
        };
        let is_quiet = !is_restless && !was_restless;
        let changes = if *known_layers == layers && is_quiet && has_heeded {
            changed.get()
        } else {
            &CasterChanges::Anywhere
        };
        known_layers.clone_from(&layers);
        planned.retain(|view, _| views.iter().any(|(active, ..)| active == view));
        history.retain(|view, _| views.iter().any(|(active, ..)| active == view));
        for (view, of_camera, seen) in &*views {
            let meets = shines && layers.intersects(of_camera);
            is_degenerate |= meets && matches!(seen, View::Degenerate);
            let plan = match (seen, &frame, gathered.get(view)) {
                (View::Seen(seen), Some(frame), Some(known)) if meets => {
                    let fog = Receivers::fog(&seen.volume);
                    let is_foggy = it.is_volumetric && seen.has_fog;
                    let halvings = halvings + halvings_for(config, seen.image_height);
                    let is_late = is_restless && config.delay > 0;
                    let changed = (halvings > 0 || is_late).then(|| ParallelSplitShadows {
                        map_size: config.map_size.halved(halvings, config.cascades),
                        delay: if is_restless { 0 } else { config.delay },
                        ..config.clone()
                    });
                    let inputs = PlanInputs {
                        view: &seen.volume,
                        light: frame,
                        config: changed.as_ref().unwrap_or(config),
                        reach: lookup_reach(config, it.light),
                        receivers: if is_foggy { &fog } else { &known.receivers },
                        image_height: seen.image_height,
                        changes,
                    };
                    let history = history.entry(*view).or_default();
                    if seen.rests && planned.contains_key(view) && history.is_at_rest(&inputs) {
                        continue;
                    }
                    plan_cascades(&inputs, history)
                }
                _ => {
                    history.remove(view);
                    Vec::new()
                }
            };
            planned.insert(*view, plan);
        }
        let light = it.entity;
        if is_degenerate && warned.insert(light) {
            warn!(
                "Light {light} or a camera has a degenerate transform or projection: no shadows there"
            );
        }
    }
}
