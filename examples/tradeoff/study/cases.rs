//! Small scenes that biases fail in, and what is wrong there for the bias' sake alone.

use bevy::{
    asset::RenderAssetUsages,
    light::{CascadeShadowConfig, Cascades, DirectionalLightShadowMap},
    math::{DMat2, DMat4, DVec2, DVec3},
    mesh::PrimitiveTopology,
    prelude::*,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};
use bevy_pssm::{
    ShadowPlans,
    geometry::bias::{MapDerivatives, automatic},
    plan::CascadePlan,
    prelude::*,
};

use crate::headless::Headless;

use super::{
    run::View,
    studio::{Studio, bevys_app, linear_camera, measurable_app},
};

/// A scene under the usual sun.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Case {
    /// Cards at 0 to 89° to the light, near and far.
    Slopes,
    /// Balls on the ground.
    Balls,
    /// Rolling ground.
    Waves,
    /// Walls of 2 cm.
    Walls,
    /// Fences with an alpha mask.
    Fences,
    /// A box on the ground, from its shadow's side.
    Contact,
    /// A slab over the ground along the view, for its shadow's edge at all depths.
    Slab,
}

impl Case {
    /// Those that biases fail in.
    pub const ALL: [Self; 6] = [
        Self::Slopes,
        Self::Balls,
        Self::Waves,
        Self::Walls,
        Self::Fences,
        Self::Contact,
    ];

    fn eye(self) -> Transform {
        let (eye, target) = match self {
            Self::Slopes => (Vec3::new(0.0, 0.0, 0.0), Vec3::NEG_Z),
            Self::Waves => (Vec3::new(0.0, 6.0, 0.0), Vec3::new(0.0, 0.0, -25.0)),
            Self::Contact => (Vec3::new(-1.2, 1.4, 4.5), Vec3::new(-1.6, 0.2, 0.0)),
            Self::Slab => (Vec3::new(0.0, 12.0, 6.0), Vec3::new(0.0, 0.0, -40.0)),
            Self::Balls | Self::Walls | Self::Fences => {
                (Vec3::new(0.0, 3.0, 4.0), Vec3::new(0.0, 0.5, -6.0))
            }
        };
        Transform::from_translation(eye).looking_at(target, Vec3::Y)
    }

    /// Of its pictures (pixels).
    fn size(self) -> UVec2 {
        match self {
            Self::Slab => UVec2::new(512, 384),
            _ => UVec2::new(256, 192),
        }
    }
}

/// Unit vector to the sun of all cases: from the right, a little behind the camera.
fn to_sun() -> Vec3 {
    Vec3::new(0.55, 0.65, 0.2).normalize()
}

/// A map as it was drawn.
#[derive(Debug, Clone, Copy)]
struct LaidMap {
    clip_from_world: DMat4,
    size: DVec2,
    far: f64,
}

/// A case before a camera.
pub fn case_studio(case: Case) -> Studio {
    let size = case.size();
    let headless = measurable_app(size, |_| ());
    furnish(headless, case, size, ParallelSplitShadows::default())
}

/// A case without the plugin.
pub fn bevys_studio(case: Case) -> Studio {
    let size = case.size();
    furnish(bevys_app(size, |_| ()), case, size, ())
}

fn furnish(mut headless: Headless, case: Case, size: UVec2, shadows: impl Bundle) -> Studio {
    let target = headless.render_target();
    let world = headless.app.world_mut();
    world.insert_resource(GlobalAmbientLight::NONE);
    build(world, case);
    let sun = world
        .spawn((
            DirectionalLight {
                illuminance: 3000.0,
                shadow_maps_enabled: true,
                ..default()
            },
            shadows,
            Transform::default().looking_to(-to_sun(), Vec3::Y),
        ))
        .id();
    let camera = world
        .spawn((Camera3d::default(), target, case.eye(), linear_camera()))
        .id();
    Studio::new(headless, camera, sun, size)
}

fn build(world: &mut World, case: Case) {
    let mut scene = Scene::new(world);
    if !matches!(case, Case::Slopes | Case::Waves) {
        let ground = Plane3d::default().mesh().size(300.0, 300.0).build();
        scene.add(ground, Transform::default());
    }
    match case {
        Case::Slopes => {
            let toward_eye = Vec3::Z.reject_from_normalized(to_sun()).normalize();
            for (row, (side, distance)) in [(0.5, 6.0), (5.0, 70.0)].into_iter().enumerate() {
                for (column, degrees) in [0.0, 20.0, 45.0, 60.0, 75.0, 85.0, 89.0_f32]
                    .into_iter()
                    .enumerate()
                {
                    let angle = degrees.to_radians();
                    let normal = to_sun() * angle.cos() + toward_eye * angle.sin();
                    let at = Vec3::new(
                        1.6 * side * (column as f32 - 3.0),
                        side * (2.0 - 4.0 * row as f32),
                        -distance,
                    );
                    let card = Plane3d::new(normal, Vec2::splat(0.5 * side)).mesh().build();
                    scene.add(card, Transform::from_translation(at));
                }
            }
        }
        Case::Balls => {
            let ball = Sphere::new(1.0).mesh().uv(64, 32);
            for i in 0..6 {
                let i = i as f32;
                let at = Vec3::new(1.5 - 2.6 * (i % 2.0), 1.0, -3.0 - 7.0 * i);
                scene.add(ball.clone(), Transform::from_translation(at));
            }
        }
        Case::Waves => scene.add(waves(), Transform::default()),
        Case::Walls => {
            let wall = Cuboid::new(2.0, 1.5, 0.02).mesh().build();
            for i in 0..7 {
                let i = i as f32;
                let at = Vec3::new(2.0 * (i % 3.0 - 1.0), 0.75, -2.0 - 5.0 * i);
                let turn = Quat::from_rotation_y(0.5 + 0.6 * i);
                scene.add(
                    wall.clone(),
                    Transform::from_translation(at).with_rotation(turn),
                );
            }
        }
        Case::Fences => {
            let fence = Rectangle::new(3.0, 1.2).mesh().build();
            let material = scene.fence();
            for i in 0..5 {
                let i = i as f32;
                let at = Vec3::new(1.5 - 3.0 * (i % 2.0), 0.6, -2.0 - 6.0 * i);
                let turn = Quat::from_rotation_y(0.4 + 0.5 * i);
                let place = Transform::from_translation(at).with_rotation(turn);
                scene.add_with(fence.clone(), place, material.clone());
            }
        }
        Case::Contact => {
            let block = Cuboid::new(1.5, 1.0, 1.5).mesh().build();
            scene.add(block, Transform::from_xyz(0.0, 0.5, 0.0));
        }
        Case::Slab => {
            let slab = Cuboid::new(6.0, 0.2, 400.0).mesh().build();
            scene.add(slab, Transform::from_xyz(6.0, 3.0, 0.0));
        }
    }
}

struct Scene<'w> {
    world: &'w mut World,
    paint: Handle<StandardMaterial>,
}

impl<'w> Scene<'w> {
    fn new(world: &'w mut World) -> Self {
        let paint = StandardMaterial {
            perceptual_roughness: 1.0,
            reflectance: 0.0,
            ..default()
        };
        let paint = world.resource_mut::<Assets<_>>().add(paint);
        Self { world, paint }
    }

    fn add(&mut self, mesh: Mesh, place: Transform) {
        self.add_with(mesh, place, self.paint.clone());
    }

    fn add_with(&mut self, mesh: Mesh, place: Transform, material: Handle<StandardMaterial>) {
        let mesh = self.world.resource_mut::<Assets<Mesh>>().add(mesh);
        self.world
            .spawn((Mesh3d(mesh), MeshMaterial3d(material), place));
    }

    /// Slats and gaps.
    fn fence(&mut self) -> Handle<StandardMaterial> {
        let texels = (0..64_u8).flat_map(|i| {
            let solid = i % 8 < 5 || i / 8 % 4 == 1;
            [255, 255, 255, 255 * u8::from(solid)]
        });
        let mask = Image::new(
            Extent3d {
                width: 8,
                height: 8,
                depth_or_array_layers: 1,
            },
            TextureDimension::D2,
            texels.collect(),
            TextureFormat::Rgba8UnormSrgb,
            RenderAssetUsages::default(),
        );
        let mask = self.world.resource_mut::<Assets<Image>>().add(mask);
        self.world
            .resource_mut::<Assets<StandardMaterial>>()
            .add(StandardMaterial {
                base_color_texture: Some(mask),
                alpha_mode: AlphaMode::Mask(0.5),
                cull_mode: None,
                double_sided: true,
                perceptual_roughness: 1.0,
                reflectance: 0.0,
                ..default()
            })
    }
}

/// Ground that rolls by a metre every 25.
fn waves() -> Mesh {
    const CELLS: u32 = 160;
    const SIDE: f32 = 160.0;
    let height = |x: f32, z: f32| (0.25 * x).sin() * 0.5 + (0.2 * z + 0.1 * x).sin() * 0.5;
    let at = |i: u32| (i as f32 / CELLS as f32 - 0.5) * SIDE;
    let mut positions = Vec::new();
    let mut normals = Vec::new();
    for (row, column) in (0..=CELLS).flat_map(|row| (0..=CELLS).map(move |column| (row, column))) {
        let (x, z) = (at(column), at(row));
        let dx = 50.0 * (height(x + 0.01, z) - height(x - 0.01, z));
        let dz = 50.0 * (height(x, z + 0.01) - height(x, z - 0.01));
        positions.push([x, height(x, z), z]);
        normals.push(Vec3::new(-dx, 1.0, -dz).normalize().to_array());
    }
    let stride = CELLS + 1;
    let indices = (0..CELLS)
        .flat_map(|row| (0..CELLS).map(move |column| row * stride + column))
        .flat_map(|a| [a, a + stride, a + 1, a + 1, a + stride, a + stride + 1])
        .collect();
    Mesh::new(
        PrimitiveTopology::TriangleList,
        RenderAssetUsages::default(),
    )
    .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions)
    .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, normals)
    .with_inserted_indices(bevy::mesh::Indices::U32(indices))
}

/// Faults that are the bias' own, in percent of the pixels that can have them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BiasFaults {
    /// Lit pixels farther from any shadow than the filter reaches that lack a tenth of the light.
    pub stain_pct: f64,
    /// Shadowed pixels that get more than half the light.
    pub leak_pct: f64,
    /// How far behind the box of [`Case::Contact`] its shadow begins, in texels as they lie on
    /// the ground.
    pub gap_texels: f64,
}

impl Studio {
    /// What is wrong with a picture for the bias' sake, under a filter that reaches so many
    /// texels, and by pixel whether it is.
    pub fn bias_faults(
        &mut self,
        view: &View,
        shares: &[Option<f32>],
        reach: f64,
    ) -> (BiasFaults, Vec<bool>) {
        let maps = self.laid_maps();
        let truth = &view.truth;
        let to_sun = to_sun().as_dvec3();
        let [mut lit, mut stained, mut dark, mut leaking] = [0_usize; 4];
        let mut gap = 0.0;
        let mut marks = vec![false; shares.len()];
        for (pixel, share) in shares.iter().enumerate() {
            let sample = truth.samples[pixel].filter(|sample| sample.faces_sun);
            let (Some(sample), Some(share)) = (sample, share) else {
                continue;
            };
            let Some(texel) = texel_at(&maps, view, sample.point) else {
                continue;
            };
            let on_surface = texel / sample.normal.dot(to_sun).max(0.01);
            if sample.lit {
                let reach = (reach + 1.0) * core::f64::consts::SQRT_2 * on_surface;
                let reach = 2.0 + reach / truth.lens.pixel_size(sample.point);
                if truth.to_boundary(pixel).is_none_or(|edge| edge > reach) {
                    lit += 1;
                    marks[pixel] = *share < 0.9;
                    stained += usize::from(marks[pixel]);
                }
                continue;
            }
            dark += 1;
            marks[pixel] = *share > 0.5;
            leaking += usize::from(marks[pixel]);
            // Behind the middle of the box.
            let behind = -0.75 - sample.point.x;
            let inside = sample.point.y.abs() < 1e-3 && sample.point.z.abs() < 0.3;
            if marks[pixel] && inside && behind > 0.0 && behind < 0.6 {
                gap = f64::max(gap, behind / on_surface);
            }
        }
        let percent = |part: usize, whole: usize| 100.0 * part as f64 / whole.max(1) as f64;
        let faults = BiasFaults {
            stain_pct: percent(stained, lit),
            leak_pct: percent(leaking, dark),
            gap_texels: gap,
        };
        (faults, marks)
    }

    /// The automatic bias towards the light that a pixel should have (texels), and the texels
    /// that it spans where they are fewest; `None` where two cascades are mixed, or the pixel and
    /// its neighbours are not of one triangle.
    pub fn expected_lookup(&mut self, view: &View, pixel: usize) -> Option<[f64; 2]> {
        let maps = self.laid_maps();
        let truth = &view.truth;
        let sample = |pixel: usize| truth.samples.get(pixel).copied().flatten();
        let here = sample(pixel)?;
        let steps = [1, self.size.x as usize].map(|step| sample(pixel + step));
        let [right, below] = [steps[0]?, steps[1]?];
        if right.triangle != here.triangle || below.triangle != here.triangle {
            return None;
        }
        let depth = depth_of(view, here.point);
        let map = maps.iter().find(|map| depth < map.far)?;
        if depth > 0.8 * map.far {
            return None;
        }
        let derivatives = MapDerivatives::at(&map.clip_from_world, here.point)?;
        let to_sun = to_sun().as_dvec3();
        let bias = automatic(
            &map.clip_from_world,
            here.point,
            here.normal,
            to_sun,
            map.size,
        )?;
        let texel = derivatives.texel(map.size).max_element();
        let per_metre = derivatives.z.dot(to_sun).abs();
        let texels = [right, below].map(|neighbour| {
            let step = neighbour.point - here.point;
            0.5 * map.size * DVec2::new(derivatives.x.dot(step), derivatives.y.dot(step))
        });
        let jacobian = DMat2::from_cols(texels[0], texels[1]);
        let squares = jacobian.transpose() * jacobian;
        let (half_trace, determinant) = (
            0.5 * (squares.x_axis.x + squares.y_axis.y),
            squares.determinant(),
        );
        let fewest = half_trace - (half_trace * half_trace - determinant).max(0.0).sqrt();
        Some([bias.depth / per_metre / texel, fewest.max(0.0).sqrt()])
    }

    /// Width of the penumbra at the edge of [`Case::Slab`]'s shadow, mean over a range of view
    /// depths (metres along the ground, 10 to 90 % or so).
    pub fn penumbra(&mut self, view: &View, shares: &[Option<f32>], depths: [f64; 2]) -> f64 {
        let width = self.size.x as usize;
        let mut widths = Vec::new();
        for row in 0..self.size.y as usize {
            let mut sum = 0.0;
            let mut wanted = false;
            let row = row * width..(row + 1) * width;
            let samples = view.truth.samples[row.clone()].windows(2);
            for (pair, share) in samples.zip(&shares[row]) {
                let (Some(here), Some(next), Some(share)) = (pair[0], pair[1], *share) else {
                    continue;
                };
                let on_ground = here.point.y.abs() < 1e-3 && next.point.y.abs() < 1e-3;
                // Left of the shadow's middle.
                if !on_ground || here.point.x > 3.0 {
                    continue;
                }
                let depth = depth_of(view, here.point);
                wanted |= depth >= depths[0] && depth < depths[1];
                let share = f64::from(share);
                // A sixth of its width for an even ramp.
                sum += 6.0 * share * (1.0 - share) * (next.point.x - here.point.x);
            }
            if wanted {
                widths.push(sum);
            }
        }
        widths.iter().sum::<f64>() / widths.len().max(1) as f64
    }

    fn laid_maps(&mut self) -> Vec<LaidMap> {
        let (camera, sun) = (self.camera, self.sun);
        let world = self.world();
        let enabled = |shadows: &ParallelSplitShadows| shadows.enabled;
        if world.get::<ParallelSplitShadows>(sun).is_some_and(enabled) {
            let plans = world.get::<ShadowPlans>(sun);
            let cascades = plans.and_then(|plans| plans.views.get(&camera));
            let map_of = |cascade: &CascadePlan| {
                Some(LaidMap {
                    clip_from_world: cascade.map.as_ref()?.clip_from_world,
                    size: cascade.map_size.as_dvec2(),
                    far: cascade.far,
                })
            };
            return cascades.into_iter().flatten().filter_map(map_of).collect();
        }
        let size = DVec2::splat(world.resource::<DirectionalLightShadowMap>().size as f64);
        let bounds = world.get::<CascadeShadowConfig>(sun).map(|c| &c.bounds);
        let cascades = world
            .get::<Cascades>(sun)
            .and_then(|c| c.cascades.get(&camera));
        let pairs = cascades
            .into_iter()
            .flatten()
            .zip(bounds.into_iter().flatten());
        pairs
            .map(|(cascade, far)| LaidMap {
                clip_from_world: cascade.clip_from_world.as_dmat4(),
                size,
                far: f64::from(*far),
            })
            .collect()
    }
}

/// Size of a texel across the light at a point (metres); near a cascade's end the next one's,
/// which is mixed in there.
fn texel_at(maps: &[LaidMap], view: &View, point: DVec3) -> Option<f64> {
    let depth = depth_of(view, point);
    let index = maps.iter().position(|map| depth < map.far)?;
    let next = maps
        .get(index + 1)
        .filter(|_| depth > 0.75 * maps[index].far);
    let texel = |map: &LaidMap| {
        let derivatives = MapDerivatives::at(&map.clip_from_world, point)?;
        Some(derivatives.texel(map.size).max_element())
    };
    Some(texel(&maps[index])?.max(next.and_then(texel).unwrap_or(0.0)))
}

/// Metres from the eye, along the view.
fn depth_of(view: &View, point: DVec3) -> f64 {
    view.truth
        .lens
        .clip_from_world
        .row(3)
        .dot(point.extend(1.0))
}
