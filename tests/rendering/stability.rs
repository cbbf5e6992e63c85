//! A static scene under a slow pan: resting shadows do not crawl.

use bevy::{light::ShadowFilteringMethod, prelude::*};
use bevy_pssm::prelude::*;
use image::RgbaImage;

use crate::{
    compare::save,
    stage::{SIZE, Stage, eye, shadows},
};

/// Steps of the pan.
const STEPS: usize = 24;
/// Turn per step (radians): about a pixel.
const TURN: f32 = 0.003;

/// How far a followed point is from every edge (pixels).
const MARGIN: i32 = 2;

/// How ground points fared under a pan.
#[derive(Default, Debug)]
struct Flips {
    /// Points followed over the whole pan.
    followed: usize,
    /// Points that went from clearly lit to clearly dark or back.
    flipped: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Lit,
    Dark,
    Between,
}

impl Side {
    fn is_opposite_of(self, other: Self) -> bool {
        matches!((self, other), (Self::Lit, Self::Dark) | (Self::Dark, Self::Lit))
    }
}

/// Where ground point `point` is in the picture (pixels).
fn pixel_of(camera: &Transform, point: Vec3) -> Option<[f32; 2]> {
    let local = camera.to_matrix().inverse().transform_point3(point);
    let focal = 0.5 * SIZE.y as f32 / core::f32::consts::FRAC_PI_8.tan();
    let x = 0.5 * SIZE.x as f32 + focal * local.x / -local.z;
    let y = 0.5 * SIZE.y as f32 - focal * local.y / -local.z;
    (local.z < 0.0).then_some([x, y])
}

/// Lit ground is brighter than 125, dark ground below 85.
fn side(picture: &RgbaImage, [x, y]: [f32; 2]) -> Option<Side> {
    if x < 0.0 || y < 0.0 || x >= SIZE.x as f32 || y >= SIZE.y as f32 {
        return None;
    }
    Some(match picture.get_pixel(x as u32, y as u32)[0] {
        126.. => Side::Lit,
        0..85 => Side::Dark,
        _ => Side::Between,
    })
}

/// Follows ground points through the pictures of a pan.
///
/// Edges move over the pixel grid, so that pixels on them change their coverage; that is not
/// crawling. The two are told apart by distance: a followed point is at least [`MARGIN`] pixels
/// from every edge in the first picture. If edges rest in the world, it keeps its side.
fn follow(pictures: &[(Transform, RgbaImage)]) -> Flips {
    let mut flips = Flips::default();
    for i in 0..200 {
        for j in 0..200 {
            let point = Vec3::new(-9.0 + 0.1 * i as f32, 0.0, 6.0 - 0.15 * j as f32);
            let sides: Option<Vec<Side>> = pictures
                .iter()
                .map(|(camera, picture)| side(picture, pixel_of(camera, point)?))
                .collect();
            let (Some(sides), (camera, first)) = (sides, &pictures[0]) else {
                continue;
            };
            if !is_inside(first, camera, point, sides[0]) {
                continue;
            }
            flips.followed += 1;
            flips.flipped += usize::from(sides.iter().any(|side| side.is_opposite_of(sides[0])));
        }
    }
    flips
}

/// Whether all pixels around the point's, up to [`MARGIN`], are on its side.
fn is_inside(picture: &RgbaImage, camera: &Transform, point: Vec3, of: Side) -> bool {
    let Some([x, y]) = pixel_of(camera, point) else {
        return false;
    };
    let around = -MARGIN..=MARGIN;
    around.clone().all(|dx| {
        around.clone().all(|dy| {
            side(picture, [x + dx as f32, y + dy as f32]) == Some(of)
        })
    })
}

#[test]
fn a_slow_pan_flips_nothing() {
    let mut stage = Stage::new();
    let camera = stage.camera();
    stage.world().entity_mut(camera).insert(ShadowFilteringMethod::Hardware2x2);
    let sun = stage.sun();
    let mut pan = |fit| -> Flips {
        // Coarse maps: a texel is several pixels wide, so that crawling is plain to see.
        stage.world().entity_mut(sun).insert(ParallelSplitShadows {
            far: 40.0,
            cascades: 1,
            map_size: MapSize::Same(200),
            fit,
            ..shadows()
        });
        let pictures: Vec<(Transform, RgbaImage)> = (0..STEPS)
            .map(|step| {
                let mut view = eye();
                view.rotate_y(TURN * step as f32);
                view.translation += Vec3::new(0.0008, 0.0002, -0.001) * step as f32;
                if let Some(mut transform) = stage.world().get_mut::<Transform>(camera) {
                    *transform = view;
                }
                (view, stage.picture())
            })
            .collect();
        save(&format!("pan_{fit:?}"), &pictures[0].1, &pictures[STEPS - 1].1);
        follow(&pictures)
    };
    let stable = pan(CascadeFit::Stable);
    assert!(stable.followed > 5000, "{stable:?}");
    assert_eq!(stable.flipped, 0, "{stable:?}");
    // The test can see crawling: the other fit does crawl.
    let tight = pan(CascadeFit::Tight);
    assert!(tight.flipped > 100, "{tight:?}");
}
