//! Two settings before one camera: two cameras that stand in one place, each with a sun of its own.

use bevy::{
    camera::{RenderTarget, visibility::RenderLayers},
    core_pipeline::tonemapping::Tonemapping,
    light::{CascadeShadowConfig, CascadeShadowConfigBuilder, ShadowFilteringMethod},
    pbr::DistanceFog,
    prelude::*,
    render::render_resource::{Extent3d, TextureFormat, TextureUsages},
};
use bevy_pssm::{PssmSystems, prelude::*};
use serde::Deserialize;

use super::open::Opened;
use crate::scene::{BuiltInDescription, SceneCamera, SceneSun};

/// Which of the two settings.
#[derive(Component, Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Side {
    /// Shown alone unless two are compared.
    #[default]
    Left,
    /// Shown to the right of the wipe.
    Right,
}

impl Side {
    /// Left, right.
    pub const BOTH: [Self; 2] = [Self::Left, Self::Right];

    /// 0 or 1.
    pub fn index(self) -> usize {
        self as usize
    }

    /// On which its camera and its sun are.
    pub fn layer(self) -> usize {
        1 + self.index()
    }
}

/// The layer of a sun that no shadows hold back.
pub const LIT_LAYER: usize = 3;
/// The layer without a sun.
pub const DARK_LAYER: usize = 4;

/// Where lines are that are drawn into the scene.
pub const LINES_LAYER: usize = 5;

/// Where everything is but suns and cameras.
pub fn all_layers() -> RenderLayers {
    RenderLayers::from_layers(&[0, 1, 2, LIT_LAYER, DARK_LAYER])
}

/// Whose shadows a side shows.
#[derive(Deserialize, Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Technique {
    /// The plugin's, as its sun's component says.
    #[default]
    Plugin,
    /// Bevy's own, as it comes.
    BuiltIn,
    /// Bevy's own, as suits the scene best.
    Tuned,
}

/// What is compared.
#[derive(Resource, Debug, Clone, PartialEq)]
pub struct Compare {
    /// Where the left side ends (share of the picture's width), if both are shown.
    pub wipe: Option<f32>,
    /// Whose settings the panel shows.
    pub edited: Side,
    /// Whose shadows, left and right.
    pub techniques: [Technique; 2],
}

impl Default for Compare {
    fn default() -> Self {
        Self {
            wipe: None,
            edited: Side::Left,
            techniques: [Technique::Plugin, Technique::BuiltIn],
        }
    }
}

/// The pictures of both sides, each of the whole view.
#[derive(Resource, Debug, Clone)]
pub struct Pictures {
    /// Pixels.
    pub size: UVec2,
    /// The screen's pixels along a side of one of theirs.
    pub coarseness: u32,
    /// They stay as they are.
    pub held: bool,
    /// Left and right.
    pub images: [Handle<Image>; 2],
}

/// A side's camera.
#[derive(Component, Debug, Clone, Copy, PartialEq, Eq)]
pub struct SideCamera(pub Side);

/// A side's sun.
#[derive(Component, Debug, Clone, Copy, PartialEq, Eq)]
pub struct SideSun(pub Side);

/// The plugin's settings of a sun that shows Bevy's own shadows.
#[derive(Component, Debug, Clone)]
pub struct KeptShadows(pub ParallelSplitShadows);

impl Pictures {
    /// Creates pictures of a size.
    pub fn new(images: &mut Assets<Image>, size: UVec2) -> Self {
        let mut picture = || {
            let mut image =
                Image::new_target_texture(size.x, size.y, TextureFormat::Rgba8UnormSrgb, None);
            image.texture_descriptor.usage |= TextureUsages::COPY_SRC;
            images.add(image)
        };
        Self {
            size,
            coarseness: 1,
            held: false,
            images: [picture(), picture()],
        }
    }

    /// Makes them larger or smaller.
    pub fn resize(&mut self, images: &mut Assets<Image>, size: UVec2) {
        self.size = size;
        for handle in &self.images {
            if let Some(mut image) = images.get_mut(handle) {
                image.resize(Extent3d {
                    width: size.x,
                    height: size.y,
                    depth_or_array_layers: 1,
                });
            }
        }
    }
}

/// Keeps both sides as [`Compare`] says.
pub struct SidesPlugin;

impl Plugin for SidesPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<Compare>().add_systems(
            PostUpdate,
            (
                (adopt_suns, ApplyDeferred).chain(),
                (
                    put_on_layers,
                    share_settings,
                    mirror_suns,
                    mirror_camera,
                    apply_techniques,
                ),
            )
                .chain()
                .before(TransformSystems::Propagate)
                .before(PssmSystems::ManageLights),
        );
    }
}

/// Spawns both sides' cameras.
pub fn spawn_cameras(
    commands: &mut Commands,
    pictures: &Pictures,
    left: impl Bundle,
) -> [Entity; 2] {
    let mut left = Some(left);
    Side::BOTH.map(|side| {
        let mut camera = commands.spawn((
            Camera3d::default(),
            Camera {
                order: side.index() as isize - 2,
                is_active: side == Side::Left,
                ..default()
            },
            RenderTarget::from(pictures.images[side.index()].clone()),
            SideCamera(side),
            RenderLayers::from_layers(&[side.layer(), LINES_LAYER]),
        ));
        if let Some(left) = left.take() {
            camera.insert(left);
        }
        camera.id()
    })
}

/// The scene's sun becomes the left one, and gets a twin.
fn adopt_suns(
    mut commands: Commands,
    suns: Query<(Entity, &DirectionalLight, &Transform), (With<SceneSun>, Without<SideSun>)>,
    old: Query<Entity, (With<SideSun>, Without<SceneSun>)>,
) {
    let Some((sun, light, transform)) = suns.iter().next() else {
        return;
    };
    for twin in &old {
        commands.entity(twin).despawn();
    }
    let layers = |side: Side| RenderLayers::layer(side.layer());
    commands.entity(sun).insert((
        SideSun(Side::Left),
        layers(Side::Left),
        // The plugin would take over a range of the light's own.
        CascadeShadowConfig::default(),
    ));
    commands.spawn((
        *light,
        *transform,
        SideSun(Side::Right),
        layers(Side::Right),
    ));
}

/// A new twin has the sun's settings.
fn share_settings(
    mut commands: Commands,
    sun: Query<AnyOf<(&ParallelSplitShadows, &KeptShadows)>, With<SceneSun>>,
    twins: Query<
        Entity,
        (
            With<SideSun>,
            Without<SceneSun>,
            Without<ParallelSplitShadows>,
            Without<KeptShadows>,
        ),
    >,
) {
    let Ok((shadows, kept)) = sun.single() else {
        return;
    };
    let Some(shadows) = shadows.or(kept.map(|kept| &kept.0)) else {
        return;
    };
    for twin in &twins {
        commands.entity(twin).insert(KeptShadows(shadows.clone()));
    }
}

fn put_on_layers(
    mut commands: Commands,
    seen: Query<
        Entity,
        (
            Or<(
                With<Mesh3d>,
                With<DirectionalLight>,
                With<PointLight>,
                With<SpotLight>,
            )>,
            Without<RenderLayers>,
        ),
    >,
) {
    for entity in &seen {
        commands.entity(entity).insert(all_layers());
    }
}

/// The twin stands where the sun does and shines as brightly.
fn mirror_suns(
    sun: Query<(Ref<Transform>, &DirectionalLight), With<SceneSun>>,
    mut twins: Query<(&mut Transform, &mut DirectionalLight), (With<SideSun>, Without<SceneSun>)>,
) {
    let Ok((transform, light)) = sun.single() else {
        return;
    };
    for (mut place, mut twin) in &mut twins {
        place.set_if_neq(*transform);
        if twin.illuminance != light.illuminance || twin.color != light.color {
            twin.illuminance = light.illuminance;
            twin.color = light.color;
        }
    }
}

/// The right camera stands where the left one does and sees as it does.
fn mirror_camera(
    mut commands: Commands,
    compare: Res<Compare>,
    pictures: Option<Res<Pictures>>,
    mut left: Query<
        (
            &mut Camera,
            &Transform,
            Ref<Projection>,
            Option<Ref<DistanceFog>>,
            Ref<ShadowFilteringMethod>,
            Ref<Msaa>,
            Ref<Tonemapping>,
        ),
        With<SceneCamera>,
    >,
    mut right: Query<
        (Entity, &mut Transform, &mut Camera),
        (With<SideCamera>, Without<SceneCamera>),
    >,
) {
    let (
        Ok((mut left, place, lens, fog, filter, msaa, tonemapping)),
        Ok((camera, mut to, mut state)),
    ) = (left.single_mut(), right.single_mut())
    else {
        return;
    };
    to.set_if_neq(*place);
    let drawn = pictures.is_some_and(|pictures| !pictures.held);
    for (state, shown) in [(&mut left, true), (&mut state, compare.wipe.is_some())] {
        if state.is_active != (shown && drawn) {
            state.is_active = shown && drawn;
        }
    }
    let mut camera = commands.entity(camera);
    if lens.is_changed() {
        camera.insert(Projection::clone(&lens));
    }
    if filter.is_changed() || msaa.is_changed() || tonemapping.is_changed() {
        camera.insert((*filter, *msaa, *tonemapping));
    }
    match fog {
        Some(fog) if fog.is_changed() => {
            camera.insert(DistanceFog::clone(&fog));
        }
        Some(_) => {}
        None => {
            camera.remove::<DistanceFog>();
        }
    }
}

/// Whose shadows each sun casts.
fn apply_techniques(
    mut commands: Commands,
    compare: Res<Compare>,
    scene: Res<Opened>,
    mut suns: Query<(
        Entity,
        &SideSun,
        &mut DirectionalLight,
        Option<&ParallelSplitShadows>,
        Option<&KeptShadows>,
        Option<&CascadeShadowConfig>,
    )>,
) {
    for (entity, SideSun(side), mut light, shadows, kept, cascades) in &mut suns {
        let mut sun = commands.entity(entity);
        let technique = compare.techniques[side.index()];
        match (technique, shadows, kept) {
            (Technique::Plugin, None, Some(kept)) => {
                set_biases(&mut light, BuiltInShadows::bevys(kept.0.far).shadows);
                sun.insert((kept.0.clone(), CascadeShadowConfig::default()))
                    .remove::<KeptShadows>();
            }
            (Technique::Plugin, ..) | (_, None, None) => {}
            (_, Some(shadows), _) => {
                // The plugin gives back what it found before Bevy's own can be set.
                sun.insert(KeptShadows(shadows.clone()))
                    .remove::<(ParallelSplitShadows, ShadowPreset)>();
            }
            (technique, None, Some(kept)) => {
                let mut built_in = BuiltInShadows::bevys(kept.0.far);
                if technique == Technique::Tuned {
                    built_in.shadows = scene.built_in;
                }
                set_biases(&mut light, built_in.shadows);
                let config = built_in.cascades();
                if cascades.is_none_or(|cascades| cascades.bounds != config.bounds) {
                    light.shadow_maps_enabled = true;
                    sun.insert(config);
                }
            }
        }
    }
}

fn set_biases(light: &mut DirectionalLight, wanted: BuiltInDescription) {
    if (light.shadow_depth_bias, light.shadow_normal_bias)
        != (wanted.depth_bias, wanted.normal_bias)
    {
        light.shadow_depth_bias = wanted.depth_bias;
        light.shadow_normal_bias = wanted.normal_bias;
    }
}

/// Bevy's own shadows over a distance (meters).
struct BuiltInShadows {
    far: f32,
    shadows: BuiltInDescription,
}

impl BuiltInShadows {
    fn bevys(far: f32) -> Self {
        Self {
            far,
            shadows: BuiltInDescription {
                first_far: CascadeShadowConfigBuilder::default().first_cascade_far_bound,
                depth_bias: DirectionalLight::DEFAULT_SHADOW_DEPTH_BIAS,
                normal_bias: DirectionalLight::DEFAULT_SHADOW_NORMAL_BIAS,
            },
        }
    }

    fn cascades(&self) -> CascadeShadowConfig {
        let minimum_distance = 1e-3 * self.far;
        CascadeShadowConfigBuilder {
            num_cascades: 4,
            minimum_distance: minimum_distance.min(0.1),
            first_cascade_far_bound: self.shadows.first_far.min(0.5 * self.far),
            maximum_distance: self.far,
            ..default()
        }
        .build()
    }
}
