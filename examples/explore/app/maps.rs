//! Small pictures of the sides' shadow maps, and where those maps are.

use bevy::{
    asset::RenderAssetUsages,
    pbr::Shadow,
    prelude::*,
    render::{
        Extract, ExtractSchedule, Render, RenderApp, RenderStartup, RenderSystems,
        render_asset::RenderAssets,
        render_phase::{BinnedRenderPhase, ViewBinnedRenderPhases},
        render_resource::{
            BindGroup, BindGroupEntries, BindGroupLayout, BindGroupLayoutDescriptor,
            BindGroupLayoutEntries, BufferInitDescriptor, BufferUsages, CachedRenderPipelineId,
            CommandEncoderDescriptor, Extent3d, FragmentState, LoadOp, Operations, PipelineCache,
            RenderPassColorAttachment, RenderPassDescriptor, RenderPipelineDescriptor,
            ShaderStages, StoreOp, TextureDimension, TextureFormat, TextureUsages, TextureView,
            VertexState,
            binding_types::{texture_depth_2d, uniform_buffer},
        },
        renderer::{PendingCommandBuffers, RenderDevice, RenderGraph, RenderGraphSystems},
        sync_world::MainEntity,
        texture::GpuImage,
        view::{ExtractedView, RetainedViewEntity},
    },
    shader::Shader,
};
use bevy_pssm::{AdoptedMap, PssmRenderSystems, ShadowTarget, config::MAX_CASCADES};

use super::sides::{Side, SideCamera, SideSun};

/// Pixels along a side of a picture.
pub const THUMBNAIL_SIDE: u32 = 128;
/// Pictures of all cascades of both sides.
pub const THUMBNAILS: usize = 2 * MAX_CASCADES;

const FORMAT: TextureFormat = TextureFormat::Rgba8Unorm;
const LABEL: &str = "map_thumbnail";

/// Draws [`MapThumbnails`].
pub struct MapThumbnailsPlugin;

/// Pictures of the maps that lie in the plugin's array.
#[derive(Resource, Debug)]
pub struct MapThumbnails {
    /// They are drawn in each frame.
    pub on: bool,
    /// The left side's cascades, then the right side's; black without a map, blue where nothing casts.
    pub images: [Handle<Image>; THUMBNAILS],
}

impl FromWorld for MapThumbnails {
    fn from_world(world: &mut World) -> Self {
        let mut images = world.get_resource_mut::<Assets<Image>>();
        let mut add = || images.as_mut().map(|images| images.add(blank()));
        Self {
            on: false,
            images: core::array::from_fn(|_| add().unwrap_or_default()),
        }
    }
}

/// A picture that can be drawn into.
fn blank() -> Image {
    let size = Extent3d {
        width: THUMBNAIL_SIDE,
        height: THUMBNAIL_SIDE,
        depth_or_array_layers: 1,
    };
    let black = [0, 0, 0, 255];
    let usage = RenderAssetUsages::default();
    let mut image = Image::new_fill(size, TextureDimension::D2, &black, FORMAT, usage);
    image.texture_descriptor.usage |= TextureUsages::RENDER_ATTACHMENT;
    image
}

impl Plugin for MapThumbnailsPlugin {
    fn build(&self, app: &mut App) {
        if !app.is_plugin_added::<SideMapsPlugin>() {
            app.add_plugins(SideMapsPlugin);
        }
        app.init_resource::<MapThumbnails>();
        let Some(mut shaders) = app.world_mut().get_resource_mut::<Assets<Shader>>() else {
            return;
        };
        let shader = shaders.add(Shader::from_wgsl(include_str!("maps.wgsl"), "maps.wgsl"));
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else {
            return;
        };
        render_app
            .insert_resource(ThumbnailShader(shader))
            .init_resource::<Wanted>()
            .add_systems(RenderStartup, queue_pipeline)
            .add_systems(ExtractSchedule, extract_wanted)
            .add_systems(
                RenderGraph,
                draw_thumbnails
                    .after(RenderGraphSystems::Render)
                    .before(RenderGraphSystems::Submit),
            );
    }
}

/// Finds the sides' maps among all that the plugin draws.
pub struct SideMapsPlugin;

/// Where the sides' maps are in the plugin's array. In the render world, from
/// [`PssmRenderSystems::AdoptViews`] on.
#[derive(Resource, Debug, Default)]
pub struct SideMaps {
    /// Camera and sun of each side that is shown.
    sides: [Option<(MainEntity, MainEntity)>; 2],
    /// By side and cascade.
    pub maps: [[Option<SideMap>; MAX_CASCADES]; 2],
}

/// A map in the plugin's array.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SideMap {
    /// In which layer.
    pub layer: u32,
    /// Texels, in the layer's first corner.
    pub size: UVec2,
    /// What is drawn into it.
    pub view: RetainedViewEntity,
}

impl Plugin for SideMapsPlugin {
    fn build(&self, app: &mut App) {
        if let Some(render_app) = app.get_sub_app_mut(RenderApp) {
            render_app
                .init_resource::<SideMaps>()
                .add_systems(ExtractSchedule, extract_sides)
                .add_systems(
                    Render,
                    find_side_maps
                        .in_set(RenderSystems::PrepareViews)
                        .after(PssmRenderSystems::AdoptViews),
                );
        }
    }
}

fn extract_sides(
    mut maps: ResMut<SideMaps>,
    cameras: Extract<Query<(Entity, &SideCamera, &Camera)>>,
    suns: Extract<Query<(Entity, &SideSun)>>,
) {
    maps.sides = Side::BOTH.map(|side| {
        let mut cameras = cameras.iter();
        let mut suns = suns.iter();
        let (camera, ..) = cameras.find(|(_, it, camera)| it.0 == side && camera.is_active)?;
        let (sun, _) = suns.find(|(_, it)| it.0 == side)?;
        Some((MainEntity::from(camera), MainEntity::from(sun)))
    });
}

/// Runs after [`PssmRenderSystems::AdoptViews`], and before views of maps that are held lose their `ExtractedView`.
pub fn find_side_maps(mut maps: ResMut<SideMaps>, views: Query<(&AdoptedMap, &ExtractedView)>) {
    let mut found = [[None; MAX_CASCADES]; 2];
    for (map, view) in &views {
        let view = view.retained_view_entity;
        let Some(camera) = view.auxiliary_entity else {
            continue;
        };
        let of_view = Some((camera, view.main_entity));
        let Some(side) = maps.sides.iter().position(|side| *side == of_view) else {
            continue;
        };
        if let Some(slot) = found[side].get_mut(view.subview_index as usize) {
            *slot = Some(SideMap {
                layer: map.layer,
                size: map.size,
                view,
            });
        }
    }
    maps.maps = found;
}

/// The pictures that are to be drawn: none while they are off.
#[derive(Resource, Default)]
struct Wanted(Vec<AssetId<Image>>);

#[derive(Resource)]
struct ThumbnailShader(Handle<Shader>);

#[derive(Resource)]
struct ThumbnailPipeline {
    layout: BindGroupLayoutDescriptor,
    id: CachedRenderPipelineId,
}

fn extract_wanted(mut wanted: ResMut<Wanted>, thumbnails: Extract<Res<MapThumbnails>>) {
    wanted.0.clear();
    if thumbnails.on {
        wanted.0.extend(thumbnails.images.iter().map(Handle::id));
    }
}

fn queue_pipeline(mut commands: Commands, cache: Res<PipelineCache>, shader: Res<ThumbnailShader>) {
    let layout = BindGroupLayoutDescriptor::new(
        LABEL,
        &BindGroupLayoutEntries::sequential(
            ShaderStages::VERTEX_FRAGMENT,
            (texture_depth_2d(), uniform_buffer::<UVec4>(false)),
        ),
    );
    let id = cache.queue_render_pipeline(RenderPipelineDescriptor {
        label: Some(LABEL.into()),
        layout: vec![layout.clone()],
        vertex: VertexState {
            shader: shader.0.clone(),
            entry_point: Some("vertex".into()),
            ..default()
        },
        fragment: Some(FragmentState {
            shader: shader.0.clone(),
            entry_point: Some("fragment".into()),
            targets: vec![Some(FORMAT.into())],
            ..default()
        }),
        ..default()
    });
    commands.insert_resource(ThumbnailPipeline { layout, id });
}

/// What a picture shows of a map.
struct Shown {
    /// Pixels, in the picture's first corner: as wide or as high as it is.
    size: UVec2,
    bind_group: BindGroup,
}

impl Shown {
    fn new(
        device: &RenderDevice,
        layout: &BindGroupLayout,
        map: &SideMap,
        layer: &TextureView,
        is_empty: bool,
    ) -> Self {
        let longest = map.size.max_element().max(1);
        let size = (map.size * THUMBNAIL_SIDE / longest).max(UVec2::ONE);
        let texels = if is_empty { UVec2::ZERO } else { map.size };
        let contents: Vec<u8> = [texels.x, texels.y, size.x, size.y]
            .into_iter()
            .flat_map(u32::to_ne_bytes)
            .collect();
        let sizes = device.create_buffer_with_data(&BufferInitDescriptor {
            label: Some(LABEL),
            contents: &contents,
            usage: BufferUsages::UNIFORM,
        });
        let entries = BindGroupEntries::sequential((layer, sizes.as_entire_binding()));
        Self {
            size,
            bind_group: device.create_bind_group(LABEL, layout, &entries),
        }
    }
}

/// Nothing is drawn into a layer whose map has no casters: it still holds what it held.
fn is_empty(phases: &ViewBinnedRenderPhases<Shadow>, resting: RetainedViewEntity) -> bool {
    // As the plugin numbers its views of what moves.
    let moving = RetainedViewEntity {
        subview_index: resting.subview_index + MAX_CASCADES as u32,
        ..resting
    };
    [resting, moving]
        .iter()
        .all(|view| phases.get(view).is_none_or(BinnedRenderPhase::is_empty))
}

/// Runs once all maps of the frame are drawn.
fn draw_thumbnails(
    wanted: Res<Wanted>,
    maps: Res<SideMaps>,
    target: Option<Res<ShadowTarget>>,
    phases: Res<ViewBinnedRenderPhases<Shadow>>,
    images: Res<RenderAssets<GpuImage>>,
    thumbnails: Option<Res<ThumbnailPipeline>>,
    cache: Res<PipelineCache>,
    device: Res<RenderDevice>,
    mut pending: ResMut<PendingCommandBuffers>,
) {
    let (Some(target), Some(thumbnails), false) = (target, thumbnails, wanted.0.is_empty()) else {
        return;
    };
    let Some(pipeline) = cache.get_render_pipeline(thumbnails.id) else {
        return;
    };
    let layout = cache.get_bind_group_layout(&thumbnails.layout);
    let mut encoder =
        device.create_command_encoder(&CommandEncoderDescriptor { label: Some(LABEL) });
    for (image, map) in wanted.0.iter().zip(maps.maps.iter().flatten()) {
        let Some(image) = images.get(*image) else {
            continue;
        };
        let shown = map.as_ref().and_then(|map| {
            let layer = target.layer(map.layer)?;
            let is_empty = is_empty(&phases, map.view);
            Some(Shown::new(&device, &layout, map, layer, is_empty))
        });
        let mut pass = encoder.begin_render_pass(&RenderPassDescriptor {
            label: Some(LABEL),
            color_attachments: &[Some(RenderPassColorAttachment {
                view: &image.texture_view,
                depth_slice: None,
                resolve_target: None,
                ops: Operations {
                    load: LoadOp::Clear(LinearRgba::BLACK.into()),
                    store: StoreOp::Store,
                },
            })],
            ..default()
        });
        if let Some(Shown { size, bind_group }) = &shown {
            let [width, height] = size.as_vec2().to_array();
            pass.set_viewport(0.0, 0.0, width, height, 0.0, 1.0);
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, bind_group, &[]);
            pass.draw(0..3, 0..1);
        }
    }
    pending.push_encoder(encoder, LABEL);
}
