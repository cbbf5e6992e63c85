//! Thin ECS systems: what is configured, what is planned and which casters are drawn.

mod bounds;
mod caster_cascades;
mod caster_state;
mod casters;
mod changes;
mod cull;
mod cut;
mod diagnostics;
mod edits;
mod gather;
mod manage;
mod memory;
mod mesh_boxes;
mod moving;
mod plan;
mod publish;
mod rows;
mod sample;
mod share;

pub use bounds::{BoundsMargin, DisplacedMeshes};
pub use caster_cascades::{CascadeSet, CasterCascades};
pub use caster_state::ShadowUpdates;
pub use changes::{ChangedCasters, find_changes};
pub use cull::cull_casters;
pub use cut::CameraCut;
pub use diagnostics::{
    MAPS_ADDED_TO, MAPS_DRAWN, MAPS_DRAWN_UNPLANNED, MAPS_HELD, MapCounts, UnplannedMaps,
};
pub use edits::EditedCasters;
pub use gather::view_volume;
pub use manage::{AppliedPreset, ManagedLight};
pub use memory::ShadowMemoryLimit;
pub use mesh_boxes::MeshBoxes;
pub(crate) use moving::STILL;
pub use plan::{ShadowGridOrigin, ShadowPlans, plan_shadows};
pub(crate) use publish::empty_cascade;
pub use share::{SharedViews, SharesShadowsWith};

use bevy::{
    app::{App, PostUpdate, PreUpdate},
    asset::{AssetEvent, AssetEventSystems, AssetTrackingSystems, Assets},
    camera::visibility::VisibilitySystems,
    ecs::{
        message::Messages,
        schedule::{IntoScheduleConfigs, SystemSet, common_conditions::resource_exists},
    },
    image::Image,
    light::SimulationLightSystems,
    mesh::{Mesh, Mesh3d},
    pbr::StandardMaterial,
    transform::TransformSystems,
};

use caster_state::CasterRecord;

use crate::config::{ParallelSplitShadows, ShadowPreset};

/// The plugin's system sets in the main world.
#[derive(SystemSet, Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PssmSystems {
    /// In `PreUpdate`. After this set, lights with a [`ShadowPreset`](crate::ShadowPreset)
    /// carry the configuration of the latest good version of its file.
    ApplyPresets,
    /// In `PostUpdate`. After this set, every managed light has its last good configuration in
    /// force, and every light let go has Bevy's settings back.
    ManageLights,
    /// In `PostUpdate`. After this set, [`ShadowPlans`] are up to date.
    PlanCascades,
    /// In `PostUpdate`. After this set, [`CasterCascades`] and Bevy's `Cascades`,
    /// `CascadesFrusta` and `CascadesVisibleEntities` are up to date for managed lights.
    CullCasters,
}

pub(crate) fn build(app: &mut App) {
    app.init_resource::<MeshBoxes>()
        .init_resource::<DisplacedMeshes>()
        .init_resource::<EditedCasters>()
        .init_resource::<edits::NewMasks>()
        .init_resource::<ChangedCasters>()
        .init_resource::<ShadowGridOrigin>()
        .init_resource::<ShadowMemoryLimit>()
        .init_resource::<SharedViews>();
    diagnostics::register(app);
    // Without it, casters are known a frame later.
    let world = app.world_mut();
    let _ = world.try_register_required_components::<Mesh3d, CasterRecord>();
    app.register_type::<ManagedLight>()
        .register_type::<manage::SwitchedOff>();
    app.register_required_components::<ParallelSplitShadows, ManagedLight>();
    app.register_required_components::<ShadowPreset, AppliedPreset>();
    app.configure_sets(
        PostUpdate,
        (
            PssmSystems::ManageLights
                .before(SimulationLightSystems::UpdateDirectionalLightCascades),
            // Before Bevy makes frusta from cascades, so that it finds none to cull for.
            PssmSystems::PlanCascades
                .after(PssmSystems::ManageLights)
                .after(TransformSystems::Propagate)
                .after(SimulationLightSystems::UpdateDirectionalLightCascades)
                // For what cameras see.
                .after(VisibilitySystems::CalculateBounds)
                .after(VisibilitySystems::CheckVisibility)
                .before(SimulationLightSystems::UpdateLightFrusta),
            PssmSystems::CullCasters
                .after(PssmSystems::PlanCascades)
                .after(VisibilitySystems::CalculateBounds)
                .after(VisibilitySystems::CheckVisibility)
                .after(SimulationLightSystems::CheckLightVisibility)
                .before(VisibilitySystems::MarkNewlyHiddenEntitiesInvisible),
        ),
    )
    .configure_sets(
        PreUpdate,
        PssmSystems::ApplyPresets.after(AssetTrackingSystems),
    )
    .add_systems(
        PreUpdate,
        manage::apply_presets.in_set(PssmSystems::ApplyPresets),
    )
    .add_systems(
        PostUpdate,
        (
            manage::manage_lights.in_set(PssmSystems::ManageLights),
            mesh_boxes::forget_changed
                .after(AssetEventSystems)
                .before(PssmSystems::PlanCascades)
                .run_if(resource_exists::<Messages<AssetEvent<Mesh>>>),
            edits::note_changed_masks
                .after(AssetEventSystems)
                .before(PssmSystems::PlanCascades)
                .run_if(resource_exists::<Messages<AssetEvent<Image>>>)
                .run_if(resource_exists::<Assets<StandardMaterial>>),
            bounds::forget_removed.before(PssmSystems::PlanCascades),
            (find_changes, plan_shadows, diagnostics::count_maps)
                .chain()
                .in_set(PssmSystems::PlanCascades),
            cull_casters.in_set(PssmSystems::CullCasters),
        ),
    )
    .add_observer(changes::note_removed)
    .add_observer(changes::note_disabled)
    .add_observer(cut::forget_cut_view)
    .add_observer(manage::forget_preset)
    .add_observer(manage::forget_light)
    .add_observer(manage::forget_settings)
    .add_observer(manage::restore_built_in);
}
