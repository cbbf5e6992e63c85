//! Shadows as they should be, by rays.
//!
//! A shadow ray must not hit the triangle it starts from, nor that triangle's neighbors across
//! a shared edge, yet must hit whatever stands on the surface. So: rays meet triangles in double
//! precision, the own triangle is left out by its index, and the start is raised along the
//! triangle's normal by a millionth of its coordinates, the size of the rounding of the
//! vertices themselves (0.1 mm a hundred meters from the origin). Contact shadows lose no more
//! than that.

use bevy::{
    math::{DMat4, DVec2, DVec3},
    prelude::*,
    render::render_resource::Face,
    tasks::{ComputeTaskPool, ParallelSlice, ParallelSliceMut, TaskPool},
};
use obvhs::{
    BvhBuildParams,
    aabb::Aabb,
    bvh2::{Bvh2, builder::build_bvh2},
    ray::{Ray, RayHit},
};

use super::gather::Geometry;

/// Start of a shadow ray above its surface, as a share of the point's largest coordinate.
const LIFT: f64 = 1e-6;

/// By how much a triangle's box is larger than it, as a share of its largest coordinate: rays
/// meet boxes in single precision, and must not pass by one whose triangle they hit.
const PADDING: f32 = 1e-5;

/// What a camera looks through.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// From world space to clip space, as the GPU has it.
    pub clip_from_world: DMat4,
    /// Pixels.
    pub size: UVec2,
}

impl Lens {
    /// A camera's.
    pub fn of(transform: &GlobalTransform, projection: &Projection, size: UVec2) -> Self {
        let view_from_world = transform.to_matrix().as_dmat4().inverse();
        Self {
            clip_from_world: projection.get_clip_from_view().as_dmat4() * view_from_world,
            size,
        }
    }

    /// Width of a pixel at a point in world space (meters).
    pub fn pixel_size(&self, point: DVec3) -> f64 {
        let [y, w] = [1, 3].map(|row| self.clip_from_world.row(row));
        2.0 * w.dot(point.extend(1.0)) / (y.truncate().length() * f64::from(self.size.y))
    }

    /// Whether two neighboring samples lie on one surface: the second within two pixels' widths
    /// of the first one's plane.
    pub fn same_surface(&self, center: &Sample, other: &Sample) -> bool {
        let off_plane = (other.point - center.point).dot(center.normal).abs();
        off_plane < 2.0 * self.pixel_size(center.point)
    }

    /// Start and direction of the ray through a place in the picture (pixels).
    fn ray(&self, world_from_clip: &DMat4, x: f64, y: f64) -> (DVec3, DVec3) {
        let ndc = DVec2::new(x, y) / self.size.as_dvec2();
        let (x, y) = (2.0 * ndc.x - 1.0, 1.0 - 2.0 * ndc.y);
        let near = world_from_clip.project_point3(DVec3::new(x, y, 1.0));
        let beyond = world_from_clip.project_point3(DVec3::new(x, y, 0.5));
        (near, (beyond - near).normalize())
    }
}

/// What a ray through the picture found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Where (world space, meters).
    pub point: DVec3,
    /// Normal of the side that is seen.
    pub normal: DVec3,
    /// The triangle.
    pub triangle: u32,
    /// Whether the side seen faces the sun and shows its light.
    pub faces_sun: bool,
    /// Whether nothing stands between it and the sun.
    pub lit: bool,
}

/// Rays through a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rays {
    /// So many each way.
    pub across: u32,
    /// Also where the centers of the pixels around agree: what is finer than pixels may lie between.
    pub everywhere: bool,
}

impl Rays {
    /// Where they are likely to make a difference.
    pub fn at_edges(across: u32) -> Self {
        Self {
            across,
            everywhere: false,
        }
    }
}

/// A scene, ready for rays.
pub struct Tracer {
    geometry: Geometry,
    bvh: Bvh2,
}

impl Tracer {
    /// Sorts the triangles.
    pub fn new(geometry: Geometry) -> Self {
        let boxes: Vec<Aabb> = geometry.triangles.iter().map(padded_box).collect();
        let bvh = build_bvh2(
            &boxes,
            BvhBuildParams::medium_build(),
            &mut core::time::Duration::default(),
        );
        ComputeTaskPool::get_or_init(TaskPool::default);
        Self { geometry, bvh }
    }

    /// What is seen at every pixel's center, row by row, and whether the sun shines there.
    /// `to_sun` is a unit vector in world space.
    pub fn picture(&self, lens: &Lens, to_sun: DVec3) -> Vec<Option<Sample>> {
        let [width, height] = lens.size.to_array().map(|side| side as usize);
        let world_from_clip = lens.clip_from_world.inverse();
        let mut samples = vec![None; width * height];
        samples.par_chunk_map_mut(ComputeTaskPool::get(), width, |y, row| {
            for (x, sample) in row.iter_mut().enumerate() {
                let at = [x as f64 + 0.5, y as f64 + 0.5];
                *sample = self.sample(lens, &world_from_clip, at, to_sun);
            }
        });
        samples
    }

    /// What is seen at some pixels' centers, as [`Tracer::picture`] has it.
    pub fn pixels(&self, lens: &Lens, to_sun: DVec3, pixels: &[usize]) -> Vec<Option<Sample>> {
        let world_from_clip = lens.clip_from_world.inverse();
        let width = lens.size.x as usize;
        let sample = |pixel: &usize| {
            let at = [pixel % width, pixel / width].map(|side| side as f64 + 0.5);
            self.sample(lens, &world_from_clip, at, to_sun)
        };
        pixels.iter().map(sample).collect()
    }

    /// By pixel, every so many both ways, what its center shows of what faces the sun.
    pub fn every(&self, lens: &Lens, to_sun: DVec3, stride: usize) -> Vec<(usize, Sample)> {
        let [width, height] = lens.size.to_array().map(|side| side as usize);
        let world_from_clip = lens.clip_from_world.inverse();
        let rows: Vec<usize> = (stride / 2..height).step_by(stride).collect();
        let points = rows.par_chunk_map(ComputeTaskPool::get(), 8, |_, rows| {
            let pixels = rows
                .iter()
                .flat_map(|y| (stride / 2..width).step_by(stride).map(move |x| (x, *y)));
            let point = |(x, y): (usize, usize)| {
                let at = [x as f64 + 0.5, y as f64 + 0.5];
                let sample = self.sample(lens, &world_from_clip, at, to_sun)?;
                sample.faces_sun.then_some((y * width + x, sample))
            };
            pixels.filter_map(point).collect::<Vec<_>>()
        });
        points.into_iter().flatten().collect()
    }

    /// Whether a sample faces all of these suns, and its truth is the same under each.
    pub fn is_same_under(&self, sample: &Sample, suns: &[DVec3]) -> bool {
        suns.iter().all(|to_sun| {
            sample.normal.dot(*to_sun) > 0.0 && self.is_lit(sample, *to_sun) == sample.lit
        })
    }

    /// Whether all of these pixels' centers show the surface of a sample, under the same light.
    pub fn agree(&self, lens: &Lens, pixels: [usize; 4], surface: &Sample, to_sun: DVec3) -> bool {
        let world_from_clip = lens.clip_from_world.inverse();
        let width = lens.size.x as usize;
        pixels.into_iter().all(|pixel| {
            let at = [pixel % width, pixel / width].map(|side| side as f64 + 0.5);
            let sample = self.sample(lens, &world_from_clip, at, to_sun);
            sample.is_some_and(|it| it.lit == surface.lit && lens.same_surface(surface, &it))
        })
    }

    /// The share of each pixel that the sun shines on, of what belongs to the surface at the
    /// pixel's center and faces the sun; by so many rays wherever the centers of the pixels
    /// around do not agree. `None` where the center does not face the sun.
    pub fn shares(
        &self,
        lens: &Lens,
        to_sun: DVec3,
        centers: &[Option<Sample>],
        Rays { across, everywhere }: Rays,
    ) -> Vec<Option<f32>> {
        let [width, height] = lens.size.to_array().map(|side| side as usize);
        let world_from_clip = lens.clip_from_world.inverse();
        let kind = |x: usize, y: usize| {
            centers[y * width + x].map(|sample| (sample.faces_sun, sample.lit))
        };
        let mut shares = vec![None; width * height];
        shares.par_chunk_map_mut(ComputeTaskPool::get(), width, |y, row| {
            for (x, share) in row.iter_mut().enumerate() {
                let Some(center) = centers[y * width + x].filter(|sample| sample.faces_sun) else {
                    continue;
                };
                let around = |v: usize, end: usize| v.saturating_sub(1)..(v + 2).min(end);
                let agree =
                    around(y, height).all(|j| around(x, width).all(|i| kind(i, j) == kind(x, y)));
                *share = Some(f32::from(u8::from(center.lit)));
                if agree && !everywhere {
                    continue;
                }
                let (mut lit, mut all) = (0, 0);
                for step in 0..across * across {
                    let place = |corner: usize, step: u32| {
                        corner as f64 + (f64::from(step) + 0.5) / f64::from(across)
                    };
                    let at = [place(x, step % across), place(y, step / across)];
                    let sample = self
                        .sample(lens, &world_from_clip, at, to_sun)
                        .filter(|sample| sample.faces_sun && lens.same_surface(&center, sample));
                    if let Some(sample) = sample {
                        all += 1;
                        lit += u32::from(sample.lit);
                    }
                }
                if all > 0 {
                    *share = Some(lit as f32 / all as f32);
                }
            }
        });
        shares
    }

    fn sample(
        &self,
        lens: &Lens,
        world_from_clip: &DMat4,
        [x, y]: [f64; 2],
        to_sun: DVec3,
    ) -> Option<Sample> {
        let (start, direction) = lens.ray(world_from_clip, x, y);
        let (triangle, distance) = self.first_hit(start, direction)?;
        let mut normal = self.normal(triangle);
        if normal.dot(direction) > 0.0 {
            normal = -normal;
        }
        let mut sample = Sample {
            point: start + distance * direction,
            normal,
            triangle,
            faces_sun: self.geometry.surface(triangle).receives && normal.dot(to_sun) > 0.0,
            lit: false,
        };
        sample.lit = sample.faces_sun && self.is_lit(&sample, to_sun);
        Some(sample)
    }

    /// Whether nothing stands between a sample and the sun.
    pub fn is_lit(&self, sample: &Sample, to_sun: DVec3) -> bool {
        let lift = LIFT * sample.point.abs().max_element().max(1.0);
        let start = sample.point + sample.normal * lift;
        let ray = Ray::new_inf(start.as_vec3a(), to_sun.as_vec3a());
        self.bvh.ray_traverse_miss(ray, |_, id| {
            let triangle = self.bvh.primitive_indices[id];
            let blocks = triangle != sample.triangle
                && self.geometry.surface(triangle).casts
                // Casters are drawn as seen from the sun.
                && self.is_drawn(triangle, -to_sun)
                && self.intersect(triangle, start, to_sun).is_some();
            if blocks { 0.0 } else { f32::INFINITY }
        })
    }

    /// Of a smooth-shaded mesh, where its shading normal faces the sun: the cosine of the angle between
    /// the two, and whether the sun shines on the surface that the vertices' normals describe.
    ///
    /// That lies where the corners' tangent planes do, on average by the point's weights, or on the
    /// triangle where those lie below it (Hanika 2021, *Hacking the shadow terminator*).
    pub fn smooth_light(&self, sample: &Sample, to_sun: DVec3) -> Option<(f64, bool)> {
        let triangle = sample.triangle as usize;
        let corners = self.geometry.triangles[triangle].map(Vec3::as_dvec3);
        let normals = self.geometry.normals.get(triangle)?;
        let normals = normals.map(|normal| normal.as_dvec3().normalize_or_zero());
        let weights = weights(corners, sample.point);
        let shading = (0..3).map(|i| weights[i] * normals[i]).sum::<DVec3>();
        let shading = shading.try_normalize()?;
        let cosine = shading.dot(to_sun);
        let is_smooth = normals
            .iter()
            .any(|normal| normal.dot(sample.normal) < 0.9999);
        if !is_smooth || cosine <= 0.0 || !self.geometry.surface(sample.triangle).receives {
            return None;
        }
        let lifted = |i: usize| {
            let above = (sample.point - corners[i]).dot(normals[i]);
            weights[i] * (sample.point - above.min(0.0) * normals[i])
        };
        let on_smooth = Sample {
            point: (0..3).map(lifted).sum(),
            normal: shading,
            ..*sample
        };
        Some((cosine, self.is_lit(&on_smooth, to_sun)))
    }

    /// How far above a point the caster nearest to the sun lies, on the line towards the sun
    /// (meters); negative below it. `None` without any.
    pub fn caster_height(&self, point: DVec3, to_sun: DVec3) -> Option<f64> {
        /// Higher than anything (meters).
        const TOP: f64 = 5000.0;
        let casts = |triangle| self.geometry.surface(triangle).casts;
        let hit = self.first_of(point + TOP * to_sun, -to_sun, casts)?;
        Some(TOP - hit.1)
    }

    fn first_hit(&self, start: DVec3, direction: DVec3) -> Option<(u32, f64)> {
        self.first_of(start, direction, |_| true)
    }

    fn first_of(
        &self,
        start: DVec3,
        direction: DVec3,
        counts: impl Fn(u32) -> bool,
    ) -> Option<(u32, f64)> {
        let ray = Ray::new_inf(start.as_vec3a(), direction.as_vec3a());
        let mut nearest: Option<(u32, f64)> = None;
        self.bvh.ray_traverse(ray, &mut RayHit::none(), |_, id| {
            let triangle = self.bvh.primitive_indices[id];
            let drawn = counts(triangle) && self.is_drawn(triangle, direction);
            match self.intersect(triangle, start, direction).filter(|_| drawn) {
                Some(distance) => {
                    if nearest.is_none_or(|(_, least)| distance < least) {
                        nearest = Some((triangle, distance));
                    }
                    // Rounded up, that nothing nearer is skipped.
                    (distance as f32).next_up()
                }
                None => f32::INFINITY,
            }
        });
        nearest
    }

    fn normal(&self, triangle: u32) -> DVec3 {
        let [a, b, c] = self.geometry.triangles[triangle as usize].map(Vec3::as_dvec3);
        (b - a).cross(c - a).normalize_or_zero()
    }

    /// Whether the side that a ray in this direction meets is drawn at all.
    fn is_drawn(&self, triangle: u32, direction: DVec3) -> bool {
        let is_back = || self.normal(triangle).dot(direction) > 0.0;
        match self.geometry.surface(triangle).culled {
            Some(Face::Back) => !is_back(),
            Some(Face::Front) => is_back(),
            None => true,
        }
    }

    /// Distance to a triangle along a ray (Möller and Trumbore 1997), if it is hit where it is
    /// solid.
    fn intersect(&self, triangle: u32, start: DVec3, direction: DVec3) -> Option<f64> {
        let [a, b, c] = self.geometry.triangles[triangle as usize].map(Vec3::as_dvec3);
        let (ab, ac) = (b - a, c - a);
        let p = direction.cross(ac);
        let det = ab.dot(p);
        let from_a = start - a;
        let u = from_a.dot(p) / det;
        let q = from_a.cross(ab);
        let v = direction.dot(q) / det;
        let distance = ac.dot(q) / det;
        let hit = u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance > 0.0;
        let weights = DVec2::new(u, v).as_vec2();
        (hit && self.geometry.is_solid(triangle, weights)).then_some(distance)
    }
}

/// Weights of a triangle's corners at a point of it.
fn weights([a, b, c]: [DVec3; 3], point: DVec3) -> [f64; 3] {
    let whole = (b - a).cross(c - a);
    let share = |from: DVec3, to: DVec3| {
        (from - point).cross(to - point).dot(whole) / whole.length_squared()
    };
    [share(b, c), share(c, a), share(a, b)]
}

fn padded_box(corners: &[Vec3; 3]) -> Aabb {
    let [a, b, c] = corners;
    let (least, most) = (a.min(*b).min(*c), a.max(*b).max(*c));
    let padding = PADDING * least.abs().max(most.abs()).max_element().max(1.0);
    Aabb {
        min: (least - padding).into(),
        max: (most + padding).into(),
    }
}
