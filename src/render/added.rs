//! Casters that are added to what maps hold: a second view draws them, and nothing else, over the map.

use bevy::{
    ecs::{
        entity::{Entity, EntityHashMap},
        query::Without,
        resource::Resource,
        system::{Commands, Query, Res, ResMut},
    },
    render::{sync_world::MainEntity, view::ExtractedView},
};

use super::{
    hold::DrawnMaps,
    second_view::{MapView, Over, SecondView, SecondViews, listed},
};

/// Views of what is added in a frame, by the maps' own.
#[derive(Resource, Debug, Default)]
pub(super) struct AddedViews(EntityHashMap<AddedCasters>);

#[derive(Debug)]
struct AddedCasters {
    view: Entity,
    /// In order.
    casters: Vec<MainEntity>,
}

impl AddedViews {
    /// What is added to what a map holds, in order.
    pub fn casters(&self, view: Entity) -> &[MainEntity] {
        self.0.get(&view).map_or(&[], |it| &it.casters)
    }

    pub fn are_none(&self) -> bool {
        self.0.is_empty()
    }

    /// The view that draws them.
    pub fn view(&self, of: Entity) -> Option<Entity> {
        self.0.get(&of).map(|it| it.view)
    }
}

/// Makes a second view of each map that casters are added to, for the one frame.
pub(super) fn add_added_views(
    maps: Query<MapView, Without<SecondView>>,
    mut second: SecondViews,
    mut views: ResMut<AddedViews>,
) {
    for (_, added) in views.0.drain() {
        second.commands.entity(added.view).despawn();
    }
    for it in &maps {
        let casters = second.casters(&it, Over::Added).unwrap_or_default();
        if casters.is_empty() {
            continue;
        }
        let list = listed(casters);
        let casters = casters.iter().map(|(_, main)| *main).collect();
        let view = second.commands.spawn_empty().id();
        second.draw(view, &it, Over::Added, list);
        views.0.insert(it.entity, AddedCasters { view, casters });
    }
}

/// Leaves out those whose maps are drawn anew all the same.
pub(super) fn choose_added_views(
    mut commands: Commands,
    drawn: Res<DrawnMaps>,
    views: Res<AddedViews>,
) {
    for (of, added) in &views.0 {
        if !drawn.is_added_to(*of) {
            commands.entity(added.view).remove::<ExtractedView>();
        }
    }
}
