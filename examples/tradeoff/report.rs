//! `results.csv`, `report.md` and what they point to.

use core::{error::Error, fmt::Write as _};
use std::path::Path;

use serde::Serialize;

use crate::{
    pareto::{Axis, front},
    plot,
    study::{
        alternatives::Alternative,
        day::SunRow,
        drawn::percent,
        path::FRAMES,
        paths::PathRow,
        row::{COLUMNS, Row},
        settings::{Setting, Technique},
    },
};

/// Memory for which a setting is recommended (MiB).
const MIB_BUDGETS: [f64; 4] = [4.0, 16.0, 64.0, 256.0];
/// Shadow passes' part of shadow and main passes' time for which a setting is recommended (percent).
const TIME_BUDGETS: [f64; 4] = [2.0, 5.0, 10.0, 20.0];

/// What a scene's rows are about.
pub struct SceneReport {
    /// Name of the scene.
    pub name: String,
    /// By row: its setting.
    pub settings: Vec<Setting>,
    /// The figures.
    pub rows: Vec<Row>,
    /// Steadiness along paths, if asked for.
    pub paths: Vec<PathRow>,
    /// What changes while the sun moves, if asked for.
    pub suns: Vec<SunRow>,
    /// By row: the pose where it is worst, whose pictures are kept.
    pub worst_pose: Vec<usize>,
    /// What the plugin does not have.
    pub alternatives: Vec<Alternative>,
}

/// Writes the table of all scenes.
///
/// # Errors
/// If it cannot be written.
pub fn write_csv(out: &Path, scenes: &[SceneReport]) -> Result<(), Box<dyn Error>> {
    let mut csv = csv::Writer::from_path(out.join("results.csv"))?;
    for row in scenes.iter().flat_map(|scene| &scene.rows) {
        csv.serialize(row)?;
    }
    csv.flush()?;
    write_rows(out, "paths.csv", scenes, |scene| &scene.paths)?;
    write_rows(out, "suns.csv", scenes, |scene| &scene.suns)
}

/// A file of rows, if there are any.
fn write_rows<T: Serialize>(
    out: &Path,
    file: &str,
    scenes: &[SceneReport],
    rows: impl Fn(&SceneReport) -> &Vec<T>,
) -> Result<(), Box<dyn Error>> {
    if scenes.iter().all(|scene| rows(scene).is_empty()) {
        return Ok(());
    }
    let mut csv = csv::Writer::from_path(out.join(file))?;
    for row in scenes.iter().flat_map(rows) {
        csv.serialize(row)?;
    }
    csv.flush()?;
    Ok(())
}

/// Names of the pictures of a row.
pub fn picture_name(scene: &str, setting: &str) -> String {
    format!("pictures/{scene}_{}.png", setting.replace(' ', "_"))
}

/// Writes the report and its plots.
///
/// # Errors
/// If they cannot be written.
pub fn write(out: &Path, head: &str, scenes: &[SceneReport]) -> Result<(), Box<dyn Error>> {
    let mut text = format!(
        "# Shadow settings: speed, memory and accuracy\n\n{head}\n\nAccuracy is measured against \
         rays, over the pixels that face the sun. Counts and accuracy repeat exactly; times do \
         not, and only their ratios within this run mean anything.\n"
    );
    for scene in scenes {
        plot::pareto(out, &scene.name, &scene.rows)?;
        write_scene(&mut text, scene)?;
    }
    write_comparison(&mut text, scenes)?;
    text.push_str("\n## Columns of results.csv\n\n| column | meaning |\n|---|---|\n");
    for (name, meaning) in COLUMNS {
        writeln!(text, "| {name} | {meaning} |")?;
    }
    std::fs::write(out.join("report.md"), text)?;
    Ok(())
}

fn write_scene(text: &mut String, scene: &SceneReport) -> Result<(), Box<dyn Error>> {
    let rows = &scene.rows;
    let (by_time, by_mib) = (front(rows, Axis::Time), front(rows, Axis::Memory));
    writeln!(
        text,
        "\n## {0}\n\n![Wrong pixels against cost](pareto_{0}.svg)\n",
        scene.name
    )?;
    text.push_str(
        "| setting | MiB | wrong % | acne % | leak % | stain % | mae % | edge px | flicker % | \
         texels/px predicted | seen | casters | shadow vertices | primitives | fragments | \
         shadow ms | share % | plan µs | cull µs |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for (i, row) in rows.iter().enumerate() {
        let mark = if by_time.contains(&i) || by_mib.contains(&i) {
            "**"
        } else {
            ""
        };
        writeln!(
            text,
            "| {mark}{}{mark} | {:.0} | {:.3} | {:.3} | {:.3} | {:.3} | {:.3} | {:.2} | {:.4} | {:.3} | {:.3} | {} | {} | {} | {} | {:.2} | {:.1} | {:.0} | {:.0} |",
            full_name(row),
            row.mib,
            row.wrong_pct,
            row.acne_pct,
            row.leak_pct,
            row.stain_pct,
            row.mae_pct,
            row.edge_px_p95,
            row.flicker_pct,
            row.predicted_texels_per_pixel,
            row.seen_texels_per_pixel,
            row.casters,
            row.shadow_vertices,
            row.shadow_primitives,
            row.shadow_fragments,
            row.shadow_gpu_ms,
            row.shadow_share_pct,
            row.plan_us,
            row.cull_us,
        )?;
    }
    let mut settings = rows.iter().zip(&scene.settings);
    if let Some((row, _)) = settings.find(|(_, setting)| setting.is_tuned()) {
        writeln!(
            text,
            "\nBevy's tuned settings, likewise at all sizes: {}.",
            row.ron
        )?;
    }
    let names = |indices: &[usize]| {
        let names: Vec<&str> = indices.iter().map(|i| rows[*i].setting.as_str()).collect();
        names.join(", ")
    };
    writeln!(
        text,
        "\nNo other setting is better in both wrong pixels and the shadow passes' time: {}.\n\n… \
         nor in both wrong pixels and memory: {}.\n\nEach of these where it is worst: picture, \
         truth, and their difference (acne red, leaks blue, stains yellow).\n",
        names(&by_time),
        names(&by_mib)
    )?;
    for (i, row) in rows.iter().enumerate() {
        if by_time.contains(&i) || by_mib.contains(&i) {
            writeln!(
                text,
                "{}, pose {}: ![]({})\n",
                full_name(row),
                scene.worst_pose[i] + 1,
                picture_name(&scene.name, &row.setting)
            )?;
        }
    }
    if !scene.alternatives.is_empty() {
        text.push_str(
            "What the plugin does not have, worked out under the same maps: blurs of the picture of \
             light at all poses, filters before the comparison at the first.\n\n\
             | technique | wrong % | stain % | mae % |\n|---|---|---|---|\n",
        );
    }
    for Alternative { name, figures } in &scene.alternatives {
        writeln!(
            text,
            "| {name} | {:.3} | {:.3} | {:.3} |",
            figures.wrong_pct, figures.stain_pct, figures.mae_pct
        )?;
    }
    text.push('\n');
    write_paths(text, scene)?;
    write_suns(text, scene)?;
    write_recommendations(text, scene)
}

fn write_suns(text: &mut String, scene: &SceneReport) -> Result<(), Box<dyn Error>> {
    if scene.suns.is_empty() {
        return Ok(());
    }
    text.push_str(
        "While the sun moves: points whose answer changes though their truth does not, in percent per \
         second · wrong among them (percent) · how far true and found edges lie apart (pixels, 95th \
         percentile) · maps drawn in a second.\n\n| setting |",
    );
    let first = &scene.suns[0].setting;
    let intervals = scene.suns.iter().take_while(|row| row.setting == *first);
    let names: Vec<_> = intervals.map(|row| row.interval).collect();
    write_heads(text, &names)?;
    for rows in scene.suns.chunk_by(|a, b| a.setting == b.setting) {
        write!(text, "| {} |", rows[0].setting)?;
        for row in rows {
            write!(
                text,
                " {:.3} · {:.2} · {:.1} · {:.1} |",
                row.changed_pct_per_second, row.wrong_pct, row.edge_px_p95, row.maps_per_second
            )?;
        }
        text.push('\n');
    }
    text.push('\n');
    Ok(())
}

/// The heads of columns, after the first.
fn write_heads(text: &mut String, names: &[&str]) -> Result<(), core::fmt::Error> {
    let lines = "|---".repeat(names.len());
    writeln!(text, " {} |\n|---{lines}|", names.join(" | "))
}

fn write_paths(text: &mut String, scene: &SceneReport) -> Result<(), Box<dyn Error>> {
    if scene.paths.is_empty() {
        return Ok(());
    }
    text.push_str(
        "Along paths of ten seconds: points whose answer changes though their truth does not, in \
         percent per second · frames, of 600, in which texels do not stay where they were · wrong \
         pixels (percent).\n\n| setting |",
    );
    let first = &scene.paths[0].setting;
    let rows = scene.paths.iter().take_while(|row| row.setting == *first);
    let names: Vec<_> = rows.map(|row| row.path).collect();
    write_heads(text, &names)?;
    for rows in scene.paths.chunk_by(|a, b| a.setting == b.setting) {
        write!(text, "| {} |", rows[0].setting)?;
        for row in rows {
            let PathRow {
                changed_pct_per_second,
                grid_changes,
                wrong_pct,
                ..
            } = row;
            write!(
                text,
                " {changed_pct_per_second:.3} · {grid_changes} · {wrong_pct:.2} |"
            )?;
        }
        text.push('\n');
    }
    write_work(text, &scene.paths)
}

fn write_work(text: &mut String, paths: &[PathRow]) -> Result<(), Box<dyn Error>> {
    text.push_str(
        "\nWhat is drawn in a frame, mean over each path: casters into maps · thousands of their triangles · \
         millions of texels cleared or copied. In every frame, and where maps are held while they serve: \
         nothing moving but the camera, one caster in a hundred, all.\n\n\
         | setting | path | always | held | one in a hundred moves | all move | triangles, of always (percent) |\n\
         |---|---|---|---|---|---|---|\n",
    );
    for row in paths {
        let mean = |sum: f64, unit: f64| sum / unit / FRAMES as f64;
        let cell = |casters: usize, triangles: usize, texels: u64| {
            format!(
                "{:.0} · {:.1} · {:.2}",
                mean(casters as f64, 1.0),
                mean(triangles as f64, 1e3),
                mean(texels as f64, 1e6)
            )
        };
        let share = |part: usize| percent(part, row.triangles_always);
        writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} | {:.1}, {:.1}, {:.1} |",
            row.setting,
            row.path,
            cell(row.casters_always, row.triangles_always, row.texels_always),
            cell(row.casters, row.triangles, row.texels),
            cell(row.casters_moving, row.triangles_moving, row.texels_moving),
            cell(
                row.casters_all_moving,
                row.triangles_all_moving,
                row.texels_all_moving
            ),
            share(row.triangles),
            share(row.triangles_moving),
            share(row.triangles_all_moving),
        )?;
    }
    text.push('\n');
    Ok(())
}

/// `pssm stable 2048`, `bevy 2048 tuned`.
fn full_name(row: &Row) -> String {
    match row.technique {
        "bevy" => row.setting.clone(),
        technique => format!("{technique} {}", row.setting),
    }
}

fn write_recommendations(text: &mut String, scene: &SceneReport) -> Result<(), Box<dyn Error>> {
    let within = |fits: &dyn Fn(&Row) -> bool| {
        let ours = scene.rows.iter().zip(&scene.settings);
        ours.filter(|(row, setting)| fits(row) && matches!(setting.technique, Technique::Pssm(_)))
            .min_by(|(a, _), (b, _)| a.wrong_pct.total_cmp(&b.wrong_pct))
    };
    let by_mib = MIB_BUDGETS.map(|budget| {
        (
            format!("{budget} MiB"),
            within(&|row: &Row| row.mib <= budget),
        )
    });
    let by_time = TIME_BUDGETS.map(|budget| {
        (
            format!("{budget} % of shadow and main passes' time"),
            within(&|row: &Row| row.shadow_share_pct <= budget && row.shadow_gpu_ms > 0.0),
        )
    });
    writeln!(text, "### Use in {}\n", scene.name)?;
    let mut told: Vec<(&str, Vec<String>, &Setting)> = Vec::new();
    for (budget, found) in by_mib.into_iter().chain(by_time) {
        let Some((_, setting)) = found else {
            continue;
        };
        match told.iter_mut().find(|(name, ..)| *name == setting.name) {
            Some((_, budgets, _)) => budgets.push(budget),
            None => told.push((&setting.name, vec![budget], setting)),
        }
    }
    for (name, budgets, setting) in told {
        let Technique::Pssm(config) = &setting.technique else {
            continue;
        };
        writeln!(
            text,
            "Within {}: {name}\n\n```ron\n{}\n```\n",
            budgets.join(", "),
            ron::ser::to_string_pretty(config, ron::ser::PrettyConfig::default())?
        )?;
    }
    Ok(())
}

/// A figure of which less is better.
type Figure = (&'static str, fn(&Row) -> f64);

const FIGURES: [Figure; 9] = [
    ("wrong %", |row| row.wrong_pct),
    ("stain %", |row| row.stain_pct),
    ("mae %", |row| row.mae_pct),
    ("edge px", |row| row.edge_px_p95),
    ("flicker %", |row| row.flicker_pct),
    ("shadow vertices", |row| row.shadow_vertices as f64),
    ("shadow ms", |row| row.shadow_gpu_ms),
    ("plan µs", |row| row.plan_us),
    ("cull µs", |row| row.cull_us),
];

/// Where Bevy's own shadows are as good or better, at equal texels.
fn write_comparison(text: &mut String, scenes: &[SceneReport]) -> Result<(), Box<dyn Error>> {
    let is_stock = |row: &&Row| row.technique == "bevy";
    if !scenes
        .iter()
        .flat_map(|scene| &scene.rows)
        .any(|row| is_stock(&row))
    {
        return Ok(());
    }
    text.push_str(
        "\n## Where Bevy's own shadows are as good or better\n\nAgainst the plugin's first setting \
         of as many texels.\n\n| scene | Bevy | plugin | as good or better in: Bevy against \
         plugin |\n|---|---|---|---|\n",
    );
    for scene in scenes {
        for stock in scene.rows.iter().filter(is_stock) {
            let ours = scene
                .rows
                .iter()
                .find(|row| !is_stock(row) && row.texels == stock.texels);
            let Some(ours) = ours else {
                continue;
            };
            let lost: Vec<String> = FIGURES
                .iter()
                .map(|(name, figure)| (name, figure(stock), figure(ours)))
                .filter(|(_, stock, ours)| stock <= ours)
                .map(|(name, stock, ours)| format!("{name} {stock:.4} against {ours:.4}"))
                .collect();
            let lost = if lost.is_empty() {
                "none".to_owned()
            } else {
                lost.join("; ")
            };
            writeln!(
                text,
                "| {} | {} | {} | {lost} |",
                scene.name, stock.setting, ours.setting
            )?;
        }
    }
    Ok(())
}
