//! Drawing a figure.

use core::error::Error;

use bevy::text::DEFAULT_FONT_DATA;
use plotters::{coord::Shift, element::DashedPathElement, prelude::*, style::register_font};

use super::figures::{Figure, Light, Point, RATIO, Scheme, THETA};

const SIZE: (u32, u32) = (900, 600);
pub const FONT: &str = "sans-serif";
const DASH: i32 = 6;

/// Gives the plotter a font. It only measures text; what shows it has fonts of its own.
pub fn register() -> Result<(), &'static str> {
    register_font(FONT, FontStyle::Normal, DEFAULT_FONT_DATA).map_err(|_| "the font is broken")
}

/// The figure as an SVG document.
pub fn svg(figure: Figure, points: &[Point]) -> Result<String, Box<dyn Error>> {
    register()?;
    let mut document = String::new();
    draw(
        SVGBackend::with_string(&mut document, SIZE).into_drawing_area(),
        figure,
        points,
    )?;
    Ok(document)
}

fn draw(
    area: DrawingArea<SVGBackend, Shift>,
    figure: Figure,
    points: &[Point],
) -> Result<(), Box<dyn Error>> {
    area.fill(&WHITE)?;
    let (what, over) = match figure {
        Figure::Lloyd7 | Figure::Lloyd10 => ("light overhead", "z-partitions"),
        Figure::Lloyd12 => ("light overhead and behind", "shadow maps"),
    };
    let across = |point: &Point| match figure {
        Figure::Lloyd7 | Figure::Lloyd10 => point.partitions,
        Figure::Lloyd12 => point.maps,
    };
    let last = points.iter().filter_map(across).max().unwrap_or(1);
    let ends = [0.5, f64::from(last) + 0.5];
    let mut chart = ChartBuilder::on(&area)
        .caption(
            format!("Storage factor, {what} (far/near = {RATIO}, half field of view {THETA}°)"),
            (FONT, 20),
        )
        .margin(16)
        .x_label_area_size(48)
        .y_label_area_size(84)
        .build_cartesian_2d(ends[0]..ends[1], (1.0..2e6).log_scale())?;
    chart
        .configure_mesh()
        .x_desc(format!("Number of {over}"))
        .y_desc("Texels needed per pixel of the image")
        .x_labels(last as usize + 1)
        .x_label_formatter(&|x| format!("{x:.0}"))
        .y_label_formatter(&|y| format!("{y}"))
        .label_style((FONT, 15))
        .axis_desc_style((FONT, 16))
        .x_max_light_lines(1)
        .bold_line_style(BLACK.mix(0.15))
        .light_line_style(BLACK.mix(0.05))
        .draw()?;

    for curve in points.chunk_by(|a, b| (a.light, a.scheme) == (b.light, b.scheme)) {
        let Point { light, scheme, .. } = curve[0];
        if (light, scheme) == (Light::Behind, Scheme::DepthWarped) {
            // A warp has no effect there: the curve is that without.
            continue;
        }
        let style = style(scheme);
        let line: Vec<(f64, f64)> = curve
            .iter()
            .flat_map(|point| {
                let xs = across(point).map_or(ends.to_vec(), |x| vec![f64::from(x)]);
                xs.into_iter().map(|x| (x, point.storage_factor))
            })
            .collect();
        if scheme != Scheme::Optimum {
            let dots = line
                .iter()
                .map(|dot| Circle::new(*dot, 3, style.color.filled()));
            chart.draw_series(dots)?;
        }
        let dashed = light == Light::Behind;
        let series = if dashed {
            chart.draw_series(DashedLineSeries::new(line, DASH, DASH, style))?
        } else {
            chart.draw_series(LineSeries::new(line, style))?
        };
        series.label(label(light, scheme)).legend(move |(x, y)| {
            let sample = vec![(x, y), (x + 36, y)];
            if dashed {
                DashedPathElement::new(sample, DASH, DASH, style).into_dyn()
            } else {
                PathElement::new(sample, style).into_dyn()
            }
        });
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .margin(16)
        .legend_area_size(44)
        .label_font((FONT, 15))
        .background_style(WHITE)
        .border_style(BLACK.mix(0.4))
        .draw()?;
    area.present()?;
    Ok(())
}

fn style(scheme: Scheme) -> ShapeStyle {
    let color = match scheme {
        Scheme::Depth => RGBColor(200, 60, 20),
        Scheme::DepthWarped | Scheme::DepthLispsm => RGBColor(20, 100, 180),
        Scheme::FacesDepthWarped => RGBColor(30, 130, 60),
        Scheme::Optimum => RGBColor(90, 90, 90),
    };
    color.stroke_width(2)
}

fn label(light: Light, scheme: Scheme) -> &'static str {
    match (light, scheme) {
        (Light::Overhead, Scheme::Depth) => "ZP, overhead",
        (Light::Overhead, Scheme::DepthWarped | Scheme::DepthLispsm) => "ZP+W, overhead",
        (Light::Overhead, Scheme::FacesDepthWarped) => "FP+ZP+W, overhead",
        (Light::Behind, Scheme::FacesDepthWarped) => "FP+ZP+W, behind",
        (Light::Behind, _) => "ZP and ZP+W, behind",
        (_, Scheme::Optimum) => "optimum",
    }
}
