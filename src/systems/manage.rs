//! Which lights are ours, with which configuration, and what they were before.

use bevy::{
    asset::{AssetId, Assets},
    camera::primitives::CascadesFrusta,
    ecs::{
        change_detection::{DetectChanges, Ref, Tick},
        component::Component,
        entity::Entity,
        lifecycle::Remove,
        observer::On,
        system::{Commands, Query, Res},
    },
    light::{CascadeShadowConfig, Cascades, DirectionalLight},
    log::warn,
};

use super::{CasterCascades, ShadowPlans};
use crate::{
    config::{CascadeFit, MaxMapSize, ParallelSplitShadows, ShadowPreset},
    geometry::split::split_planes,
    render::GpuSupport,
    shaders::LeftToBevy,
};

/// The plugin's record of a light: the configuration in force and Bevy's settings to restore.
/// Added with [`ParallelSplitShadows`], and removed after it.
#[derive(Component, Debug, Default, Clone)]
#[require(ShadowPlans, CasterCascades)]
pub struct ManagedLight {
    last_good: Option<ParallelSplitShadows>,
    /// That, as far as the GPU goes along.
    in_force: Option<ParallelSplitShadows>,
    /// When the configuration looked at last was written.
    seen: Option<Tick>,
    stock: Option<StockShadows>,
}

impl ManagedLight {
    /// The configuration in force: the last good one, without warps where the GPU cannot draw them,
    /// and stable over whole slices where Bevy's pass draws the cascades. `None` while Bevy's own
    /// shadows are in force.
    pub fn config(&self) -> Option<&ParallelSplitShadows> {
        self.in_force.as_ref()
    }

    /// Takes a configuration if it is good, and warns of it once if not.
    fn consider(
        &mut self,
        light: Entity,
        config: &Ref<ParallelSplitShadows>,
        max_map_size: u32,
        adapted: impl FnOnce(&ParallelSplitShadows) -> CascadeFit,
    ) -> Option<&ParallelSplitShadows> {
        // Not `is_changed`, which has passed if the light was not there yet or was disabled.
        if self.seen != Some(config.last_changed()) {
            self.seen = Some(config.last_changed());
            match config.validate(max_map_size) {
                Ok(()) => self.last_good = Some((**config).clone()),
                Err(error) => warn!("Keeping the last good shadows of light {light}: {error}"),
            }
        }
        let last_good = self.last_good.as_ref()?;
        self.in_force = Some(ParallelSplitShadows {
            fit: adapted(last_good),
            ..last_good.clone()
        });
        self.in_force.as_ref()
    }

    /// Gives Bevy its settings back.
    fn release(&mut self, light: &mut DirectionalLight, cascade_config: &mut CascadeShadowConfig) {
        self.last_good = None;
        self.in_force = None;
        self.seen = None;
        if let Some(stock) = self.stock.take() {
            light.shadow_maps_enabled &= stock.shadow_maps_enabled;
            *cascade_config = stock.cascade_config;
        }
    }
}

#[derive(Debug, Clone)]
struct StockShadows {
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
            commands.entity(light).insert(config.clone());
        }
    }
}

pub(super) fn forget_preset(removed: On<Remove<ShadowPreset>>, mut commands: Commands) {
    if let Ok(mut light) = commands.get_entity(removed.entity) {
        light.try_remove::<(ParallelSplitShadows, AppliedPreset)>();
    }
}

/// What was noted of a light is not true of the next one on the same entity.
pub(super) fn forget_light(
    removed: On<Remove<DirectionalLight>>,
    mut managed: Query<(&mut ManagedLight, Option<&mut CascadeShadowConfig>)>,
) {
    let Ok((mut managed, cascade_config)) = managed.get_mut(removed.entity) else {
        return;
    };
    let managed = core::mem::take(&mut *managed);
    if let (Some(stock), Some(mut cascade_config)) = (managed.stock, cascade_config) {
        *cascade_config = stock.cascade_config;
    }
}

/// Should the record go first, with everything that the component requires, say.
pub(super) fn restore_stock(
    removed: On<Remove<ManagedLight>>,
    mut lights: Query<(
        &mut ManagedLight,
        &mut DirectionalLight,
        &mut CascadeShadowConfig,
    )>,
) {
    if let Ok((mut managed, mut light, mut cascade_config)) = lights.get_mut(removed.entity) {
        managed.release(&mut light, &mut cascade_config);
    }
}

pub(super) fn manage_lights(
    mut commands: Commands,
    max_map_size: Res<MaxMapSize>,
    support: Res<GpuSupport>,
    left_to_bevy: Option<Res<LeftToBevy>>,
    mut lights: Query<(
        Entity,
        Option<Ref<ParallelSplitShadows>>,
        &mut ManagedLight,
        &mut DirectionalLight,
        &mut CascadeShadowConfig,
        &mut Cascades,
        &mut CascadesFrusta,
    )>,
) {
    for (entity, config, mut managed, mut light, mut cascade_config, mut cascades, mut frusta) in
        &mut lights
    {
        let removed = config.is_none();
        let wanted = config.filter(|config| config.enabled && support.shadows());
        let Some(wanted) = wanted else {
            if managed.seen.is_some() {
                managed.release(&mut light, &mut cascade_config);
                // Bevy fills them anew only while its shadows are on.
                cascades.cascades.clear();
                frusta.frusta.clear();
            }
            if removed {
                commands
                    .entity(entity)
                    .remove::<(ManagedLight, ShadowPlans, CasterCascades)>();
            }
            continue;
        };
        let Some(published) = managed
            .consider(entity, &wanted, max_map_size.get(), |config| {
                if left_to_bevy.as_ref().is_some_and(|left| left.get()) {
                    CascadeFit::Stable
                } else if support.warps() {
                    config.fit.clone()
                } else {
                    config.fit.unwarped()
                }
            })
            .map(published_config)
        else {
            continue;
        };
        if managed.stock.is_none() {
            managed.stock = Some(StockShadows {
                shadow_maps_enabled: light.shadow_maps_enabled,
                cascade_config: cascade_config.clone(),
            });
            light.shadow_maps_enabled = true;
        }
        if !same_config(&published, &cascade_config) {
            *cascade_config = published;
        }
    }
}

/// The configuration in the terms of Bevy's component, for whatever reads that.
fn published_config(config: &ParallelSplitShadows) -> CascadeShadowConfig {
    let planes = split_planes(
        &config.splits,
        config.near,
        config.far,
        config.cascades as usize,
    );
    // One proportion of the far bound must hold for all: the least of ours.
    let overlap = planes
        .windows(2)
        .map(|slice| config.blend * (slice[1] - slice[0]) / slice[1])
        .fold(f64::INFINITY, f64::min);
    CascadeShadowConfig {
        bounds: planes[1..].iter().map(|plane| *plane as f32).collect(),
        overlap_proportion: overlap as f32,
        minimum_distance: config.near as f32,
    }
}

fn same_config(a: &CascadeShadowConfig, b: &CascadeShadowConfig) -> bool {
    a.bounds == b.bounds
        && a.overlap_proportion == b.overlap_proportion
        && a.minimum_distance == b.minimum_distance
}
