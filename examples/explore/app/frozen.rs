//! What a camera's cascades were at one moment, drawn into the scene: their slices, their maps and
//! where casters matter to them.

use bevy::{
    camera::visibility::RenderLayers,
    light::{
        CascadeShadowConfig,
        cascade::{Cascade, Cascades},
    },
    math::{DMat4, DVec3, DVec4},
    prelude::*,
};
use bevy_pssm::{
    PssmSystems, ShadowPlans,
    geometry::{
        body::ConvexBody,
        face::Wedge,
        half_space::HalfSpace,
        slice::{Slice, ViewVolume},
    },
    plan::CascadePlan,
    systems::view_volume,
};

use super::sides::{Compare, LINES_LAYER, Side, SideCamera, SideSun};

/// As the plugin's overlays have them: red, green, blue and yellow.
const COLORS: [LinearRgba; 4] = [
    LinearRgba::rgb(1.0, 0.35, 0.3),
    LinearRgba::rgb(0.4, 1.0, 0.4),
    LinearRgba::rgb(0.35, 0.5, 1.0),
    LinearRgba::rgb(1.0, 0.9, 0.3),
];
/// Of hulls, which have no end towards the light, so much is drawn (radii of the slice).
const SHOWN_HULL: f64 = 1.0;
/// What of a hull is farther from its slice is not drawn (radii of the slice).
const FARTHEST: f64 = 16.0;

/// Draws what is [`Frozen`].
pub struct FrozenPlugin;

/// The cascades of the edited side as they were when they were frozen.
#[derive(Resource, Debug, Default)]
pub struct Frozen {
    /// They are drawn.
    pub on: bool,
    /// All that shows them; none before there is anything to show.
    kept: Option<Vec<Line>>,
}

/// An edge of something, in world space.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Line {
    ends: [Vec3; 2],
    color: LinearRgba,
}

/// What is drawn into both sides' pictures.
#[derive(Default, Reflect, GizmoConfigGroup)]
#[reflect(Default)]
struct FrozenLines;

impl Plugin for FrozenPlugin {
    fn build(&self, app: &mut App) {
        let config = GizmoConfig {
            line: GizmoLineConfig {
                width: 2.0,
                ..default()
            },
            // In front of what they lie on.
            depth_bias: -0.01,
            render_layers: RenderLayers::layer(LINES_LAYER),
            ..default()
        };
        app.insert_gizmo_config(FrozenLines, config)
            .init_resource::<Frozen>()
            .add_systems(
                PostUpdate,
                (freeze, draw_frozen)
                    .chain()
                    .after(PssmSystems::CullCasters),
            );
    }
}

/// Keeps what the edited side's camera sees, and its cascades, when that is first asked for.
fn freeze(
    mut frozen: ResMut<Frozen>,
    compare: Res<Compare>,
    new: Query<(), Added<SideSun>>,
    cameras: Query<(Entity, &SideCamera, &Camera, &GlobalTransform, &Projection)>,
    suns: Query<(
        &SideSun,
        Option<&ShadowPlans>,
        &CascadeShadowConfig,
        &Cascades,
    )>,
) {
    if !frozen.on || !new.is_empty() {
        if frozen.kept.is_some() {
            frozen.kept = None;
        }
        return;
    }
    if frozen.kept.is_some() {
        return;
    }
    let side = compare.edited;
    let camera = cameras.iter().find(|(_, it, ..)| it.0 == side);
    let sun = suns.iter().find(|(it, ..)| it.0 == side);
    let (Some((entity, _, camera, transform, projection)), Some((_, plans, config, built_in))) =
        (camera, sun)
    else {
        return;
    };
    let Some(view) = view_volume(transform, projection, camera) else {
        return;
    };
    let planned = plans.and_then(|plans| plans.views.get(&entity));
    let parts: Vec<Part> = match planned {
        Some(plans) if !plans.is_empty() => plans.iter().map(Part::of_plan).collect(),
        _ => {
            let cascades = built_in.cascades.get(&entity);
            parts_of_built_in(config, cascades.map(Vec::as_slice).unwrap_or_default())
        }
    };
    if !parts.is_empty() {
        frozen.kept = Some(lines_of(&view, &parts));
    }
}

fn draw_frozen(frozen: Res<Frozen>, mut gizmos: Gizmos<FrozenLines>) {
    for line in frozen.kept.iter().flatten() {
        let [a, b] = line.ends;
        gizmos.line(a, b, line.color);
    }
}

/// What there is to draw of a cascade.
struct Part {
    near: f64,
    far: f64,
    wedge: Option<Wedge>,
    map: Option<PartMap>,
}

struct PartMap {
    clip_from_world: DMat4,
    /// A unit vector.
    to_light: DVec3,
    /// Where casters matter; none if that is not known.
    hull: Vec<HalfSpace>,
}

impl Part {
    fn of_plan(plan: &CascadePlan) -> Self {
        let map = plan.map.as_ref().map(|map| PartMap {
            clip_from_world: map.clip_from_world,
            to_light: map.world_from_cascade.z_axis.truncate().normalize_or_zero(),
            hull: map.hull.planes.clone(),
        });
        Self {
            near: plan.near,
            far: plan.far,
            wedge: plan.wedge,
            map,
        }
    }
}

/// Bevy's cascades, each with a box around its slice.
fn parts_of_built_in(config: &CascadeShadowConfig, cascades: &[Cascade]) -> Vec<Part> {
    let overlap = 1.0 - config.overlap_proportion;
    let begins = config.bounds.iter().map(|bound| bound * overlap);
    let begins = [config.minimum_distance].into_iter().chain(begins);
    let slices = begins.zip(&config.bounds).zip(cascades);
    slices
        .map(|((near, far), cascade)| {
            let to_light = cascade.world_from_cascade.z_axis.truncate().as_dvec3();
            Part {
                near: f64::from(near),
                far: f64::from(*far),
                wedge: None,
                map: Some(PartMap {
                    clip_from_world: cascade.clip_from_world.as_dmat4(),
                    to_light: to_light.normalize_or_zero(),
                    hull: Vec::new(),
                }),
            }
        })
        .collect()
}

/// Slices are as bright as can be, hulls dark and maps pale.
fn lines_of(view: &ViewVolume, parts: &[Part]) -> Vec<Line> {
    let mut lines = Vec::new();
    for (part, color) in parts.iter().zip(COLORS.into_iter().cycle()) {
        let Some(slice) = view.slice(part.near, part.far) else {
            continue;
        };
        let wedge = part.wedge.iter().flat_map(|wedge| wedge.planes);
        let seen = ConvexBody::of_slice(&slice).within(wedge);
        push_lines(&mut lines, edges_of(&seen), color);
        if let Some(map) = &part.map {
            let pale = color.mix(&LinearRgba::WHITE, 0.6);
            push_lines(&mut lines, map.edges(), pale);
            let dark = color.mix(&LinearRgba::BLACK, 0.6);
            push_lines(&mut lines, edges_of(&map.hull(&slice)), dark);
        }
    }
    lines
}

fn push_lines(lines: &mut Vec<Line>, edges: Vec<[DVec3; 2]>, color: LinearRgba) {
    let ends = edges
        .into_iter()
        .map(|edge| edge.map(|end: DVec3| end.as_vec3()));
    let ends = ends.filter(|ends| ends.iter().all(|end| end.is_finite()));
    lines.extend(ends.map(|ends| Line { ends, color }));
}

/// Each edge once, though two faces share it.
fn edges_of(body: &ConvexBody) -> Vec<[DVec3; 2]> {
    let mut edges: Vec<[usize; 2]> = body
        .faces()
        .flat_map(|face| {
            let after = face.iter().cycle().skip(1);
            face.iter().zip(after).map(|(a, b)| [*a.min(b), *a.max(b)])
        })
        .collect();
    edges.sort_unstable();
    edges.dedup();
    let ends = |edge: [usize; 2]| edge.map(|corner| body.corners[corner]);
    edges.into_iter().map(ends).collect()
}

impl PartMap {
    /// Of all that the map can hold: a box, or where it is warped a frustum, of which edges that go through its
    /// center of projection are left out.
    fn edges(&self) -> Vec<[DVec3; 2]> {
        let world_from_clip = self.clip_from_world.inverse();
        let corner = |index: usize| {
            let end = |bit: usize| f64::from(u8::from(index & bit != 0));
            let (x, y, z) = (end(1), end(2), end(4));
            let point = world_from_clip * DVec4::new(2.0 * x - 1.0, 2.0 * y - 1.0, z, 1.0);
            (point.w > 0.0).then(|| point.truncate() / point.w)
        };
        let all = (0..8).flat_map(|a| [1, 2, 4].map(|bit| (a, a | bit)));
        all.filter(|(a, b)| a != b)
            .filter_map(|(a, b)| Some([corner(a)?, corner(b)?]))
            .collect()
    }

    /// As much of the hull as is drawn; nothing where there is none.
    fn hull(&self, slice: &Slice) -> ConvexBody {
        if self.hull.is_empty() {
            return ConvexBody::default();
        }
        let beyond = |corner: &DVec3| self.to_light.dot(*corner);
        let nearest = slice.corners.iter().map(beyond);
        let nearest = nearest.fold(f64::NEG_INFINITY, f64::max);
        let end = HalfSpace {
            normal: self.to_light,
            distance: nearest + SHOWN_HULL * slice.radius,
        };
        let around = DVec3::splat(FARTHEST * slice.radius);
        let all = ConvexBody::of_box(slice.center - around, slice.center + around);
        all.within(self.hull.iter().copied().chain([end]))
    }
}
