//! Parallel-split shadow maps for Bevy: sharp, steady directional shadows over kilometers.
//!
//! Add [`PssmPlugin`] to the app and [`ParallelSplitShadows`] to the sun; every
//! `StandardMaterial`, forward or deferred, then receives the plugin's shadows:
//!
//! ```no_run
//! use bevy::prelude::*;
//! use bevy_pssm::prelude::*;
//!
//! fn main() {
//!     App::new()
//!         .add_plugins((DefaultPlugins, PssmPlugin))
//!         .add_systems(Startup, |mut commands: Commands| {
//!             let sun = Transform::from_xyz(-3.0, 3.0, 2.0).looking_at(Vec3::ZERO, Vec3::Y);
//!             commands.spawn((DirectionalLight::default(), sun, ParallelSplitShadows::default()));
//!         })
//!         .run();
//! }
//! ```
//!
//! # What is where
//! - [`ParallelSplitShadows`] is the whole configuration; [`ShadowPreset`] takes it from a RON
//!   file (`*.shadows.ron`) and follows its changes, where Bevy has the feature `file_watcher`.
//! - [`PssmSystems`] and [`PssmRenderSystems`] are the system sets of the main and the render
//!   world: order your own systems against them.
//! - [`ShadowPlans`] and [`CasterCascades`] on the light hold each frame's results: cascades
//!   per camera, why each is drawn in this frame, if it is, and each caster's cascades. Bevy's own `Cascades`, `CascadesFrusta`
//!   and `CascadesVisibleEntities` are kept true from `PssmSystems::CullCasters` on, but for casters that move, which
//!   [`CasterCascades::moving`] has; `CascadeShadowConfig` has the splits as
//!   configured, which fitted maps spread over what is seen.
//! - [`ManagedLight`] on the light holds what Bevy's settings were: a game that saves lights saves it, too.
//! - [`CameraCut`] says that a view has jumped, [`ShadowGridOrigin`] that the world has moved, and
//!   [`BoundsMargin`] how far a vertex shader moves a mesh. [`ShadowUpdates`] overrules when a caster's
//!   shadow is drawn anew.
//! - [`geometry`] and [`plan`] are pure functions, for tools as for the game.
//! - [`ShadowOverlay`] shows cascades, shadows, biases, texels per pixel, the texels themselves or
//!   the age of maps in the picture.
//! - The feature `experimental_pcss` gives lights Bevy's `soft_shadow_size`, which asks for soft shadows
//!   where the filter is left to the camera.
//! - [`ShaderFeatures`] says what of the shader is compiled in: what settings have asked for so far.
//! - [`MAPS_DRAWN`], [`MAPS_ADDED_TO`], [`MAPS_HELD`] and [`MAPS_DRAWN_UNPLANNED`] count maps as Bevy diagnostics; `RenderDiagnosticsPlugin` reports
//!   each map that is drawn as `pssm_shadow_map_0` and so on, and what moves in it as `pssm_moving_casters_0`.
//!
//! # Limits
//! - WebGL2 has no array textures, and OpenGL's shaders cannot load depths texel by texel: there the
//!   plugin steps back and Bevy's shadows stay.
//! - Bevy's light uniform has ten slots; each managed light uses one more of them. With so many
//!   lights, or maps for so many cameras, that slots or texture layers run out, the plugin says
//!   so once and Bevy's pass draws the cascades at `DirectionalLightShadowMap`'s size.
//! - GPUs without `DEPTH_CLIP_CONTROL` get tight maps where warped ones are asked for.
//! - Other crates' passes find neither `ShadowView`s nor entries in cameras' `ViewLightEntities` for maps while a
//!   light is managed. What draws into those adds its system to [`DrawShadowMap`], which runs once a map has
//!   been drawn: the current view has [`AdoptedMap`], whose layer [`ShadowTarget`] has as
//!   an attachment, and whose [`size`](AdoptedMap::size) its viewport keeps to, for a layer may be larger. The
//!   light wants [`ShadowUpdates::Always`]. One warning names each system that still looks for them.
//! - What only meshlets draw casts no shadow in the light of suns and spot lights while a light is
//!   managed: Bevy's meshlet pass looks for `ShadowView`s, too. Either all lights are left to Bevy, or a
//!   system of the game draws something in its place, as above. As a receiver it wants
//!   [`ShadowFocus::Off`].
//! - Shaders that read the light uniform by themselves: while a light is managed, each map fills a corner
//!   of its layer, and layers are as large as the largest map. Of managed lights,
//!   `cascades_overlap_proportion` is no share, and `far_bound` has the splits as configured, where fitted
//!   slices may end elsewhere. Bevy's shadow functions (`fetch_directional_shadow` and so on) know that.
//! - Opaque materials whose own fragment shader discards want `AlphaMode::Mask`: next to discarded
//!   pixels derivatives are undefined on some GPUs, and with it the lookup checks them.
//! - Vertex and compute shaders that call Bevy's shadow functions want [`ShaderFeatures::any_stage`].
//! - Occlusion culling is not applied to managed lights: it would lose casters for a frame.

#[doc(hidden)]
pub mod config;
#[doc(hidden)]
pub mod debug;
pub mod geometry;
pub mod plan;
#[doc(hidden)]
pub mod render;
#[doc(hidden)]
pub mod shaders;
#[doc(hidden)]
pub mod support;
#[doc(hidden)]
pub mod systems;

#[doc(inline)]
pub use config::{
    CascadeFit, CascadeTransition, CasterCulling, CasterFaces, Comparison, ConfigError,
    DepthDistribution, FilterRadius, MapFit, MapSize, MapUpdates, MapWarp, ParallelSplitShadows,
    ShadowBias, ShadowFilter, ShadowFocus, ShadowPreset, ShadowPresetError, SplitScheme, TexelGrid,
    UpdateBudget, WarpAxis,
};
#[doc(inline)]
pub use debug::ShadowOverlay;
#[doc(inline)]
pub use render::{AdoptedMap, DrawShadowMap, PssmRenderSystems, ShadowTarget};
#[doc(inline)]
pub use shaders::ShaderFeatures;
#[doc(inline)]
pub use systems::{
    BoundsMargin, CameraCut, CascadeSet, CasterCascades, MAPS_ADDED_TO, MAPS_DRAWN,
    MAPS_DRAWN_UNPLANNED, MAPS_HELD, ManagedLight, MapCounts, PssmSystems, ShadowGridOrigin,
    ShadowMemoryLimit, ShadowPlans, ShadowUpdates, SharesShadowsWith,
};

use bevy::{
    app::{App, Plugin},
    asset::AssetApp,
};

/// What a game needs: the plugin and its components.
pub mod prelude {
    #[doc(hidden)]
    pub use crate::{
        BoundsMargin, CameraCut, CascadeFit, CascadeTransition, CasterCulling, CasterFaces,
        Comparison, DepthDistribution, FilterRadius, MapFit, MapSize, MapUpdates, MapWarp,
        ParallelSplitShadows, PssmPlugin, ShaderFeatures, ShadowBias, ShadowFilter, ShadowFocus,
        ShadowGridOrigin, ShadowMemoryLimit, ShadowOverlay, ShadowPreset, ShadowUpdates,
        SharesShadowsWith, SplitScheme, TexelGrid, UpdateBudget, WarpAxis,
    };
}

/// Parallel-split shadow maps for every `DirectionalLight` with [`ParallelSplitShadows`].
///
/// Add it after `DefaultPlugins`. Without a renderer it still plans and culls.
#[derive(Debug, Default, Clone, Copy)]
pub struct PssmPlugin;

impl Plugin for PssmPlugin {
    fn build(&self, app: &mut App) {
        let support = support::ShadowSupport::default();
        let loader = config::ShadowPresetLoader::new(support.max_map_size().clone());
        app.insert_resource(support)
            .init_resource::<ShadowOverlay>()
            .init_resource::<ShaderFeatures>()
            .register_type::<ParallelSplitShadows>()
            .register_type::<ShadowPreset>()
            .register_type::<ShadowOverlay>()
            .register_type::<ShaderFeatures>()
            .register_type::<ShadowGridOrigin>()
            .register_type::<ShadowMemoryLimit>()
            .register_type::<BoundsMargin>()
            .register_type::<ShadowUpdates>()
            .register_type::<SharesShadowsWith>()
            .init_asset::<ParallelSplitShadows>()
            .register_asset_reflect::<ParallelSplitShadows>()
            .register_asset_loader(loader);
        systems::build(app);
        render::build(app);
    }

    fn finish(&self, app: &mut App) {
        render::finish(app);
    }
}
