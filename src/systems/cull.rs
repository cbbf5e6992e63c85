//! Own culling of casters: each cascade gets what meets its slice's hull swept to the light.

use bevy::{
    camera::{
        primitives::{Aabb, CascadesFrusta, Frustum},
        visibility::{
            CascadesVisibleEntities, InheritedVisibility, NoCpuCulling, NoFrustumCulling,
            RenderLayers, SetViewVisibility, ViewVisibility, VisibilityRange, VisibleEntityRanges,
            VisibleMeshEntities,
        },
    },
    ecs::{
        component::Component,
        entity::{Entity, EntityHashMap},
        query::{Has, With, Without},
        system::{Local, Query, Res},
    },
    light::{Cascades, DirectionalLight, NotShadowCaster, SpotLight},
    math::{Affine3A, DMat3, DVec3},
    mesh::Mesh3d,
    shape::ViewFrustum,
    transform::components::GlobalTransform,
    utils::Parallel,
};

use super::{ManagedLight, ShadowPlans, plan::published_cascade};
use crate::{config::CasterCulling, plan::CascadePlan};

/// The first and last cascade that a caster is drawn into. One in between may do without it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CascadeRange {
    /// Index of the first.
    pub first: u8,
    /// Index of the last.
    pub last: u8,
}

/// Where a managed light draws its casters, for each active 3D camera.
#[derive(Component, Debug, Default, Clone)]
pub struct CasterCascades {
    /// By camera: casters in the order of their entities. Casters that are drawn into no
    /// cascade are absent, and those with `NoCpuCulling`, which only the GPU culls.
    pub views: EntityHashMap<Vec<(Entity, CascadeRange)>>,
}

impl CasterCascades {
    /// The cascades that `caster` is drawn into for camera `view`; `None` if it is in none.
    pub fn get(&self, view: Entity, caster: Entity) -> Option<CascadeRange> {
        let casters = self.views.get(&view)?;
        let index = casters
            .binary_search_by_key(&caster, |(entity, _)| *entity)
            .ok()?;
        Some(casters[index].1)
    }
}

type Caster<'a> = (
    Entity,
    &'a InheritedVisibility,
    &'a mut ViewVisibility,
    Option<&'a RenderLayers>,
    Option<&'a Aabb>,
    Option<&'a GlobalTransform>,
    Has<VisibilityRange>,
    Has<NoFrustumCulling>,
);

type IsCaster = (
    Without<NotShadowCaster>,
    Without<DirectionalLight>,
    Without<NoCpuCulling>,
    With<Mesh3d>,
);

/// Finds the casters of each cascade, and publishes cascades, frusta and lists in Bevy's
/// components. Runs in [`PssmSystems::CullCasters`](super::PssmSystems::CullCasters).
pub fn cull_casters(
    mut lights: Query<
        (
            &DirectionalLight,
            &ManagedLight,
            &ShadowPlans,
            &ViewVisibility,
            Option<&RenderLayers>,
            &mut CasterCascades,
            &mut Cascades,
            &mut CascadesFrusta,
            &mut CascadesVisibleEntities,
        ),
        Without<SpotLight>,
    >,
    mut casters: Query<Caster, IsCaster>,
    ranges: Option<Res<VisibleEntityRanges>>,
    mut found: Local<Parallel<Vec<(Entity, u8)>>>,
) {
    for (light, managed, plans, visible, layers, mut record, mut cascades, mut frusta, mut lists) in
        &mut lights
    {
        record.views.clear();
        let Some(config) = managed.config() else {
            continue;
        };
        let count = config.cascades as usize;
        let casts = light.shadow_maps_enabled && visible.get();
        lists
            .entities
            .retain(|view, _| casts && plans.views.contains_key(view));

        for (view, plan) in &plans.views {
            let published: Vec<_> = (0..count)
                .map(|index| {
                    plan.get(index)
                        .map_or_else(super::parked_cascade, published_cascade)
                })
                .collect();
            let view_frusta = published
                .iter()
                .map(|cascade| Frustum(ViewFrustum::from_clip_from_world(&cascade.clip_from_world)))
                .collect();
            cascades.cascades.insert(*view, published);
            frusta.frusta.insert(*view, view_frusta);
            if !casts {
                continue;
            }

            casters.par_iter_mut().for_each_init(
                || found.borrow_local_mut(),
                |found,
                 (
                    entity,
                    inherited,
                    mut view_visibility,
                    caster_layers,
                    aabb,
                    transform,
                    has_range,
                    no_culling,
                )| {
                    let layers_meet = layers
                        .unwrap_or_default()
                        .intersects(caster_layers.unwrap_or_default());
                    let out_of_range = has_range
                        && ranges.as_ref().is_some_and(|ranges| {
                            !ranges.entity_is_in_range_of_view(entity, *view)
                        });
                    if !inherited.get() || !layers_meet || out_of_range {
                        return;
                    }
                    let bounds = match (aabb, transform) {
                        (Some(aabb), Some(transform))
                            if !no_culling && config.culling == CasterCulling::Hull =>
                        {
                            Some(world_bounds(aabb, &transform.affine()))
                        }
                        _ => None,
                    };
                    let mask = cascade_mask(plan, bounds.as_ref());
                    if mask != 0 {
                        view_visibility.set_visible();
                        found.push((entity, mask));
                    }
                },
            );

            let mut found_casters: Vec<(Entity, u8)> = Vec::new();
            found.drain_into(&mut found_casters);
            found_casters.sort_unstable_by_key(|(entity, _)| *entity);

            let view_lists = lists.entities.entry(*view).or_default();
            view_lists.resize_with(count, VisibleMeshEntities::default);
            for (index, list) in view_lists.iter_mut().enumerate() {
                list.entities.clear();
                list.entities.extend(
                    found_casters
                        .iter()
                        .filter(|(_, mask)| mask & (1 << index) != 0)
                        .map(|(entity, _)| *entity),
                );
                list.shrink();
            }
            let to_range = |(entity, mask): &(Entity, u8)| {
                let range = CascadeRange {
                    first: mask.trailing_zeros() as u8,
                    last: (7 - mask.leading_zeros()) as u8,
                };
                (*entity, range)
            };
            record
                .views
                .insert(*view, found_casters.iter().map(to_range).collect());
        }
    }
}

/// Bit `i` is set if the caster matters to cascade `i`. Without bounds it matters to all that
/// have a map.
fn cascade_mask(plan: &[CascadePlan], bounds: Option<&(DVec3, DMat3)>) -> u8 {
    plan.iter()
        .enumerate()
        .filter_map(|(index, cascade)| Some((index, cascade.map.as_ref()?)))
        .filter(|(_, map)| {
            bounds.is_none_or(|(center, axes)| map.hull.intersects_box(*center, axes))
        })
        .fold(0, |mask, (index, _)| mask | (1 << index))
}

/// The center and half-axes of a local box, in world space.
pub(super) fn world_bounds(aabb: &Aabb, world_from_local: &Affine3A) -> (DVec3, DMat3) {
    let matrix = &world_from_local.matrix3;
    let axes = DMat3::from_cols(
        matrix.x_axis.as_dvec3(),
        matrix.y_axis.as_dvec3(),
        matrix.z_axis.as_dvec3(),
    );
    let half = aabb.half_extents.as_dvec3();
    (
        axes * aabb.center.as_dvec3() + world_from_local.translation.as_dvec3(),
        DMat3::from_cols(
            axes.x_axis * half.x,
            axes.y_axis * half.y,
            axes.z_axis * half.z,
        ),
    )
}
