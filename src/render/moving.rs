//! Casters that move, drawn over the maps of those that rest.
//!
//! A map's own view draws what rests, seldom, and then apart from the map that is looked up; a second
//! view draws what moves, over a copy of that.

use bevy::{
    ecs::{
        entity::{Entity, EntityHashMap},
        query::Without,
        resource::Resource,
        system::{Commands, Query, Res, ResMut},
    },
    pbr::Shadow,
    platform::collections::HashSet,
    render::{render_phase::ViewBinnedRenderPhases, renderer::RenderDevice, view::ExtractedView},
};

use super::{
    hold::DrawnMaps,
    layout::AdoptedMap,
    second_view::{MapView, Over, SecondView, SecondViews, listed},
    target::ShadowTarget,
};
use crate::systems::STILL;

/// Views of what moves, by the maps' own.
#[derive(Resource, Debug, Default)]
pub(super) struct MovingViews(EntityHashMap<MovingMap>);

#[derive(Debug)]
struct MovingMap {
    view: Entity,
    casters: usize,
    /// For how many frames there have been none.
    idle: u32,
    /// The map that is looked up shows some.
    shows_any: bool,
    is_drawn: bool,
}

impl MovingViews {
    pub fn are_none(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether a map's own view draws apart from it.
    fn are_over(&self, view: Entity) -> bool {
        self.0.contains_key(&view)
    }

    /// The view that puts a map together in this frame, if any does.
    pub fn drawn_view(&self, of: Entity) -> Option<Entity> {
        let map = self.0.get(&of)?;
        map.is_drawn.then_some(map.view)
    }

    /// Whether anything that moves casts shadows into a map.
    pub fn hold_casters(&self, view: Entity) -> bool {
        self.0.get(&view).is_some_and(|map| map.casters > 0)
    }
}

/// Makes a second view of each map in which something moves.
pub(super) fn add_moving_views(
    maps: Query<MapView, Without<SecondView>>,
    mut second: SecondViews,
    mut views: ResMut<MovingViews>,
) {
    let mut known = core::mem::take(&mut views.0);
    for it in &maps {
        // Nothing is drawn over the maps of this light.
        let Some(casters) = second.casters(&it, Over::Moving) else {
            continue;
        };
        let before = known.remove(&it.entity);
        if casters.is_empty() && before.is_none() {
            continue;
        }
        let (count, list) = (casters.len(), listed(casters));
        let mut map = before.unwrap_or_else(|| MovingMap {
            view: second.commands.spawn_empty().id(),
            casters: 0,
            idle: 0,
            shows_any: false,
            is_drawn: false,
        });
        map.casters = count;
        map.idle = if count == 0 { map.idle + 1 } else { 0 };
        if map.idle > STILL {
            second.commands.entity(map.view).despawn();
            continue;
        }
        second.draw(map.view, &it, Over::Moving, list);
        views.0.insert(it.entity, map);
    }
    for map in known.values() {
        second.commands.entity(map.view).despawn();
    }
}

/// Makes room for what rests, apart from the maps that are looked up.
pub(super) fn make_room_apart(
    maps: Query<(Entity, &AdoptedMap)>,
    views: Res<MovingViews>,
    device: Res<RenderDevice>,
    mut target: ResMut<ShadowTarget>,
) {
    let over = maps.iter().filter(|(view, _)| views.are_over(*view));
    let layers: HashSet<u32> = over.map(|(_, map)| map.layer).collect();
    target.keep_apart(&device, layers);
}

/// Decides which maps are put together anew: where what rests has been drawn, or something moves or did.
pub(super) fn choose_moving_views(
    mut commands: Commands,
    drawn: Res<DrawnMaps>,
    phases: Res<ViewBinnedRenderPhases<Shadow>>,
    extracted: Query<&ExtractedView>,
    mut views: ResMut<MovingViews>,
) {
    for (of, map) in &mut views.0 {
        let phase = extracted
            .get(map.view)
            .ok()
            .and_then(|it| phases.get(&it.retained_view_entity));
        let shows_any = phase.is_some_and(|phase| !phase.is_empty());
        map.is_drawn = !drawn.is_held(*of) || shows_any || map.shows_any;
        if !map.is_drawn {
            commands.entity(map.view).remove::<ExtractedView>();
        }
        map.shows_any = shows_any;
    }
}
