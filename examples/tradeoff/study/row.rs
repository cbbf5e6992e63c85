//! One line of `results.csv`.

use serde::Serialize;

use super::{
    cost::Frame,
    flicker::{Flips, Motion},
    run::Outcome,
};

/// The columns, and what they mean.
pub const COLUMNS: [(&str, &str); 37] = [
    ("scene", "name of the scene"),
    ("setting", "name of the setting, unique in the scene"),
    (
        "technique",
        "`pssm`: the plugin; `bevy`: Bevy's own shadows",
    ),
    ("texels", "of all maps of the light"),
    (
        "mib",
        "memory of their array texture: its layers are as large as the largest map",
    ),
    (
        "wrong_pct",
        "pixels off by more than half the sun's light, in percent of those that face it",
    ),
    ("acne_pct", "of these, shadowed that should be lit"),
    ("leak_pct", "of these, lit that should be shadowed"),
    (
        "stain_pct",
        "pixels off by more than a tenth, more than 2 pixels from any boundary of light",
    ),
    (
        "mae_pct",
        "mean error against the share of the pixel that is lit",
    ),
    (
        "edge_px_p95",
        "95th percentile of the distance between true and found edges (pixels)",
    ),
    (
        "flicker_pct",
        "pixels whose answer changes though the truth does not, while maps follow small motions",
    ),
    ("flicker_pan_pct", "… the camera moving to the right"),
    ("flicker_turn_pct", "… turning"),
    ("flicker_zoom_pct", "… zooming"),
    ("flicker_sun_pct", "… the sun moving"),
    (
        "predicted_texels_per_pixel",
        "texels across a pixel where they are fewest, over all that the cascades can show (Lloyd et al. 2006, perspective part)",
    ),
    ("seen_texels_per_pixel", "the same, over what is seen"),
    (
        "casters",
        "handed to the shadow passes by culling on the CPU, sum over cascades and poses",
    ),
    ("casters_by_cascade", "… nearest cascade first"),
    ("triangles_by_cascade", "of these casters"),
    (
        "shadow_vertices",
        "vertex shader invocations of the shadow passes, sum over poses",
    ),
    ("shadow_primitives", "primitives that reached their clipper"),
    ("shadow_fragments", "their fragment invocations"),
    (
        "main_vertices",
        "vertex shader invocations of the main pass",
    ),
    ("main_primitives", "primitives that reached its clipper"),
    ("main_fragments", "its fragment invocations"),
    (
        "shadow_gpu_ms",
        "time of the shadow passes: median over a pose's frames, mean over poses",
    ),
    (
        "shadow_gpu_ms_spread",
        "… interquartile range, of poses with several frames",
    ),
    ("main_gpu_ms", "time of the main pass"),
    ("main_gpu_ms_spread", "… interquartile range"),
    (
        "shadow_share_pct",
        "shadow passes' part of shadow and main passes' time",
    ),
    ("plan_us", "planning on the CPU (µs), one camera and light"),
    ("plan_us_spread", "… interquartile range"),
    ("cull_us", "culling of casters on the CPU"),
    ("cull_us_spread", "… interquartile range"),
    (
        "ron",
        "the setting, for a `.shadows.ron` file; for Bevy's, its parameters",
    ),
];

/// What a setting is worth in a scene; fields as in [`COLUMNS`].
#[derive(Debug, Default, Clone, PartialEq, Serialize)]
pub struct Row {
    pub scene: String,
    pub setting: String,
    pub technique: &'static str,
    pub texels: u64,
    pub mib: f64,
    pub wrong_pct: f64,
    pub acne_pct: f64,
    pub leak_pct: f64,
    pub stain_pct: f64,
    pub mae_pct: f64,
    pub edge_px_p95: f64,
    pub flicker_pct: f64,
    pub flicker_pan_pct: f64,
    pub flicker_turn_pct: f64,
    pub flicker_zoom_pct: f64,
    pub flicker_sun_pct: f64,
    pub predicted_texels_per_pixel: f64,
    pub seen_texels_per_pixel: f64,
    pub casters: usize,
    pub casters_by_cascade: String,
    pub triangles_by_cascade: String,
    pub shadow_vertices: u64,
    pub shadow_primitives: u64,
    pub shadow_fragments: u64,
    pub main_vertices: u64,
    pub main_primitives: u64,
    pub main_fragments: u64,
    pub shadow_gpu_ms: f64,
    pub shadow_gpu_ms_spread: f64,
    pub main_gpu_ms: f64,
    pub main_gpu_ms_spread: f64,
    pub shadow_share_pct: f64,
    pub plan_us: f64,
    pub plan_us_spread: f64,
    pub cull_us: f64,
    pub cull_us_spread: f64,
    pub ron: String,
}

impl Row {
    /// The row of an outcome.
    pub fn new(scene: &str, outcome: &Outcome, views: usize) -> Self {
        let poses = &outcome.frames[..views];
        let sum = |value: &dyn Fn(&Frame) -> f64| poses.iter().map(value).sum::<f64>() as u64;
        let by_cascade = |counts: &dyn Fn(&Frame) -> &Vec<usize>| {
            let most = poses.iter().map(|frame| counts(frame).len()).max();
            let of = |i| poses.iter().filter_map(move |f| counts(f).get(i)).sum();
            (0..most.unwrap_or(0)).map(of).collect::<Vec<usize>>()
        };
        let words = |counts: &[usize]| {
            let words: Vec<String> = counts.iter().map(ToString::to_string).collect();
            words.join(" ")
        };
        let spread = |value: &dyn Fn(&Frame) -> f64| {
            let poses: Vec<[f64; 2]> = (0..views)
                .map(|pose| {
                    let frames = outcome.frames.iter().zip(&outcome.view_of);
                    let of_pose = frames.filter(|(_, view)| **view == pose);
                    median_and_spread(of_pose.map(|(frame, _)| value(frame)).collect())
                })
                .collect();
            let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len().max(1) as f64;
            let spreads = poses.iter().map(|[_, spread]| *spread);
            [
                mean(poses.iter().map(|[median, _]| *median).collect()),
                mean(spreads.filter(|spread| *spread > 0.0).collect()),
            ]
            .map(rounded)
        };
        let casters = by_cascade(&|frame| &frame.casters);
        let figures = outcome.figures;
        let flicker = |motion: Motion| {
            let index = Motion::ALL.iter().position(|m| *m == motion);
            rounded(outcome.flips[index.unwrap_or(0)].percent())
        };
        let mut all = Flips::default();
        for flips in outcome.flips {
            all += flips;
        }
        let (shadow, main) = (
            spread(&|frame| frame.gpu.milliseconds),
            spread(&|frame| frame.gpu.main_milliseconds),
        );
        let share = |frame: &Frame| {
            let both = frame.gpu.milliseconds + frame.gpu.main_milliseconds;
            100.0 * frame.gpu.milliseconds / both.max(f64::MIN_POSITIVE)
        };
        let (plan, cull) = (spread(&|frame| frame.cpu[0]), spread(&|frame| frame.cpu[1]));
        Self {
            scene: scene.to_owned(),
            setting: outcome.setting.name.clone(),
            technique: outcome.setting.technique_name(),
            texels: poses.first().map_or(0, Frame::texels),
            mib: poses.first().map_or(0.0, Frame::mib),
            wrong_pct: rounded(figures.wrong_pct),
            acne_pct: rounded(figures.acne_pct),
            leak_pct: rounded(figures.leak_pct),
            stain_pct: rounded(figures.stain_pct),
            mae_pct: rounded(figures.mae_pct),
            edge_px_p95: rounded(figures.edge_px_p95),
            flicker_pct: rounded(all.percent()),
            flicker_pan_pct: flicker(Motion::Pan),
            flicker_turn_pct: flicker(Motion::Turn),
            flicker_zoom_pct: flicker(Motion::Zoom),
            flicker_sun_pct: flicker(Motion::Sun),
            predicted_texels_per_pixel: rounded(outcome.texels_per_pixel[0]),
            seen_texels_per_pixel: rounded(outcome.texels_per_pixel[1]),
            casters: casters.iter().sum(),
            casters_by_cascade: words(&casters),
            triangles_by_cascade: words(&by_cascade(&|frame| &frame.triangles)),
            shadow_vertices: sum(&|frame| frame.gpu.vertices),
            shadow_primitives: sum(&|frame| frame.gpu.primitives),
            shadow_fragments: sum(&|frame| frame.gpu.fragments),
            main_vertices: sum(&|frame| frame.gpu.main_vertices),
            main_primitives: sum(&|frame| frame.gpu.main_primitives),
            main_fragments: sum(&|frame| frame.gpu.main_fragments),
            shadow_gpu_ms: shadow[0],
            shadow_gpu_ms_spread: shadow[1],
            main_gpu_ms: main[0],
            main_gpu_ms_spread: main[1],
            shadow_share_pct: spread(&share)[0],
            plan_us: plan[0],
            plan_us_spread: plan[1],
            cull_us: cull[0],
            cull_us_spread: cull[1],
            ron: outcome.setting.ron(),
        }
    }

    /// The row without what differs from run to run: times.
    pub fn without_times(&self) -> Self {
        Self {
            shadow_gpu_ms: 0.0,
            shadow_gpu_ms_spread: 0.0,
            main_gpu_ms: 0.0,
            main_gpu_ms_spread: 0.0,
            shadow_share_pct: 0.0,
            plan_us: 0.0,
            plan_us_spread: 0.0,
            cull_us: 0.0,
            cull_us_spread: 0.0,
            ..self.clone()
        }
    }
}

/// To four decimals: enough for a pixel in a million.
pub fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

fn median_and_spread(mut values: Vec<f64>) -> [f64; 2] {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let index = values.len().saturating_sub(1) as f64 * share;
        let value = |index: f64| values.get(index as usize).copied().unwrap_or(0.0);
        let (low, high) = (value(index.floor()), value(index.ceil()));
        low + (high - low) * index.fract()
    };
    [at(0.5), at(0.75) - at(0.25)]
}
