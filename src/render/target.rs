//! The depth array that holds all maps.

use bevy::{
    ecs::resource::Resource,
    math::UVec2,
    pbr::CORE_3D_SHADOW_MAP_FORMAT,
    render::{
        render_resource::{
            Extent3d, Texture, TextureAspect, TextureDescriptor, TextureDimension, TextureUsages,
            TextureView, TextureViewDescriptor, TextureViewDimension,
        },
        renderer::RenderDevice,
    },
};

/// Frames after which layers that no map needs are given back: what comes and goes, as a camera may,
/// should not allocate all anew.
const SHRINK_DELAY: u32 = 60;

/// The depth array that holds all maps.
#[derive(Resource, Debug, Default)]
pub struct ShadowTarget {
    texture: Option<Texture>,
    layers: Vec<TextureView>,
    /// For how many frames in a row there have been more layers than maps.
    frames_too_many: u32,
    /// Counts textures: layers of another hold nothing yet.
    generation: u64,
    /// Of a layer.
    pub(super) size: UVec2,
    /// Side of Bevy's own maps (texels).
    pub(super) built_in_size: u32,
}

impl ShadowTarget {
    /// One layer of the array; `None` past its end.
    pub fn layer(&self, layer: u32) -> Option<&TextureView> {
        self.layers.get(layer as usize)
    }

    pub(super) fn generation(&self) -> u64 {
        self.generation
    }

    /// Gives all layers back.
    pub(super) fn free(&mut self) {
        *self = Self {
            generation: self.generation + 1,
            ..Self::default()
        };
    }

    /// Whether there are any maps.
    pub(super) fn exists(&self) -> bool {
        self.texture.is_some()
    }

    /// All layers at once, for the shader.
    pub(super) fn array_view(texture: &Texture) -> TextureView {
        texture.create_view(&TextureViewDescriptor {
            label: Some("pssm_shadow_map_array"),
            dimension: Some(TextureViewDimension::D2Array),
            aspect: TextureAspect::DepthOnly,
            ..Default::default()
        })
    }

    /// Makes it hold so many layers of a size.
    pub(super) fn resize(&mut self, device: &RenderDevice, size: UVec2, layers: u32) -> &Texture {
        let present = self.layers.len() as u32;
        self.frames_too_many = if present > layers {
            self.frames_too_many + 1
        } else {
            0
        };
        let fits = self.size == size && present >= layers && self.frames_too_many < SHRINK_DELAY;
        if !fits {
            self.texture = None;
            self.generation += 1;
            self.frames_too_many = 0;
        }
        self.size = size;
        let (views, texture) = (&mut self.layers, &mut self.texture);
        texture.get_or_insert_with(|| {
            let texture = device.create_texture(&TextureDescriptor {
                label: Some("pssm_shadow_maps"),
                size: Extent3d {
                    width: size.x,
                    height: size.y,
                    depth_or_array_layers: layers,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: TextureDimension::D2,
                format: CORE_3D_SHADOW_MAP_FORMAT,
                usage: TextureUsages::RENDER_ATTACHMENT
                    | TextureUsages::TEXTURE_BINDING
                    | TextureUsages::COPY_SRC,
                view_formats: &[],
            });
            *views = (0..layers)
                .map(|layer| layer_view(&texture, layer))
                .collect();
            texture
        })
    }
}

fn layer_view(texture: &Texture, layer: u32) -> TextureView {
    texture.create_view(&TextureViewDescriptor {
        label: Some("pssm_shadow_map"),
        dimension: Some(TextureViewDimension::D2),
        base_array_layer: layer,
        array_layer_count: Some(1),
        ..Default::default()
    })
}
