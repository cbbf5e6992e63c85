//! Own culling of casters: each cascade gets what meets its slice's hull swept to the light.

use bevy::{
    camera::{
        primitives::Frustum,
        visibility::{
            InheritedVisibility, RenderLayers, SetViewVisibility, ViewVisibility,
            VisibleEntityRanges, VisibleMeshEntities,
        },
    },
    ecs::{
        change_detection::DetectChangesMut,
        entity::Entity,
        query::{QueryData, Without},
        system::{ParamSet, Query, Res},
    },
    light::{DirectionalLight, SpotLight},
    shape::ViewFrustum,
    transform::components::GlobalTransform,
};

use super::{
    CascadeSet, CasterCascades, ChangedCasters, ManagedLight, ShadowPlans, ShadowUpdates,
    SharedViews,
    bounds::DisplacedMeshes,
    caster_cascades::cascades_of,
    casters::{Caster, Culling, IsCaster, cull, cull_some, is_somewhere, maps_where},
    moving::MovingCasters,
    publish::{
        PublishedCascades, PublishedCascadesItem, empty_cascade, publish_alike, published_cascade,
    },
};
use crate::{
    config::{CasterCulling, MapUpdates},
    plan::Redraw,
    support::ShadowSupport,
};

#[derive(QueryData)]
#[query_data(mutable)]
pub struct CulledLight {
    light: &'static DirectionalLight,
    managed: &'static ManagedLight,
    plans: &'static mut ShadowPlans,
    visibility: &'static ViewVisibility,
    layers: Option<&'static RenderLayers>,
    updates: Option<&'static ShadowUpdates>,
    casters: &'static mut CasterCascades,
    published: PublishedCascades,
}

/// Finds the casters of each cascade, and publishes cascades, frusta and lists in Bevy's
/// components. Runs in [`PssmSystems::CullCasters`](super::PssmSystems::CullCasters).
pub fn cull_casters(
    mut lights: Query<CulledLight, Without<SpotLight>>,
    mut casters: ParamSet<(
        Query<Caster, IsCaster>,
        Query<
            (
                &InheritedVisibility,
                &mut ViewVisibility,
                Option<&GlobalTransform>,
            ),
            IsCaster,
        >,
    )>,
    ranges: Option<Res<VisibleEntityRanges>>,
    displaced: Res<DisplacedMeshes>,
    support: Res<ShadowSupport>,
    (changed, shared): (Res<ChangedCasters>, Res<SharedViews>),
) {
    let displaced = displaced.get();
    let none_moving = MovingCasters::default();
    // What has been somewhere still is.
    let are_same = changed.get().are_none();
    for mut it in &mut lights {
        let Some(config) = it.managed.config() else {
            *it.casters = CasterCascades::default();
            continue;
        };
        let count = config.cascades as usize;
        let casts = it.light.shadow_maps_enabled && it.visibility.get();
        let is_planned = |view: &Entity| casts && it.plans.views.contains_key(view);
        it.casters.views.retain(|view, _| is_planned(view));
        it.casters.added.retain(|view, _| is_planned(view));
        it.casters.moving.retain(|view, _| is_planned(view));
        let views = &it.plans.views;
        let host_of = |view| shared.host_of(view).unwrap_or(view);
        it.published.show(|view| views.contains_key(&host_of(view)));
        let PublishedCascadesItem {
            cascades,
            frusta,
            lists,
            ..
        } = &mut it.published;
        if !casts {
            // No map holds what is no more listed.
            it.plans.bypass_change_detection().forget_all();
            lists.entities.clear();
        }
        // Where all is drawn in each frame, and by Bevy, nothing is drawn over it.
        let is_split = support.draws_maps()
            && config.comparison.updates == MapUpdates::WhenNeeded
            && it.updates != Some(&ShadowUpdates::Always);
        let moving = if is_split {
            changed.moving()
        } else {
            &none_moving
        };

        for (view, plan) in &it.plans.views {
            let of_view = cascades.cascades.entry(*view).or_default();
            of_view.clear();
            of_view.extend((0..count).map(|index| {
                plan.get(index)
                    .map_or_else(empty_cascade, published_cascade)
            }));
            let frusta = frusta.frusta.entry(*view).or_default();
            frusta.clear();
            frusta.extend(of_view.iter().map(|cascade| {
                Frustum(ViewFrustum::from_clip_from_world(&cascade.clip_from_world))
            }));
            if !casts {
                continue;
            }

            // Lists of maps that are held stay as they are, and what is in them stays visible.
            let is_known = it.casters.views.contains_key(view);
            let CasterCascades {
                views: known,
                added,
                moving: of_views,
            } = &mut *it.casters;
            let known = known.entry(*view).or_default();
            let added = added.entry(*view).or_default();
            added.clear();
            let mapped = maps_where(plan, |_| true);
            // Lists of what moves are not there when Bevy draws.
            let [held, added_to] = if is_known && is_split {
                [None, Some(Redraw::Added)].map(|why| maps_where(plan, |map| map.redraw == why))
            } else {
                [CascadeSet::default(); 2]
            };
            let keeping = held.or(added_to);
            let mut visibilities = casters.p1();
            let mut with_lost = CascadeSet::default();
            if keeping.is_empty() {
                known.clear();
            }
            known.retain_mut(|(caster, cascades)| {
                *cascades = cascades.and(keeping);
                match visibilities.get_mut(*caster) {
                    _ if cascades.is_empty() => false,
                    Ok((inherited, mut visibility, transform))
                        if inherited.get()
                            && !moving.contains(*caster)
                            && (are_same || transform.is_none_or(is_somewhere)) =>
                    {
                        visibility.set_visible();
                        true
                    }
                    _ => {
                        with_lost = with_lost.or(*cascades);
                        false
                    }
                }
            });
            let culling = Culling {
                view: *view,
                plan,
                light_layers: it.layers.unwrap_or_default(),
                ranges: ranges.as_deref(),
                displaced: &displaced,
                is_on: config.comparison.culling == CasterCulling::Hull,
            };
            let culled = mapped.without(held);
            if !culled.is_empty() {
                let found = cull(&casters.p0(), &culling, culled);
                let mut visibilities = casters.p1();
                let found = found.into_iter().filter(|(it, _)| !moving.contains(*it));
                let before = known.len();
                for (caster, cascades) in found {
                    if let Ok((_, mut visibility, _)) = visibilities.get_mut(caster) {
                        visibility.set_visible();
                    }
                    let more = cascades.and(added_to);
                    let more = more.without(cascades_of(&known[..before], caster));
                    if !more.is_empty() {
                        added.push((caster, more));
                    }
                    known.push((caster, cascades));
                }
                added.sort_unstable_by_key(|(entity, _)| *entity);
                known.sort_unstable_by_key(|(entity, _)| *entity);
                known.dedup_by(|(entity, more), (kept, cascades)| {
                    let is_same = entity == kept;
                    if is_same {
                        *cascades = cascades.or(*more);
                    }
                    is_same
                });
            }
            if is_split {
                let over = of_views.entry(*view).or_default();
                over.clear();
                over.extend(cull_some(&casters.p0(), moving.iter(), &culling, mapped));
                let mut visibilities = casters.p1();
                for (caster, _) in over.iter() {
                    if let Ok((_, mut visibility, _)) = visibilities.get_mut(*caster) {
                        visibility.set_visible();
                    }
                }
                over.sort_unstable_by_key(|(entity, _)| *entity);
            } else {
                of_views.remove(view);
            }

            let view_lists = lists.entities.entry(*view).or_default();
            let kept = if view_lists.len() == count {
                held.without(with_lost)
            } else {
                CascadeSet::default()
            };
            view_lists.resize_with(count, VisibleMeshEntities::default);
            for index in (0..count).filter(|index| !kept.contains(*index)) {
                let list = &mut view_lists[index];
                let inside = known
                    .iter()
                    .filter(|(_, cascades)| cascades.contains(index));
                list.entities.clear();
                list.entities.extend(inside.map(|(entity, _)| *entity));
                list.shrink();
            }
        }
        // What is published for a camera that looks up another one's maps: those, and nothing to draw.
        for (guest, host) in shared.pairs() {
            if !publish_alike(&mut cascades.cascades, guest, host)
                || !publish_alike(&mut frusta.frusta, guest, host)
                || !casts
            {
                continue;
            }
            let lists = lists.entities.entry(guest).or_default();
            lists.clear();
            lists.resize_with(count, VisibleMeshEntities::default);
        }
    }
}
