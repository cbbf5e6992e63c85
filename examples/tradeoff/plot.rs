//! Wrong pixels against cost, as SVG and PNG.

use core::{error::Error, ops::Range};
use std::path::Path;

use bevy::text::DEFAULT_FONT_DATA;
use plotters::{coord::Shift, prelude::*, style::register_font};

use crate::{
    pareto::{Axis, front},
    study::row::Row,
};

const SIZE: (u32, u32) = (1400, 640);
const FONT: &str = "sans-serif";

/// Writes `pareto_SCENE.svg` and `.png`.
///
/// # Errors
/// If they cannot be drawn or written.
pub fn pareto(out: &Path, scene: &str, rows: &[Row]) -> Result<(), Box<dyn Error>> {
    register_font(FONT, FontStyle::Normal, DEFAULT_FONT_DATA).map_err(|_| "the font is broken")?;
    let path = |end: &str| out.join(format!("pareto_{scene}.{end}"));
    draw(
        &SVGBackend::new(&path("svg"), SIZE).into_drawing_area(),
        scene,
        rows,
    )?;
    draw(
        &BitMapBackend::new(&path("png"), SIZE).into_drawing_area(),
        scene,
        rows,
    )
}

fn draw<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    scene: &str,
    rows: &[Row],
) -> Result<(), Box<dyn Error>>
where
    B::ErrorType: 'static,
{
    area.fill(&WHITE)?;
    let panels = area.split_evenly((1, 2));
    for (panel, axis) in panels.iter().zip([Axis::Time, Axis::Memory]) {
        draw_panel(panel, scene, rows, axis)?;
    }
    area.present()?;
    Ok(())
}

/// Fewer wrong pixels are drawn as so many (%).
const LEAST_SHOWN: f64 = 1e-3;

/// The three kinds of dots.
const KINDS: [(&str, RGBColor); 3] = [
    ("bevy_pssm", RGBColor(20, 100, 180)),
    ("Bevy, tuned", RGBColor(225, 120, 20)),
    ("Bevy, defaults", RGBColor(150, 150, 150)),
];

fn kind(row: &Row) -> usize {
    match (row.technique, row.setting.ends_with("tuned")) {
        ("bevy", true) => 1,
        ("bevy", false) => 2,
        _ => 0,
    }
}

/// 1, 2, 5, 10 and so on, within a range.
fn ticks(range: &Range<f64>) -> Vec<f64> {
    let decades = (-2..6).map(|exponent| 10_f64.powi(exponent));
    decades
        .flat_map(|ten| [ten, 2.0 * ten, 5.0 * ten])
        .filter(|tick| range.contains(tick))
        .collect()
}

fn draw_panel<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    scene: &str,
    rows: &[Row],
    axis: Axis,
) -> Result<(), Box<dyn Error>>
where
    B::ErrorType: 'static,
{
    let what = match axis {
        Axis::Time => "GPU time of the shadow passes (ms, logarithmic)",
        Axis::Memory => "Memory of the maps (MiB, logarithmic)",
    };
    let costs = rows.iter().map(|row| axis.of(row));
    let (least, most) = costs.fold((f64::INFINITY, 0.0), |(least, most), cost| {
        (f64::min(least, cost), f64::max(most, cost))
    });
    let errors = rows.iter().map(|row| row.wrong_pct.max(LEAST_SHOWN));
    let (truest, worst) = errors.fold((f64::INFINITY, 0.0), |(truest, worst), wrong| {
        (f64::min(truest, wrong), f64::max(worst, wrong))
    });
    let across = 0.8 * least.max(1e-3)..2.4 * most.max(1e-2);
    let up = 0.6 * truest..1.3 * worst;
    let [ticks_across, ticks_up] = [&across, &up].map(ticks);
    let mut chart = ChartBuilder::on(area)
        .caption(format!("{scene}: wrong pixels"), (FONT, 20))
        .margin(14)
        .x_label_area_size(46)
        .y_label_area_size(64)
        .build_cartesian_2d(
            across.log_scale().with_key_points(ticks_across),
            up.log_scale().with_key_points(ticks_up),
        )?;
    chart
        .configure_mesh()
        .x_desc(what)
        .x_labels(12)
        .y_desc("Wrong pixels (% of those that face the sun, logarithmic)")
        .y_labels(12)
        .x_label_formatter(&|x| format!("{x}"))
        .y_label_formatter(&|y| format!("{y}"))
        .label_style((FONT, 14))
        .axis_desc_style((FONT, 15))
        .bold_line_style(BLACK.mix(0.12))
        .light_line_style(TRANSPARENT)
        .draw()?;

    let dot = |i: &usize| (axis.of(&rows[*i]), rows[*i].wrong_pct.max(LEAST_SHOWN));
    let best = front(rows, axis);
    chart.draw_series(LineSeries::new(best.iter().map(dot), BLACK.mix(0.4)))?;
    for (index, (name, color)) in KINDS.into_iter().enumerate() {
        let of_kind = (0..rows.len()).filter(|i| kind(&rows[*i]) == index);
        let dots = of_kind.map(|i| Circle::new(dot(&i), 5, color.filled()));
        chart
            .draw_series(dots)?
            .label(name)
            .legend(move |at| Circle::new(at, 5, color.filled()));
    }
    let spots: Vec<_> = best.iter().map(|i| chart.backend_coord(&dot(i))).collect();
    let names: Vec<_> = best.iter().map(|i| rows[*i].setting.as_str()).collect();
    let offsets = label_offsets(&spots, &names);
    let labels = best.iter().zip(names).zip(offsets);
    chart.draw_series(labels.map(|((i, name), (right, down))| {
        let line = PathElement::new(vec![(0, 0), (right, down)], BLACK.mix(0.25));
        let text = Text::new(name.to_owned(), (right, down - LABEL.1 / 2), (FONT, 13));
        EmptyElement::at(dot(i)) + line + text
    }))?;
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .margin(14)
        .label_font((FONT, 14))
        .background_style(WHITE)
        .border_style(BLACK.mix(0.4))
        .draw()?;
    Ok(())
}

/// Size of a label's letter (pixels).
const LABEL: (i32, i32) = (8, 14);

/// How far right of and below its dot each label begins (pixels), so that none covers another or
/// a dot: the nearest free place to the right, above before below.
fn label_offsets(dots: &[(i32, i32)], names: &[&str]) -> Vec<(i32, i32)> {
    let mut taken: Vec<[i32; 4]> = dots
        .iter()
        .map(|(x, y)| [x - 6, y - 6, x + 6, y + 6])
        .collect();
    let steps = |step: i32| [-step, step].map(|down| down * LABEL.1 / 2);
    dots.iter()
        .zip(names)
        .map(|((x, y), name)| {
            let width = LABEL.0 * name.len() as i32;
            let place = |down: i32| {
                let [left, top] = [x + 10, y + down - LABEL.1 / 2];
                [left, top, left + width, top + LABEL.1]
            };
            let is_free = |[left, top, right, bottom]: [i32; 4]| {
                let hits = |other: &[i32; 4]| {
                    left < other[2] && other[0] < right && top < other[3] && other[1] < bottom
                };
                !taken.iter().any(hits)
            };
            let downs = (0..80).flat_map(steps);
            let down = { downs }.find(|down| is_free(place(*down))).unwrap_or(0);
            taken.push(place(down));
            (10, down)
        })
        .collect()
}
