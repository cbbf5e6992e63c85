//! An app without a window, stepped by hand, whose picture is read back.

#![allow(dead_code, reason = "shared by several binaries")]

use bevy::{
    app::PluginsState,
    asset::{RenderAssetUsages, UnapprovedPathMode},
    camera::RenderTarget,
    image::Image as BevyImage,
    log::LogPlugin,
    platform::sync::{Arc, Mutex},
    prelude::*,
    render::{
        RenderApp, RenderPlugin,
        pipelined_rendering::PipelinedRenderingPlugin,
        render_asset::RenderAssets,
        render_resource::{
            BufferDescriptor, BufferUsages, CachedPipelineState, Extent3d, MapMode, PipelineCache,
            PollType, TexelCopyBufferInfo, TexelCopyBufferLayout, TextureFormat, TextureUsages,
        },
        renderer::{RenderDevice, RenderQueue},
        settings::{RenderCreation, WgpuSettings},
        texture::GpuImage,
        view::screenshot::{Screenshot, ScreenshotCaptured},
    },
    time::TimeUpdateStrategy,
    window::ExitCondition,
    winit::WinitPlugin,
};
use image::RgbaImage;

/// Steps after which a picture is final if nothing is left to load or compile.
const SETTLE_STEPS: usize = 4;
/// Steps after which waiting for assets or pipelines is given up.
const MAX_STEPS: usize = 2000;

/// A windowless app that renders into an image.
pub struct Headless {
    /// The app, for spawning and changing things between steps.
    pub app: App,
    /// What cameras should render to.
    pub target: Handle<BevyImage>,
}

impl Headless {
    /// Starts an app with Bevy's default plugins, and whatever `setup` adds, rendering pictures
    /// of `size` pixels.
    pub fn new(size: UVec2, setup: impl FnOnce(&mut App)) -> Self {
        Self::with_gpu(size, WgpuSettings::default(), setup)
    }

    /// As [`Headless::new`], with the GPU's features or limits restricted.
    pub fn with_gpu(size: UVec2, gpu: WgpuSettings, setup: impl FnOnce(&mut App)) -> Self {
        Self::with_format(size, TextureFormat::Rgba8UnormSrgb, gpu, setup)
    }

    /// As [`Headless::with_gpu`], with pictures of another format.
    pub fn with_format(
        size: UVec2,
        format: TextureFormat,
        gpu: WgpuSettings,
        setup: impl FnOnce(&mut App),
    ) -> Self {
        let renderer = RenderPlugin {
            render_creation: RenderCreation::Automatic(Box::new(gpu)),
            synchronous_pipeline_compilation: true,
            ..default()
        };
        Self::with_renderer(size, format, renderer, setup)
    }

    /// As [`Headless::with_format`], with another renderer.
    pub fn with_renderer(
        size: UVec2,
        format: TextureFormat,
        renderer: RenderPlugin,
        setup: impl FnOnce(&mut App),
    ) -> Self {
        crate::warnings::capture();
        let mut app = App::new();
        app.add_plugins(
            DefaultPlugins
                .set(AssetPlugin {
                    // Where a load says so: for models outside of the assets' folder.
                    unapproved_path_mode: UnapprovedPathMode::Deny,
                    ..default()
                })
                .set(WindowPlugin {
                    primary_window: None,
                    exit_condition: ExitCondition::DontExit,
                    ..default()
                })
                .set(renderer)
                .disable::<WinitPlugin>()
                .disable::<LogPlugin>()
                .disable::<PipelinedRenderingPlugin>(),
        );
        app.insert_resource(TimeUpdateStrategy::ManualDuration(
            core::time::Duration::ZERO,
        ));
        setup(&mut app);
        while app.plugins_state() == PluginsState::Adding {
            bevy::tasks::tick_global_task_pools_on_main_thread();
        }
        app.finish();
        app.cleanup();

        let mut image = BevyImage::new_target_texture(size.x, size.y, format, None);
        image.texture_descriptor.usage |= TextureUsages::COPY_SRC;
        // A renderer that starts again finds it.
        image.asset_usage = RenderAssetUsages::all();
        let target = app
            .world_mut()
            .resource_mut::<Assets<BevyImage>>()
            .add(image);
        Self { app, target }
    }

    /// The component that points a camera at the picture.
    pub fn render_target(&self) -> RenderTarget {
        RenderTarget::Image(self.target.clone().into())
    }

    /// One frame, finished on the GPU.
    pub fn step(&mut self) {
        self.app.update();
        self.finish();
    }

    /// Waits until the GPU has finished.
    pub fn finish(&self) {
        if let Some(device) = self.app.world().get_resource::<RenderDevice>() {
            // A lost device shows in the next step.
            let _ = device.wgpu_device().poll(PollType::wait_indefinitely());
        }
    }

    /// Steps until shaders are compiled and the picture is final.
    ///
    /// # Panics
    /// If that never happens or a pipeline fails to compile.
    pub fn settle(&mut self) {
        let mut quiet = 0;
        for _ in 0..MAX_STEPS {
            self.step();
            let waiting = self.waiting_pipelines();
            quiet = if waiting { 0 } else { quiet + 1 };
            if quiet >= SETTLE_STEPS {
                return;
            }
        }
        panic!("pipelines are still waiting after {MAX_STEPS} frames");
    }

    fn waiting_pipelines(&self) -> bool {
        let cache = self
            .app
            .sub_app(RenderApp)
            .world()
            .resource::<PipelineCache>();
        for pipeline in cache.pipelines() {
            if let CachedPipelineState::Err(err) = &pipeline.state {
                let waits = format!("{err:?}").contains("NotLoaded")
                    || format!("{err:?}").contains("NotYet");
                assert!(waits, "a pipeline failed: {err}");
            }
        }
        cache.waiting_pipelines().next().is_some()
    }

    /// The picture of the next frame.
    ///
    /// # Panics
    /// If it never arrives.
    pub fn picture(&mut self) -> RgbaImage {
        let taken: Arc<Mutex<Option<RgbaImage>>> = Arc::default();
        let slot = taken.clone();
        self.app
            .world_mut()
            .spawn(Screenshot::image(self.target.clone()))
            .observe(move |captured: On<ScreenshotCaptured>| {
                let picture = captured
                    .image
                    .clone()
                    .try_into_dynamic()
                    .map(|i| i.to_rgba8());
                if let (Ok(mut slot), Ok(picture)) = (slot.lock(), picture) {
                    *slot = Some(picture);
                }
            });
        for _ in 0..20 {
            self.step();
            if let Some(picture) = taken.lock().ok().and_then(|mut slot| slot.take()) {
                return picture;
            }
        }
        panic!("no picture arrived");
    }

    /// The bytes of the last frame's picture, row by row; none before the first frame.
    pub fn read_back(&self) -> Vec<u8> {
        let world = self.app.sub_app(RenderApp).world();
        let images = world.resource::<RenderAssets<GpuImage>>();
        let Some(image) = images.get(&self.target) else {
            return Vec::new();
        };
        let (device, queue) = (
            world.resource::<RenderDevice>(),
            world.resource::<RenderQueue>(),
        );
        let format = image.texture_descriptor.format;
        let pixel = format.block_copy_size(None).unwrap_or(4);
        let Extent3d { width, height, .. } = image.texture_descriptor.size;
        let row = (width * pixel) as usize;
        let padded = RenderDevice::align_copy_bytes_per_row(row);
        let buffer = device.create_buffer(&BufferDescriptor {
            label: Some("read_back"),
            size: padded as u64 * u64::from(height),
            usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = device.create_command_encoder(&default());
        encoder.copy_texture_to_buffer(
            image.texture.as_image_copy(),
            TexelCopyBufferInfo {
                buffer: &buffer,
                layout: TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(padded as u32),
                    rows_per_image: None,
                },
            },
            image.texture_descriptor.size,
        );
        queue.submit([encoder.finish()]);
        buffer.slice(..).map_async(MapMode::Read, |_| ());
        // A lost device leaves nothing to map, which shows in the next line.
        let _ = device.wgpu_device().poll(PollType::wait_indefinitely());
        let Ok(mapped) = buffer.slice(..).get_mapped_range() else {
            return Vec::new();
        };
        let rows = mapped.chunks(padded);
        rows.flat_map(|padded| &padded[..row]).copied().collect()
    }
}
