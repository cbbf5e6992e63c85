//! The view volume and the slices that split planes cut from it.

use glam::{DAffine3, DMat3, DVec2, DVec3, Mat4, Vec4};

use super::half_space::HalfSpace;

/// What a camera sees, as needed to cut slices: a frame and a cross-section that is affine in
/// depth. That covers perspective, orthographic, off-center and custom projections alike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewVolume {
    /// The eye, in world space (meters).
    pub eye: DVec3,
    /// Camera axes in world space: right, up, and back (the camera looks along `-z_axis`).
    /// Not normalized: a scaled camera sees a scaled volume.
    pub axes: DMat3,
    /// Lower corner of the cross-section, at depth zero and its growth per meter of depth.
    pub min: [DVec2; 2],
    /// Upper corner of the cross-section, at depth zero and its growth per meter of depth.
    pub max: [DVec2; 2],
    /// Depth of the camera's near plane (meters; may be negative for orthographic cameras).
    pub near: f64,
    /// Depth beyond which nothing is drawn (meters). Infinite for perspective cameras: Bevy's
    /// have no far plane on the GPU, and none when it decides what is visible.
    pub far: f64,
}

/// Camera scales are rounded to such shares of a power of two: the length of a rotation's columns in
/// `f32` varies in its last digits from frame to frame, and a map's size must not.
const SCALE_STEP: f64 = 1.0 / 4096.0;

/// Views whose axes differ by more, as a share, do not look the same way.
const MOST_TURNED: f64 = 1e-4;

/// Eyes that are farther before each other, as a share of what they are beside each other, see other depths.
const MOST_AHEAD: f64 = 0.01;

/// What lies between two eyes is rounded to such shares of it.
const ASIDE_STEP: f64 = 1.0 / 32.0;

impl ViewVolume {
    /// Reads the volume off a camera's transform and projection.
    ///
    /// `clip_from_view` is Bevy's: right-handed, looking along −z, NDC z in [0, 1] with 1 near.
    /// Returns `None` when either matrix is degenerate or not finite, or the planes are not in
    /// order.
    pub fn new(world_from_view: DAffine3, clip_from_view: &Mat4) -> Option<Self> {
        let m = clip_from_view;
        let (near, far) = (near_plane(m), far_plane(m));
        let [min, max] = sides(m)?;
        let volume = Self {
            eye: world_from_view.translation,
            axes: world_from_view.matrix3,
            min,
            max,
            near,
            far,
        };
        let axes = volume.axes;
        let cube = axes.x_axis.length() * axes.y_axis.length() * axes.z_axis.length();
        // Of axes that are no more than nearly parallel, whatever the camera's scale.
        let is_regular = world_from_view.is_finite() && axes.determinant().abs() > 1e-12 * cube;
        (is_regular && near.is_finite() && far > near).then_some(volume)
    }

    /// A volume, before the same eye, that holds another one too: one that looks the same way from beside
    /// it, so that both know points by the same depths. `None` for others.
    pub fn around(&self, other: &Self) -> Option<Self> {
        let offset = self.axes.inverse() * (other.eye - self.eye);
        let (aside, ahead) = (offset.truncate(), offset.z.abs());
        let turned = |axis: fn(&DMat3) -> DVec3| {
            let (one, two) = (axis(&self.axes), axis(&other.axes));
            one.distance(two) > MOST_TURNED * one.length()
        };
        let is_turned = turned(|it| it.x_axis) || turned(|it| it.y_axis) || turned(|it| it.z_axis);
        let is_ahead = ahead > MOST_AHEAD * aside.length() + f64::from(f32::EPSILON);
        if is_turned || is_ahead || self.is_perspective() != other.is_perspective() {
            return None;
        }
        // In steps, for positions are rounded from frame to frame.
        let step = ASIDE_STEP * aside.abs().max_element().log2().ceil().exp2();
        let aside = [(aside / step).floor() * step, (aside / step).ceil() * step];
        let [lower, upper] = aside.map(|it| if step > 0.0 { it } else { DVec2::ZERO });
        let nearest = self.nearest().min(other.nearest());
        // Sides that open no less than both, from where both are inside.
        let side = |one: [DVec2; 2], two: [DVec2; 2], most: fn(DVec2, DVec2) -> DVec2| {
            let growth = most(one[1], two[1]);
            let at_nearest = |[at_eye, growth]: [DVec2; 2]| at_eye + nearest * growth;
            [
                most(at_nearest(one), at_nearest(two)) - nearest * growth,
                growth,
            ]
        };
        Some(Self {
            min: side(self.min, [other.min[0] + lower, other.min[1]], DVec2::min),
            max: side(self.max, [other.max[0] + upper, other.max[1]], DVec2::max),
            near: self.near.min(other.near),
            far: self.far.max(other.far),
            ..*self
        })
    }

    /// The part of the volume between two depths, cut to the camera's own near and far planes
    /// and, in perspective, to what lies before the eye. `None` if nothing is left.
    pub fn slice(&self, near: f64, far: f64) -> Option<Slice> {
        let (near, far) = (near.max(self.nearest()), far.min(self.far));
        (near < far).then(|| Slice::new(self, near, far))
    }

    /// Depth before which nothing is seen (meters): in perspective never behind the eye, where an
    /// orthographic camera may see.
    pub fn nearest(&self) -> f64 {
        if self.is_perspective() {
            self.near.max(0.0)
        } else {
            self.near
        }
    }

    /// The unit vector along which the camera looks, in world space. `None` if it has no axes.
    pub fn forward(&self) -> Option<DVec3> {
        (-self.axes.z_axis).try_normalize()
    }

    /// Whether what is farther looks smaller.
    pub fn is_perspective(&self) -> bool {
        self.max[1].y > self.min[1].y
    }

    /// The vector, in world space, whose product with a point, from the eye, is the point's depth.
    pub fn per_depth(&self) -> DVec3 {
        -self.axes.inverse().row(2)
    }

    /// Depth of a point in world space (meters before the eye).
    pub fn depth_of(&self, point: DVec3) -> f64 {
        Depth::new(self).of(point)
    }

    /// Height of the image at a depth (meters).
    pub fn image_height(&self, depth: f64) -> f64 {
        let height = self.max[0].y - self.min[0].y + depth * (self.max[1].y - self.min[1].y);
        height * self.axes.y_axis.length()
    }

    fn corners_at(&self, depth: f64) -> [DVec3; 4] {
        let (lo, hi) = (
            self.min[0] + depth * self.min[1],
            self.max[0] + depth * self.max[1],
        );
        [
            DVec3::new(lo.x, lo.y, -depth),
            DVec3::new(hi.x, lo.y, -depth),
            DVec3::new(hi.x, hi.y, -depth),
            DVec3::new(lo.x, hi.y, -depth),
        ]
    }
}

/// How deep points lie before an eye.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Depth {
    eye: DVec3,
    /// A point's depth is its product with this, from the eye.
    pub(super) per_meter: DVec3,
}

impl Depth {
    /// Before a camera's.
    pub fn new(view: &ViewVolume) -> Self {
        Self {
            eye: view.eye,
            per_meter: view.per_depth(),
        }
    }

    /// Everything at most so deep (meters).
    pub fn before(&self, depth: f64) -> HalfSpace {
        let length = self.per_meter.length();
        let normal = self.per_meter / length;
        HalfSpace {
            normal,
            distance: normal.dot(self.eye) + depth / length,
        }
    }

    /// Everything at least so deep (meters).
    pub fn beyond(&self, depth: f64) -> HalfSpace {
        let HalfSpace { normal, distance } = self.before(depth);
        HalfSpace {
            normal: -normal,
            distance: -distance,
        }
    }

    /// Depth of a point in world space (meters before the eye).
    pub fn of(&self, point: DVec3) -> f64 {
        self.per_meter.dot(point - self.eye)
    }
}

/// The depth at which NDC z is 1. An oblique near plane (a mirror's) has no one depth: then the
/// eye's.
fn near_plane(clip_from_view: &Mat4) -> f64 {
    let (z, w) = (clip_from_view.row(2), clip_from_view.row(3));
    if is_oblique(z) {
        return 0.0;
    }
    (f64::from(z.w) - f64::from(w.w)) / (f64::from(z.z) - f64::from(w.z))
}

/// The depth at which NDC z is 0.
fn far_plane(clip_from_view: &Mat4) -> f64 {
    let z = clip_from_view.row(2);
    if is_oblique(z) || z.z == 0.0 {
        return f64::INFINITY;
    }
    f64::from(z.w) / f64::from(z.z)
}

fn is_oblique(z_row: Vec4) -> bool {
    z_row.x != 0.0 || z_row.y != 0.0
}

/// The lower and the upper corner of what is seen, as functions of the depth: values at zero and slopes. Of a
/// picture that is turned, those of a box around it.
fn sides(m: &Mat4) -> Option<[[DVec2; 2]; 2]> {
    let at = |x, y| corner(m, DVec2::new(x, y));
    let ends = [at(-1.0, -1.0)?, at(1.0, 1.0)?];
    let is_turned = m.x_axis.y != 0.0 || m.y_axis.x != 0.0;
    if is_turned {
        let others = [ends[1], at(1.0, -1.0)?, at(-1.0, 1.0)?];
        let side = |most: fn(DVec2, DVec2) -> DVec2| {
            [0, 1].map(|term| {
                others
                    .iter()
                    .fold(ends[0][term], |end, it| most(end, it[term]))
            })
        };
        return Some([side(DVec2::min), side(DVec2::max)]);
    }
    // Of mirrored projections the other one is the lower.
    let [one, other] = ends.map(|[at_eye, per_depth]| at_eye + per_depth);
    let is_lower = one.cmple(other);
    Some(
        [is_lower, !is_lower]
            .map(|first| [0, 1].map(|term| DVec2::select(first, ends[0][term], ends[1][term]))),
    )
}

/// Solves `row · (x, y, -d, 1) = ndc · (w_row · (0, 0, -d, 1))` in both rows for `x` and `y` as functions of the
/// depth `d`: values at zero and slopes.
fn corner(m: &Mat4, ndc: DVec2) -> Option<[DVec2; 2]> {
    let [x_row, y_row, w_row] = [0, 1, 3].map(|row| m.row(row).as_dvec4());
    let constants = ndc * w_row.w - DVec2::new(x_row.w, y_row.w);
    let slopes = DVec2::new(x_row.z, y_row.z) - ndc * w_row.z;
    let determinant = x_row.x * y_row.y - x_row.y * y_row.x;
    let solved = [constants, slopes].map(|it| {
        if x_row.y == 0.0 && y_row.x == 0.0 {
            return DVec2::new(it.x / x_row.x, it.y / y_row.y);
        }
        let solved = DVec2::new(
            y_row.y * it.x - x_row.y * it.y,
            x_row.x * it.y - y_row.x * it.x,
        );
        solved / determinant
    });
    let is_solved = determinant != 0.0 && solved.iter().all(|it| it.is_finite());
    is_solved.then_some(solved)
}

/// A convex piece of a view volume between two depths.
#[derive(Debug, Clone, PartialEq)]
pub struct Slice {
    /// Corners in world space: four at the near depth, then four at the far depth, both starting
    /// at the lower left and going round the same way.
    pub corners: [DVec3; 8],
    /// Center of a bounding sphere, in world space.
    pub center: DVec3,
    /// Radius of that sphere (meters). It depends on the projection and the two depths only,
    /// not on where the camera is or looks: bit for bit the same from frame to frame.
    pub radius: f64,
}

/// A vertex of the convex body that a map covers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyVertex {
    /// Where it is, in world space.
    pub position: DVec3,
    /// Height that the image has at its depth (meters).
    pub image_height: f64,
}

impl Slice {
    /// Its corners as the view that it was cut from sees them.
    pub fn vertices(&self) -> [BodyVertex; 8] {
        core::array::from_fn(|corner| BodyVertex {
            position: self.corners[corner],
            image_height: self.image_height(corner),
        })
    }

    /// Height of the image at the depth of a corner (meters).
    pub fn image_height(&self, corner: usize) -> f64 {
        let quad = corner / 4 * 4;
        self.corners[quad].distance(self.corners[quad + 3])
    }

    fn new(view: &ViewVolume, near: f64, far: f64) -> Self {
        let (near_vs, far_vs) = (view.corners_at(near), view.corners_at(far));
        let mut corners_vs = [DVec3::ZERO; 8];
        corners_vs[..4].copy_from_slice(&near_vs);
        corners_vs[4..].copy_from_slice(&far_vs);

        let scale = DVec3::new(
            rounded_length(view.axes.x_axis),
            rounded_length(view.axes.y_axis),
            rounded_length(view.axes.z_axis),
        );
        let (center_vs, radius) = bounding_sphere(&corners_vs, near, far, scale);
        let world = |point_vs: DVec3| view.eye + view.axes * point_vs;
        Self {
            corners: corners_vs.map(world),
            center: world(center_vs),
            radius,
        }
    }
}

fn rounded_length(axis: DVec3) -> f64 {
    let step = SCALE_STEP * axis.length().log2().floor().exp2();
    (axis.length() / step).round() * step
}

/// The sphere on the volume's axis that touches near and far corners, or the far ones only
/// where that is smaller; of least radius for symmetric volumes.
fn bounding_sphere(local: &[DVec3; 8], near: f64, far: f64, scale: DVec3) -> (DVec3, f64) {
    let middle = |quad: &[DVec3]| (quad[0] + quad[2]) * 0.5;
    let (m_near, m_far) = (middle(&local[..4]), middle(&local[4..]));
    let half_diagonal_2 = |quad: &[DVec3]| ((quad[2] - quad[0]) * 0.5 * scale).length_squared();
    let (r_near, r_far) = (half_diagonal_2(&local[..4]), half_diagonal_2(&local[4..]));

    let (a, b) = (near * scale.z, far * scale.z);
    let equidistant = ((b * b + r_far) - (a * a + r_near)) / (2.0 * (b - a));
    let t = ((equidistant.clamp(a, b) - a) / (b - a)).clamp(0.0, 1.0);
    let center = m_near.lerp(m_far, t);
    let radius = local
        .iter()
        .map(|corner| ((*corner - center) * scale).length_squared())
        .fold(0.0, f64::max)
        .sqrt();
    (center, radius)
}
