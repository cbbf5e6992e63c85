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
/// Half the side of the square of pixels that must be smooth around a followed point.
const MARGIN: i32 = 2;
/// Brightness between lit and dark ground is some 90 levels: this much is a flip.
const FLIP: u8 = 40;

/// How ground points fared under a pan.
#[derive(Default, Debug)]
struct Flips {
    /// Points followed over the whole pan.
    followed: usize,
    /// Points that went from lit to dark or back.
    flipped: usize,
}

/// Where ground point `point` is in the picture (pixels).
fn pixel_of(camera: &Transform, point: Vec3) -> Option<[i32; 2]> {
    let local = camera.to_matrix().inverse().transform_point3(point);
    let focal = 0.5 * SIZE.y as f32 / core::f32::consts::FRAC_PI_8.tan();
    let x = 0.5 * SIZE.x as f32 + focal * local.x / -local.z;
    let y = 0.5 * SIZE.y as f32 - focal * local.y / -local.z;
    (local.z < 0.0).then_some([x.floor() as i32, y.floor() as i32])
}

/// `None` outside the picture and where something else is in front: no ground is so bright.
fn brightness(picture: &RgbaImage, [x, y]: [i32; 2]) -> Option<u8> {
    let inside = x >= 0 && y >= 0 && x < SIZE.x as i32 && y < SIZE.y as i32;
    inside
        .then(|| picture.get_pixel(x as u32, y as u32)[0])
        .filter(|value| *value < 175)
}

/// Follows ground points through the pictures of a pan.
///
/// Sharp edges, of objects and of shadows, move over the pixel grid, so that pixels on them
/// change their coverage; that is not crawling. The two are told apart by looking only at
/// points whose surroundings are smooth in the first picture, soft shadow edges among them: if
/// shadows rest in the world, the brightness there changes by a pixel's worth of slope at most.
fn follow(pictures: &[(Transform, RgbaImage)]) -> Flips {
    let mut flips = Flips::default();
    for i in 0..200 {
        for j in 0..200 {
            let point = Vec3::new(-9.0 + 0.1 * i as f32, 0.0, 6.0 - 0.15 * j as f32);
            let seen: Option<Vec<u8>> = pictures
                .iter()
                .map(|(camera, picture)| brightness(picture, pixel_of(camera, point)?))
                .collect();
            let (Some(seen), (camera, first)) = (seen, &pictures[0]) else {
                continue;
            };
            if pixel_of(camera, point).is_some_and(|pixel| is_smooth(first, pixel)) {
                flips.followed += 1;
                flips.flipped += usize::from(seen.iter().any(|v| v.abs_diff(seen[0]) > FLIP));
            }
        }
    }
    flips
}

/// Whether the brightness around a pixel varies by clearly less than a flip.
fn is_smooth(picture: &RgbaImage, [x, y]: [i32; 2]) -> bool {
    let around =
        (-MARGIN..=MARGIN).flat_map(|dx| (-MARGIN..=MARGIN).map(move |dy| [x + dx, y + dy]));
    let seen: Option<Vec<u8>> = around.map(|pixel| brightness(picture, pixel)).collect();
    seen.is_some_and(|seen| {
        let (least, most) = seen
            .iter()
            .fold((255, 0), |(l, m), v| (*v.min(&l), *v.max(&m)));
        most - least < FLIP - 10
    })
}

#[test]
fn a_slow_pan_flips_nothing() {
    let mut stage = Stage::new();
    let camera = stage.camera();
    stage
        .world()
        .entity_mut(camera)
        .insert(ShadowFilteringMethod::Hardware2x2);
    let sun = stage.sun();
    let mut pan = |fit: CascadeFit, slack: f32| -> Flips {
        // Coarse maps: a texel is several pixels wide, so that crawling is plain to see.
        stage.world().entity_mut(sun).insert(ParallelSplitShadows {
            far: 40.0,
            cascades: 1,
            map_size: MapSize::Same(100),
            fit: fit.clone(),
            slack,
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
        save(
            &format!("pan_{fit:?}"),
            &pictures[0].1,
            &pictures[STEPS - 1].1,
        );
        follow(&pictures)
    };
    let stable = pan(CascadeFit::Stable, 0.1);
    assert!(stable.followed > 5000, "{stable:?}");
    assert_eq!(stable.flipped, 0, "{stable:?}");
    let steady = pan(CascadeFit::Steady, 0.1);
    assert!(steady.followed > 5000, "{steady:?}");
    assert_eq!(steady.flipped, 0, "{steady:?}");
    // The test can see crawling: a map that follows the view does crawl.
    let tight = pan(CascadeFit::Tight, 0.0);
    assert!(tight.flipped > 5, "{tight:?}");
}
