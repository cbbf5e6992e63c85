//! From the main world to the render world.

use bevy::{
    camera::{
        Camera, Camera3d,
        primitives::{CascadesFrusta, Frustum},
        visibility::CascadesVisibleEntities,
    },
    ecs::{
        entity::{Entity, EntityHashMap},
        query::{QueryData, With},
        resource::Resource,
        system::{Local, Query, Res, ResMut, SystemState},
        world::World,
    },
    light::{CascadeShadowConfig, Cascades, DirectionalLight, DirectionalLightShadowMap},
    math::{DVec2, UVec2, Vec3},
    render::{
        Extract, MainWorld,
        camera::DirtySpecializations,
        sync_world::{MainEntity, MainEntityHashMap, MainEntityHashSet, RenderEntity},
    },
    shape::ViewFrustum,
};

use super::options::LookupOptions;
use crate::{
    config::{MAX_CASCADES, MIN_MAP_SIZE},
    debug::ShadowOverlay,
    plan::{CascadeMap, CascadePlan, Redraw},
    systems::{
        CascadeSet, CasterCascades, ChangedCasters, ManagedLight, ShadowPlans, ShadowUpdates,
        SharedViews, empty_cascade,
    },
};

/// What the render world needs to know of the managed lights' plans.
#[derive(Resource, Debug, Default)]
pub(crate) struct ExtractedShadows {
    pub lights: MainEntityHashMap<ExtractedLight>,
    /// Texels per side of Bevy's maps, as the game wants them.
    pub built_in_size: usize,
    pub overlay: ShadowOverlay,
    /// By the camera that looks up another one's maps: that one.
    pub hosts: MainEntityHashMap<MainEntity>,
    /// Of casters that have been edited, those whose edits need not show.
    pub unheeded: MainEntityHashSet,
    /// Counts frames.
    pub frame: u64,
}

#[derive(Debug)]
pub(crate) struct ExtractedLight {
    pub options: LookupOptions,
    /// By camera: its cascades.
    pub views: MainEntityHashMap<Vec<ExtractedCascade>>,
    /// Casters that are added to what maps hold.
    pub added: CastersOfViews,
    /// Casters that move.
    pub moving: CastersOfViews,
}

/// By camera: casters for each cascade, in the order of their entities.
type CastersOfViews = MainEntityHashMap<[Vec<(Entity, MainEntity)>; MAX_CASCADES]>;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ExtractedCascade {
    pub map_size: UVec2,
    pub has_map: bool,
    /// What was drawn last still serves, maybe with more casters.
    pub may_keep: bool,
    /// It is drawn without casters too.
    pub is_drawn_always: bool,
    /// Size of a texel (meters), and NDC depth per meter towards the light: of maps that are not
    /// in perspective.
    pub texel: [f32; 2],
    pub depth_per_meter: f32,
    pub blend_start: f32,
    pub far: f32,
    pub wedge: Option<ExtractedWedge>,
}

/// The side of the view that a cascade is for, and the outward normals of its wedge's planes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ExtractedWedge {
    pub side: usize,
    pub normals: [Vec3; 2],
}

impl ExtractedCascade {
    /// A cascade that exists for Bevy but has no plan: its light or camera is degenerate.
    pub const NO_MAP: Self = Self {
        map_size: UVec2::splat(MIN_MAP_SIZE),
        has_map: false,
        may_keep: false,
        is_drawn_always: false,
        texel: [0.0; 2],
        depth_per_meter: 0.0,
        blend_start: f32::MAX,
        far: f32::MAX,
        wedge: None,
    };
}

impl From<&CascadePlan> for ExtractedCascade {
    fn from(plan: &CascadePlan) -> Self {
        let map = plan.map.as_ref();
        Self {
            map_size: plan.map_size,
            has_map: map.is_some(),
            may_keep: map.is_some_and(|map| matches!(map.redraw, None | Some(Redraw::Added))),
            is_drawn_always: false,
            texel: map.map_or([0.0; 2], |map| texel_edges(map, plan.map_size)),
            depth_per_meter: map.map_or(0.0, |map| {
                map.clip_from_world.row(2).truncate().length() as f32
            }),
            // Apart from the end, or shaders would divide by nothing.
            blend_start: plan.blend_start.min(plan.far - 1e-6 * plan.far.abs()) as f32,
            far: plan.far as f32,
            wedge: plan.wedge.map(|wedge| ExtractedWedge {
                side: wedge.side,
                normals: wedge.planes.map(|plane| plane.normal.as_vec3()),
            }),
        }
    }
}

/// How far texels next to each other lie apart across the light, along both of a map's axes (meters): of maps
/// that are not in perspective.
fn texel_edges(map: &CascadeMap, map_size: UVec2) -> [f32; 2] {
    let [x, y, z] = [0, 1, 2].map(|row| map.clip_from_world.row(row).truncate());
    let per_area = x.dot(y.cross(z)).abs().recip();
    let per_ndc = DVec2::new(y.cross(z).length(), z.cross(x).length()) * per_area;
    (2.0 * per_ndc / map_size.as_dvec2()).as_vec2().to_array()
}

#[derive(QueryData)]
pub(super) struct LightToExtract {
    entity: Entity,
    managed: &'static ManagedLight,
    plans: &'static ShadowPlans,
    light: &'static DirectionalLight,
    updates: Option<&'static ShadowUpdates>,
    casters: &'static CasterCascades,
}

pub(super) fn extract_shadows(
    mut extracted: ResMut<ExtractedShadows>,
    lights: Extract<Query<LightToExtract>>,
    overlay: Extract<Res<ShadowOverlay>>,
    built_in: Extract<Res<DirectionalLightShadowMap>>,
    shared: Extract<Res<SharedViews>>,
    mapper: Extract<Query<RenderEntity>>,
    updates: Extract<Query<&ShadowUpdates>>,
    changed: Extract<Res<ChangedCasters>>,
    dirty: Res<DirtySpecializations>,
) {
    let pair = |caster: Entity| {
        let synced = mapper.get(caster).unwrap_or(Entity::PLACEHOLDER);
        (synced, MainEntity::from(caster))
    };
    extracted.built_in_size = built_in.size;
    extracted.overlay = **overlay;
    let hosts = shared.pairs();
    let hosts = hosts.map(|(guest, host)| (MainEntity::from(guest), MainEntity::from(host)));
    extracted.hosts = hosts.collect();
    extracted.frame += 1;
    extracted.unheeded.clear();
    let edited = dirty.changed_renderables.iter();
    let need_not_show = |it: &&MainEntity| {
        changed.moving().is_edited_often(it.id())
            && updates.get(it.id()) == Ok(&ShadowUpdates::Never)
    };
    extracted
        .unheeded
        .extend(edited.filter(need_not_show).copied());
    extracted.lights.clear();
    for it in &lights {
        let config = it.managed.config();
        let Some(config) = config.filter(|_| it.light.shadow_maps_enabled) else {
            continue;
        };
        let is_drawn_always = it.updates == Some(&ShadowUpdates::Always);
        let cascade = |plan: &CascadePlan| ExtractedCascade {
            is_drawn_always,
            ..ExtractedCascade::from(plan)
        };
        let views = it.plans.views.iter().map(|(view, plans)| {
            let cascades = plans.iter().map(cascade).collect();
            (MainEntity::from(*view), cascades)
        });
        let views = views.collect();
        let of_cascades = |views: &EntityHashMap<Vec<(Entity, CascadeSet)>>| {
            let views = views.iter().map(|(view, casters)| {
                let of_cascade = |index| {
                    let inside = casters.iter().filter(|(_, set)| set.contains(index));
                    inside.map(|(caster, _)| pair(*caster)).collect()
                };
                (MainEntity::from(*view), core::array::from_fn(of_cascade))
            });
            views.collect()
        };
        let options = LookupOptions::new(config, it.light);
        extracted.lights.insert(
            MainEntity::from(it.entity),
            ExtractedLight {
                options,
                views,
                added: of_cascades(&it.casters.added),
                moving: of_cascades(&it.casters.moving),
            },
        );
    }
}

#[derive(QueryData)]
#[query_data(mutable)]
pub(super) struct LateLight {
    entity: Entity,
    light: &'static DirectionalLight,
    config: &'static CascadeShadowConfig,
    cascades: &'static mut Cascades,
    frusta: &'static mut CascadesFrusta,
    lists: &'static mut CascadesVisibleEntities,
}

type LateCameras<'w, 's> = Query<'w, 's, (Entity, &'static Camera), With<Camera3d>>;

/// Lights, and cameras that render and that they have no cascades for.
fn missing_views(
    lights: &Query<LateLightReadOnly>,
    cameras: &LateCameras,
) -> impl Iterator<Item = (Entity, Entity)> {
    let shadowed = lights.iter().filter(|it| it.light.shadow_maps_enabled);
    shadowed.flat_map(|it| {
        let active = cameras.iter().filter(|(_, camera)| camera.is_active);
        let missing = active.filter(move |(camera, _)| {
            let is_complete = |len: Option<usize>| len == Some(it.config.bounds.len());
            let has_cascades = is_complete(it.cascades.cascades.get(camera).map(Vec::len));
            let has_frusta = is_complete(it.frusta.frusta.get(camera).map(Vec::len));
            !(has_cascades && has_frusta && it.lists.entities.contains_key(camera))
        });
        missing.map(move |(camera, _)| (it.entity, camera))
    })
}

pub(super) fn are_views_missing(
    lights: Extract<Query<LateLightReadOnly>>,
    cameras: Extract<LateCameras>,
) -> bool {
    missing_views(&lights, &cameras).next().is_some()
}

/// Bevy's renderer expects every active camera in every shadowed light's maps and panics over
/// one that was activated, or a light that was enabled, after they were filled. Such a view
/// gets cascades that cover nothing, for the one frame.
pub(super) fn fill_missing_views(
    mut main_world: ResMut<MainWorld>,
    mut state: Local<
        Option<
            SystemState<(
                Query<'static, 'static, LateLight>,
                LateCameras<'static, 'static>,
            )>,
        >,
    >,
) {
    let world: &mut World = &mut main_world;
    let state = state.get_or_insert_with(|| SystemState::new(world));
    let Ok((mut lights, cameras)) = state.get_mut(world) else {
        return;
    };
    let missing: Vec<_> = missing_views(&lights.as_readonly(), &cameras).collect();
    for (light, camera) in missing {
        let Ok(mut it) = lights.get_mut(light) else {
            continue;
        };
        let count = it.config.bounds.len();
        let empty = empty_cascade();
        let frustum = Frustum(ViewFrustum::from_clip_from_world(&empty.clip_from_world));
        it.cascades.cascades.insert(camera, vec![empty; count]);
        it.frusta.frusta.insert(camera, vec![frustum; count]);
        it.lists
            .entities
            .insert(camera, vec![Default::default(); count]);
    }
}
