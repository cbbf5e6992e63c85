//! Far from the world's origin, where `f32` is coarse: edges of shadows are off by what positions are and
//! by what lookups are, and a world that is moved back shows no sign of it.

use bevy::prelude::*;
use bevy_pssm::prelude::*;
use image::{RgbaImage, imageops::crop_imm};

use crate::{
    compare::{assert_identical, save, share_differing},
    stage::{Stage, shadows},
};

/// 10, 50 and 100 km, in steps of 1024 m. The eye and all that stands there is at halves of a meter, which
/// `f32` has at all of these: only vertices are rounded, at the last to steps of 4 mm along x and 8 mm along z.
const OFFSETS: [Vec3; 3] = [
    Vec3::new(6144.0, 0.0, -8192.0),
    Vec3::new(30_720.0, 0.0, -40_960.0),
    Vec3::new(61_440.0, 0.0, -81_920.0),
];
/// Where the walk begins.
const AWAY: Vec3 = Vec3::new(4096.0, 0.0, 0.0);
/// Of the walk; the world is moved after half of them.
const FRAMES: usize = 16;
const FITS: [CascadeFit; 2] = [CascadeFit::Stable, CascadeFit::Steady];
/// Brightness between lit and dark ground is some 90 levels: more than this is a difference, and an edge.
const LEVELS: u8 = 12;
/// The most that lookups are off by (share of the distance from the origin): `docs/range.md`.
const LOOKUPS: f64 = 6e-7;
/// Of the nearest ground in the picture: 290 to a radian, 8 m from the eye.
const PIXELS_PER_METER: f64 = 37.0;
/// Lookups and the nearest ground come to so many pixels at most; of the edges, this share for each of them
/// may differ, as most lookups are off by less and most edges are farther away. Half of it was seen.
const SHARE: f64 = 0.02;
/// So many of the edges must still be there.
const SHARPNESS: f64 = 0.98;

/// Moves the world, but for the sun.
fn shift(stage: &mut Stage, by: Vec3) {
    type IsMoved = (Without<ChildOf>, Without<DirectionalLight>);
    let mut roots = stage.world().query_filtered::<&mut Transform, IsMoved>();
    for mut root in roots.iter_mut(stage.world()) {
        root.translation += by;
    }
}

/// Gives the sun shadows of this fit, or none.
fn cast(stage: &mut Stage, sun: Entity, fit: Option<&CascadeFit>) {
    let mut sun = stage.world().entity_mut(sun);
    if let Some(fit) = fit.cloned() {
        sun.insert(ParallelSplitShadows { fit, ..shadows() });
    }
    let mut light = sun.get_mut::<DirectionalLight>().expect("a light");
    light.shadow_maps_enabled = fit.is_some();
}

/// Pixels that differ from their neighbors, as a share of all.
fn edges(picture: &RgbaImage) -> f64 {
    let (width, height) = (picture.width() - 1, picture.height() - 1);
    let from = |x, y| crop_imm(picture, x, y, width, height).to_image();
    share_differing(&from(0, 0), &from(1, 1), LEVELS)
}

#[expect(clippy::print_stderr, reason = "figures for who sets the bounds")]
fn report(figures: &str) {
    eprint!("{figures}");
}

/// Compares pictures near to the origin and so far from it, with shadows and without. Figures that are too
/// high, or nothing.
fn judge(name: &str, distance: f32, shadowed: [&RgbaImage; 2], bare: [&RgbaImage; 2]) -> String {
    save(name, shadowed[0], shadowed[1]);
    let in_shadow = share_differing(shadowed[0], bare[0], LEVELS);
    assert!(
        in_shadow > 0.01,
        "{name}: hardly any shadow ({in_shadow:.4})"
    );
    let [found, found_bare] = [shadowed, bare].map(|[a, b]| share_differing(a, b, LEVELS));
    let [near, far] = shadowed.map(edges);
    // What vertices' positions cost, by the edges of things: those of shadows are as far off.
    let positions = found_bare / edges(bare[0]);
    let lookups = SHARE * PIXELS_PER_METER * LOOKUPS * f64::from(distance);
    let most = (positions + lookups) * near;
    let figures = format!(
        "{name}: {found:.5} differ, at most {most:.5} may: {positions:.4} of the edges for positions and \
         {lookups:.4} for lookups; {found_bare:.5} without shadows; edges {near:.5}, then {far:.5}\n"
    );
    report(&figures);
    if found <= most && far >= SHARPNESS * near {
        String::new()
    } else {
        figures
    }
}

#[test]
fn shadows_are_as_sharp_far_from_the_origin() {
    let mut stage = Stage::new();
    let sun = stage.sun();
    stage.camera();
    let mut near_and_far = |fit: Option<&CascadeFit>, offset: Vec3| {
        cast(&mut stage, sun, fit);
        // Texel grids lie over the scene as they do far away, where the world's origin anchors them.
        let origin = ShadowGridOrigin(-offset.as_dvec3());
        stage.world().insert_resource(origin);
        let near = stage.picture();
        shift(&mut stage, offset);
        stage.world().insert_resource(ShadowGridOrigin::default());
        let far = stage.picture();
        shift(&mut stage, -offset);
        [near, far]
    };
    let mut failures = String::new();
    for offset in OFFSETS {
        let distance = offset.length();
        let bare = near_and_far(None, offset);
        for fit in FITS.into_iter().chain([CascadeFit::Tight]) {
            let name = format!("far_{fit:?}_{distance}");
            let shadowed = near_and_far(Some(&fit), offset);
            failures += &judge(&name, distance, shadowed.each_ref(), bare.each_ref());
        }
    }
    assert!(failures.is_empty(), "{failures}");
}

/// A walk far from the origin, on which the world is moved back to it, grids and all, or is not.
fn walk(fit: Option<&CascadeFit>, is_moved: bool) -> Vec<RgbaImage> {
    let mut stage = Stage::new();
    let sun = stage.sun();
    let camera = stage.camera();
    cast(&mut stage, sun, fit);
    shift(&mut stage, AWAY);
    stage.headless.settle();
    let step = |frame: usize| {
        let mut view = stage
            .world()
            .get_mut::<Transform>(camera)
            .expect("a camera");
        // Steps that `f32` has exactly.
        view.translation.z -= 0.125;
        view.rotate_y(0.01);
        if is_moved && frame == FRAMES / 2 {
            shift(&mut stage, -AWAY);
            stage.world().resource_mut::<ShadowGridOrigin>().0 -= AWAY.as_dvec3();
        }
        stage.step();
        stage.last_picture()
    };
    (0..FRAMES).map(step).collect()
}

#[test]
fn a_floating_origin_moves_no_shadow() {
    let mut failures = String::new();
    let bare = [true, false].map(|is_moved| walk(None, is_moved));
    for fit in FITS {
        let shadowed = [true, false].map(|is_moved| walk(Some(&fit), is_moved));
        for frame in 0..FRAMES {
            let name = format!("moved_{fit:?}_{frame}");
            let [shadowed, bare] = [&shadowed, &bare].map(|it| it.each_ref().map(|it| &it[frame]));
            if frame < FRAMES / 2 {
                assert_identical(&name, shadowed[0], shadowed[1]);
            } else {
                failures += &judge(&name, AWAY.length(), shadowed, bare);
            }
        }
    }
    assert!(failures.is_empty(), "{failures}");
}
