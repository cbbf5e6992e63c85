//! The depth array that holds all maps.

use bevy::{
    ecs::resource::Resource,
    math::UVec2,
    pbr::CORE_3D_SHADOW_MAP_FORMAT,
    platform::collections::{HashMap, HashSet},
    render::{
        render_resource::{
            CommandEncoder, Extent3d, Texture, TextureAspect, TextureDescriptor, TextureDimension,
            TextureUsages, TextureView, TextureViewDescriptor, TextureViewDimension,
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
    /// The array, and a view of all its layers, for the shader.
    texture: Option<(Texture, TextureView)>,
    layers: Vec<TextureView>,
    /// By layer: what rests in maps in which something moves.
    apart: HashMap<u32, Apart>,
    /// For how many frames in a row there have been more layers than maps.
    frames_too_many: u32,
    /// Counts textures: layers of another hold nothing yet.
    generation: u64,
    /// Of a layer.
    pub(super) size: UVec2,
    /// Side of Bevy's own maps (texels).
    pub(super) built_in_size: u32,
}

/// A copy of a layer that holds only what rests.
#[derive(Debug)]
struct Apart {
    texture: Texture,
    view: TextureView,
}

impl ShadowTarget {
    /// One layer of the array; `None` past its end.
    pub fn layer(&self, layer: u32) -> Option<&TextureView> {
        self.layers.get(layer as usize)
    }

    /// Whether what rests in a layer is drawn apart from it.
    pub(super) fn is_apart(&self, layer: u32) -> bool {
        self.apart.contains_key(&layer)
    }

    /// Where what rests in a layer is drawn.
    pub(super) fn resting(&self, layer: u32) -> Option<&TextureView> {
        let apart = self.apart.get(&layer);
        apart.map_or_else(|| self.layer(layer), |apart| Some(&apart.view))
    }

    /// Has what rests in these layers, and in no others, drawn apart from them.
    pub(super) fn keep_apart(&mut self, device: &RenderDevice, layers: HashSet<u32>) {
        self.apart.retain(|layer, _| layers.contains(layer));
        for layer in layers {
            let size = self.size;
            self.apart.entry(layer).or_insert_with(|| {
                let texture = depth_array(device, "pssm_resting_casters", size, 1);
                let view = layer_view(&texture, 0);
                Apart { texture, view }
            });
        }
    }

    /// Copies what rests into a layer: all of it, as WebGPU copies depth.
    pub(super) fn copy_from_apart(&self, encoder: &mut CommandEncoder, layer: u32) {
        let (Some((texture, _)), Some(apart)) = (&self.texture, self.apart.get(&layer)) else {
            return;
        };
        let mut to = texture.as_image_copy();
        to.origin.z = layer;
        let extent = Extent3d {
            width: self.size.x,
            height: self.size.y,
            depth_or_array_layers: 1,
        };
        encoder.copy_texture_to_texture(apart.texture.as_image_copy(), to, extent);
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

    /// Makes it hold so many layers of a size.
    pub(super) fn resize(
        &mut self,
        device: &RenderDevice,
        size: UVec2,
        layers: u32,
    ) -> &(Texture, TextureView) {
        let present = self.layers.len() as u32;
        self.frames_too_many = if present > layers {
            self.frames_too_many + 1
        } else {
            0
        };
        let fits = self.size == size && present >= layers && self.frames_too_many < SHRINK_DELAY;
        if !fits {
            self.texture = None;
            self.apart.clear();
            self.generation += 1;
            self.frames_too_many = 0;
        }
        self.size = size;
        let (views, texture) = (&mut self.layers, &mut self.texture);
        texture.get_or_insert_with(|| {
            let texture = depth_array(device, "pssm_shadow_maps", size, layers);
            *views = (0..layers)
                .map(|layer| layer_view(&texture, layer))
                .collect();
            let array = array_view(&texture);
            (texture, array)
        })
    }
}

fn depth_array(device: &RenderDevice, label: &str, size: UVec2, layers: u32) -> Texture {
    device.create_texture(&TextureDescriptor {
        label: Some(label),
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
            | TextureUsages::COPY_SRC
            | TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

fn array_view(texture: &Texture) -> TextureView {
    texture.create_view(&TextureViewDescriptor {
        label: Some("pssm_shadow_map_array"),
        dimension: Some(TextureViewDimension::D2Array),
        aspect: TextureAspect::DepthOnly,
        ..Default::default()
    })
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
