//! Which lights are managed, with which configuration, and what they were before.

use core::sync::atomic::Ordering;

use bevy::{
    asset::{AssetId, Assets},
    camera::primitives::CascadesFrusta,
    ecs::{
        change_detection::{DetectChanges, Ref, Tick},
        component::Component,
        entity::Entity,
        lifecycle::Remove,
        observer::On,
        query::{Has, QueryData},
        reflect::ReflectComponent,
        system::{Commands, EntityCommands, Query, Res},
        world::EntityWorldMut,
    },
    light::{CascadeShadowConfig, Cascades, DirectionalLight},
    log::warn,
    reflect::{Reflect, std_traits::ReflectDefault},
};

use super::{
    CasterCascades, ShadowPlans,
    publish::{HiddenCascades, published_config},
};
use crate::{
    config::{CascadeFit, ParallelSplitShadows, ShadowPreset, TexelGrid},
    plan::over_own_range,
    support::ShadowSupport,
};

/// The plugin's record of a light: the configuration in force and Bevy's settings to restore.
/// Added with [`ParallelSplitShadows`], and removed after it.
///
/// Worlds are to be saved with it: Bevy's settings are in here, for the light's own
/// `shadow_maps_enabled` and `CascadeShadowConfig` are the plugin's while the light is managed.
#[derive(Component, Reflect, Debug, Default, Clone)]
#[reflect(Component, Default, Debug, Clone)]
#[require(ShadowPlans, CasterCascades, HiddenCascades)]
pub struct ManagedLight {
    #[reflect(ignore)]
    last_good: Option<ParallelSplitShadows>,
    /// The last good configuration, over the range and with the fit that are in force.
    #[reflect(ignore)]
    in_force: Option<ParallelSplitShadows>,
    /// When the configuration that was checked last was written.
    #[reflect(ignore)]
    checked: Option<Tick>,
    /// What was wrong with it.
    #[reflect(ignore)]
    error: Option<String>,
    built_in: Option<BuiltInShadows>,
}

/// Marks a light whose shadows the game switched off while it was managed: they stay off when it is
/// managed again.
#[derive(Component, Reflect, Debug, Default)]
#[reflect(Component, Default, Debug)]
pub struct SwitchedOff;

impl ManagedLight {
    /// The configuration in force: the last good one, over the light's own range where ours is left at
    /// its default, without warps where the GPU cannot draw them,
    /// and stable over whole slices where Bevy's pass draws the cascades. `None` while Bevy's own
    /// shadows are in force.
    pub fn config(&self) -> Option<&ParallelSplitShadows> {
        self.in_force.as_ref()
    }

    /// Takes a configuration if it is good, and warns of it once if not.
    fn accept(
        &mut self,
        light: Entity,
        config: &Ref<ParallelSplitShadows>,
        cascade_config: &CascadeShadowConfig,
        support: &ShadowSupport,
    ) -> Option<&ParallelSplitShadows> {
        // Not `is_changed`, which has passed if the light was not there yet or was disabled.
        if self.checked != Some(config.last_changed()) {
            self.checked = Some(config.last_changed());
            let error = config.validate(support.max_map_size().load(Ordering::Relaxed));
            // What is no number is unlike itself, but not its message.
            let error = error.err().map(|error| error.to_string());
            match &error {
                None => self.last_good = Some((**config).clone()),
                // It may be written in every frame.
                Some(_) if error == self.error => {}
                Some(error) if self.last_good.is_none() => {
                    warn!("Light {light} keeps Bevy's own shadows: {error}");
                }
                Some(error) => {
                    warn!("Keeping the last good shadows of light {light}: {error}");
                }
            }
            self.error = error;
        }
        let last_good = self.last_good.as_ref()?;
        let built_in = self.built_in.as_ref();
        let own = built_in.map_or(cascade_config, |built_in| &built_in.cascade_config);
        // Published by another light of these settings, and copied: no range of the game's.
        let is_published = is_same_config(own, &published_config(last_good));
        let over_range = if is_published {
            last_good.clone()
        } else {
            over_own_range(last_good, own)
        };
        self.in_force = Some(ParallelSplitShadows {
            fit: drawable_fit(&last_good.fit, support),
            // Bevy's lookups know no sheared maps.
            grid: if support.is_out_of_room() {
                TexelGrid::Light
            } else {
                last_good.grid
            },
            ..over_range
        });
        self.in_force.as_ref()
    }

    /// Lets the light go.
    fn release(
        &mut self,
        commands: EntityCommands,
        light: &mut DirectionalLight,
        cascade_config: &mut CascadeShadowConfig,
    ) {
        self.last_good = None;
        self.in_force = None;
        self.checked = None;
        self.error = None;
        self.restore(commands, light, cascade_config);
    }

    /// Gives Bevy its settings back.
    fn restore(
        &mut self,
        mut commands: EntityCommands,
        light: &mut DirectionalLight,
        cascade_config: &mut CascadeShadowConfig,
    ) {
        if let Some(built_in) = self.built_in.take() {
            if !light.shadow_maps_enabled {
                commands.try_insert(SwitchedOff);
            }
            light.shadow_maps_enabled &= built_in.shadow_maps_enabled;
            *cascade_config = built_in.cascade_config;
        }
    }
}

fn drawable_fit(fit: &CascadeFit, support: &ShadowSupport) -> CascadeFit {
    if support.is_out_of_room() {
        CascadeFit::Stable
    } else if support.draws_warps() {
        fit.clone()
    } else {
        fit.unwarped()
    }
}

/// Settings of Bevy's that the plugin overwrites.
#[derive(Reflect, Debug, Clone)]
#[reflect(Debug, Clone)]
struct BuiltInShadows {
    shadow_maps_enabled: bool,
    cascade_config: CascadeShadowConfig,
}

/// Which version of which preset a light was given, so that it is given each once: changes to
/// the light's own component stay until the file changes.
#[derive(Component, Debug, Default)]
pub struct AppliedPreset(Option<(AssetId<ParallelSplitShadows>, ParallelSplitShadows)>);

pub(super) fn apply_presets(
    mut commands: Commands,
    presets: Res<Assets<ParallelSplitShadows>>,
    mut lights: Query<(Entity, &ShadowPreset, &mut AppliedPreset)>,
) {
    for (light, preset, mut applied) in &mut lights {
        let Some(config) = presets.get(&preset.0) else {
            continue;
        };
        let id = preset.0.id();
        let is_new = applied
            .0
            .as_ref()
            .is_none_or(|known| (known.0, &known.1) != (id, config));
        if is_new {
            applied.0 = Some((id, config.clone()));
            // It may be gone until this is carried out.
            commands.entity(light).try_insert(config.clone());
        }
    }
}

pub(super) fn forget_preset(removed: On<Remove<ShadowPreset>>, mut commands: Commands) {
    if let Ok(mut light) = commands.get_entity(removed.entity) {
        light.try_remove::<(ParallelSplitShadows, AppliedPreset)>();
    }
}

/// What was noted of a light, and planned, is not true of the next one on the same entity.
pub(super) fn forget_light(
    removed: On<Remove<DirectionalLight>>,
    mut commands: Commands,
    mut managed: Query<(&mut ManagedLight, Option<&mut CascadeShadowConfig>)>,
) {
    if let Ok(mut light) = commands.get_entity(removed.entity) {
        light.try_remove::<SwitchedOff>();
        light.queue_silenced(forget_plans);
    }
    let Ok((mut managed, cascade_config)) = managed.get_mut(removed.entity) else {
        return;
    };
    let managed = core::mem::take(&mut *managed);
    if let (Some(built_in), Some(mut cascade_config)) = (managed.built_in, cascade_config) {
        *cascade_config = built_in.cascade_config;
    }
}

/// Of what is no light any more nothing is left.
pub(super) fn forget_settings(removed: On<Remove<ParallelSplitShadows>>, mut commands: Commands) {
    if let Ok(mut light) = commands.get_entity(removed.entity) {
        light.queue_silenced(forget_plans);
    }
}

/// Of what is still a light, `manage_lights` lets go.
fn forget_plans(mut entity: EntityWorldMut) {
    if entity.contains::<DirectionalLight>() {
        return;
    }
    if entity.contains::<ParallelSplitShadows>() {
        entity.insert(<(ShadowPlans, CasterCascades, HiddenCascades)>::default());
    } else {
        entity.remove::<(ManagedLight, ShadowPlans, CasterCascades, HiddenCascades)>();
    }
}

/// Restores Bevy's settings when the record is removed before the component is.
pub(super) fn restore_built_in(
    removed: On<Remove<ManagedLight>>,
    mut commands: Commands,
    mut lights: Query<(
        &mut ManagedLight,
        &mut DirectionalLight,
        &mut CascadeShadowConfig,
    )>,
) {
    if let (Ok((mut managed, mut light, mut cascade_config)), Ok(commands)) = (
        lights.get_mut(removed.entity),
        commands.get_entity(removed.entity),
    ) {
        managed.release(commands, &mut light, &mut cascade_config);
    }
}

#[derive(QueryData)]
#[query_data(mutable)]
pub(super) struct LightToManage {
    entity: Entity,
    config: Option<Ref<'static, ParallelSplitShadows>>,
    managed: &'static mut ManagedLight,
    light: &'static mut DirectionalLight,
    cascade_config: &'static mut CascadeShadowConfig,
    cascades: &'static mut Cascades,
    frusta: &'static mut CascadesFrusta,
    is_switched_off: Has<SwitchedOff>,
}

pub(super) fn manage_lights(
    mut commands: Commands,
    support: Res<ShadowSupport>,
    mut lights: Query<LightToManage>,
) {
    for mut it in &mut lights {
        let is_removed = it.config.is_none();
        let config = it.config.filter(|_| support.may_take_over());
        let Some(config) = config else {
            // A light that has been saved while it was managed has not been checked here.
            if it.managed.checked.is_some() || it.managed.built_in.is_some() {
                let commands = commands.entity(it.entity);
                it.managed
                    .release(commands, &mut it.light, &mut it.cascade_config);
                // Bevy fills them anew only while its shadows are on.
                it.cascades.cascades.clear();
                it.frusta.frusta.clear();
            }
            if is_removed {
                commands
                    .entity(it.entity)
                    .queue_silenced(|mut light: EntityWorldMut| {
                        // It may have come back until this is carried out.
                        if !light.contains::<ParallelSplitShadows>() {
                            light.remove::<(ManagedLight, ShadowPlans, CasterCascades, HiddenCascades)>();
                        }
                    });
            }
            continue;
        };
        let Some(published) = it
            .managed
            .accept(it.entity, &config, &it.cascade_config, &support)
            .map(published_config)
        else {
            // What was good where the light was saved may not be here.
            if it.managed.built_in.is_some() {
                let commands = commands.entity(it.entity);
                it.managed
                    .restore(commands, &mut it.light, &mut it.cascade_config);
            }
            continue;
        };
        if it.managed.built_in.is_none() {
            it.managed.built_in = Some(BuiltInShadows {
                shadow_maps_enabled: it.light.shadow_maps_enabled,
                cascade_config: it.cascade_config.clone(),
            });
            if it.is_switched_off {
                commands.entity(it.entity).remove::<SwitchedOff>();
            } else {
                it.light.shadow_maps_enabled = true;
            }
        }
        if !is_same_config(&published, &it.cascade_config) {
            *it.cascade_config = published;
        }
    }
}

fn is_same_config(a: &CascadeShadowConfig, b: &CascadeShadowConfig) -> bool {
    a.bounds == b.bounds
        && a.overlap_proportion == b.overlap_proportion
        && a.minimum_distance == b.minimum_distance
}
