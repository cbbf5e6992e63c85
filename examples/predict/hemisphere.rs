//! Figure 7 of Lloyd et al. 2006: storage factors over the hemisphere of directions that light may
//! come from, one map or one for each face.

use core::error::Error;

use glam::DVec3;
use plotters::{coord::Shift, prelude::*};
use serde::Serialize;

use super::{
    figures::{RATIO, Scheme, THETA, storage},
    plot::{FONT, register},
};

/// Of the hemisphere's picture (cells).
const SIDE: i32 = 61;
const SIZE: (u32, u32) = (900, 940);
/// Of the scale of colors (powers of ten).
const MOST: f64 = 6.5;

/// A direction and what it needs.
#[derive(Serialize, Debug, Clone, Copy)]
pub struct Spot {
    pub scheme: Scheme,
    /// Place in the picture, −1 to 1: light from above in the middle, from behind on the left.
    pub across: f64,
    pub up: f64,
    /// Texels needed so that none shows, per pixel of the image.
    pub storage_factor: f64,
}

const SCHEMES: [(Scheme, &str); 4] = [
    (Scheme::Depth, "unwarped"),
    (
        Scheme::DepthLispsm,
        "warped as light-space perspective maps are",
    ),
    (Scheme::DepthWarped, "warped for the least worst error"),
    (Scheme::FacesDepthWarped, "faces, warped"),
];

/// All schemes, direction by direction. `None` would be a slice without a map.
pub fn spots() -> Option<Vec<Spot>> {
    let cell = |index: i32| 2.0 * f64::from(index) / f64::from(SIDE - 1) - 1.0;
    let mut spots = Vec::new();
    for (scheme, _) in SCHEMES {
        for row in 0..SIDE {
            for column in 0..SIDE {
                let (across, up) = (cell(column), cell(row));
                if let Some(to_light) = direction(across, up) {
                    spots.push(Spot {
                        scheme,
                        across,
                        up,
                        storage_factor: storage(scheme, to_light, 1)?,
                    });
                }
            }
        }
    }
    Some(spots)
}

/// Where light comes from at a place in the picture, whose distance from the middle is the angle
/// from above; the camera looks along −z. `None` below the horizon.
fn direction(across: f64, up: f64) -> Option<DVec3> {
    let radius = across.hypot(up);
    let angle = radius * core::f64::consts::FRAC_PI_2;
    let flat = if radius > 0.0 {
        DVec3::new(up, 0.0, -across) / radius
    } else {
        DVec3::ZERO
    };
    (radius <= 1.0).then(|| angle.cos() * DVec3::Y + angle.sin() * flat)
}

/// The figure as an SVG document.
pub fn svg(spots: &[Spot]) -> Result<String, Box<dyn Error>> {
    register()?;
    let mut document = String::new();
    draw(
        SVGBackend::with_string(&mut document, SIZE).into_drawing_area(),
        spots,
    )?;
    Ok(document)
}

fn draw(area: DrawingArea<SVGBackend, Shift>, spots: &[Spot]) -> Result<(), Box<dyn Error>> {
    area.fill(&WHITE)?;
    let title = format!(
        "Storage factor of one partition (far/near = {RATIO}, half field of view {THETA}°)"
    );
    let area = area.titled(&title, (FONT, 20))?;
    let (panels, scale) = area.split_vertically(840);
    let half = 1.0 / f64::from(SIDE - 1);
    for ((scheme, name), panel) in SCHEMES.iter().zip(panels.split_evenly((2, 2))) {
        let mut chart = ChartBuilder::on(&panel)
            .caption(*name, (FONT, 16))
            .margin(8)
            .build_cartesian_2d(-1.05..1.05, -1.05..1.05)?;
        let of_scheme = spots.iter().filter(|spot| spot.scheme == *scheme);
        chart.draw_series(of_scheme.map(|spot| {
            let corners = [
                (spot.across - half, spot.up - half),
                (spot.across + half, spot.up + half),
            ];
            Rectangle::new(corners, color(spot.storage_factor.log10()).filled())
        }))?;
    }
    let mut chart = ChartBuilder::on(&scale)
        .margin_left(150)
        .margin_right(150)
        .x_label_area_size(24)
        .build_cartesian_2d(0.0..MOST, 0.0..1.0)?;
    chart
        .configure_mesh()
        .disable_mesh()
        .x_label_formatter(&|x| format!("10^{x:.0}"))
        .label_style((FONT, 15))
        .draw()?;
    chart.draw_series((0..130).map(|step| {
        let at = |step: i32| MOST * f64::from(step) / 130.0;
        Rectangle::new(
            [(at(step), 0.0), (at(step + 1), 1.0)],
            color(at(step)).filled(),
        )
    }))?;
    area.present()?;
    Ok(())
}

/// Blue for little, over green and yellow to red.
fn color(power: f64) -> HSLColor {
    let share = (power / MOST).clamp(0.0, 1.0);
    HSLColor(0.66 * (1.0 - share), 0.85, 0.5)
}
