//! What to measure, from the command line.

use std::path::{Path, PathBuf};

use bevy::{asset::AssetPath, prelude::*};
use bevy_pssm::config::ShadowPresetLoader;
use clap::{Parser, ValueEnum, value_parser};

use crate::{
    scene::{SCENES, SceneDescription},
    study::{path::Path as CameraWay, settings::Setting},
};

/// What every desktop GPU of the last decade allows (texels per side).
const MAX_MAP_SIZE: u32 = 16384;

/// Measures how wrong sun shadows are, against rays, and what they cost: the plugin's and Bevy's
/// own, in the same scenes and the same run.
///
/// Writes results.csv, report.md, plots and pictures.
#[derive(Parser, Debug, Clone)]
pub struct Arguments {
    /// Scenes: names of shipped ones, or files (`*.scene.ron`). Default: all four shipped.
    #[arg(long, num_args = 1.., value_name = "FILE")]
    pub scene: Vec<String>,
    /// Settings of the plugin to measure instead of the built-in grid (`*.shadows.ron`).
    #[arg(long, num_args = 1.., value_name = "FILE")]
    pub shadows: Vec<PathBuf>,
    /// Size of the pictures (pixels). Default 800x600, or 320x240 with `--quick`.
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub size: Option<UVec2>,
    /// Poses of each scene, the first ones. Default 4, or 2 with `--quick`.
    #[arg(long, value_name = "N", value_parser = value_parser!(u32).range(1..=64))]
    pub poses: Option<u32>,
    /// Steps of each small motion (pan, turn, zoom, sun) for the flicker figures; 0 leaves them
    /// out.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = value_parser!(u32).range(0..=16))]
    pub frames: u32,
    /// Folder for the results.
    #[arg(long, value_name = "DIR", default_value = "target/tradeoff")]
    pub out: PathBuf,
    /// Whether Bevy's own shadows are measured too, as they come and tuned.
    #[arg(long, value_enum, default_value_t = Baseline::Bevy)]
    pub baseline: Baseline,
    /// A small grid, small pictures and few poses: under three minutes.
    #[arg(long)]
    pub quick: bool,
    /// Steadiness and work too, along paths of ten seconds, of each fit and of Bevy's own at 2048²: paths.csv. All
    /// paths, or those whose names begin so: rest, walk, run, drive, turn, look, zoom, three cuts.
    #[arg(long, num_args = 0.., value_name = "PATH", value_parser = start_of_path)]
    pub paths: Option<Vec<String>>,
    /// Of each path's 600 frames, one in so many is looked at: fewer tell more, and take longer.
    #[arg(long, value_name = "N", default_value_t = 120, value_parser = frames_apart)]
    pub every: usize,
    /// What changes while the sun moves, by texel grid and step: suns.csv; and while the camera walks too: paths.csv.
    #[arg(long)]
    pub suns: bool,
    /// No scenes, but small cases that biases fail in, and what filters cost: lookups.md. With
    /// `--quick`, Bevy's best biases are not searched for.
    #[arg(long)]
    pub lookups: bool,
}

/// What the plugin is measured against.
#[derive(ValueEnum, Debug, Clone, Copy, PartialEq, Eq)]
pub enum Baseline {
    /// Bevy's own shadows.
    Bevy,
    /// Nothing.
    None,
}

fn start_of_path(text: &str) -> Result<String, String> {
    let mut names = CameraWay::ALL.iter().map(|(name, _)| *name);
    if names.any(|name| name.starts_with(text)) {
        return Ok(text.to_owned());
    }
    let names: Vec<_> = CameraWay::ALL.iter().map(|(name, _)| *name).collect();
    Err(format!(
        "no path begins so; there are: {}",
        names.join("; ")
    ))
}

fn frames_apart(text: &str) -> Result<usize, String> {
    let frames = text
        .parse()
        .ok()
        .filter(|frames| (1..=120).contains(frames));
    frames.ok_or_else(|| format!("`{text}` is not a number of frames from 1 to 120"))
}

fn size(text: &str) -> Result<UVec2, String> {
    let sides = text
        .split_once('x')
        .and_then(|(w, h)| Some(UVec2::new(w.parse().ok()?, h.parse().ok()?)));
    let allowed = |size: &UVec2| size.min_element() >= 16 && size.max_element() <= 4096;
    sides.filter(allowed).ok_or_else(|| {
        format!("`{text}` is not a width and a height from 16 to 4096, as in 800x600")
    })
}

/// A scene to measure.
pub struct NamedScene {
    /// Name, for tables and files.
    pub name: String,
    /// What is in it.
    pub description: SceneDescription,
}

impl Arguments {
    /// Size of the pictures.
    pub fn picture_size(&self) -> UVec2 {
        let default = if self.quick {
            UVec2::new(320, 240)
        } else {
            UVec2::new(800, 600)
        };
        self.size.unwrap_or(default)
    }

    /// How many poses of a scene to measure.
    pub fn poses(&self, of_scene: usize) -> usize {
        let wanted = self.poses.unwrap_or(if self.quick { 2 } else { 4 });
        (wanted as usize).min(of_scene)
    }

    /// Reads the scenes.
    ///
    /// # Errors
    /// Names the file that cannot be read and what is wrong with it.
    pub fn scenes(&self) -> Result<Vec<NamedScene>, String> {
        let shipped = SCENES.map(str::to_owned);
        let wanted: &[String] = if self.scene.is_empty() {
            &shipped
        } else {
            &self.scene
        };
        wanted.iter().map(|name| read_scene(name)).collect()
    }

    /// Reads the plugin's settings, if any were given.
    ///
    /// # Errors
    /// Names the file that cannot be read and what is wrong with it.
    pub fn settings(&self) -> Result<Vec<Setting>, String> {
        let mut settings: Vec<Setting> = Vec::new();
        for file in &self.shadows {
            let path = AssetPath::from_path(file);
            let config = ShadowPresetLoader::parse(&read_text(file)?, &path, MAX_MAP_SIZE)
                .map_err(|error| error.to_string())?;
            let name = stem(file, ".shadows.ron");
            if settings.iter().any(|setting| setting.name == name) {
                return Err(format!("--shadows: two files are named {name}"));
            }
            settings.push(Setting::pssm(name, config));
        }
        Ok(settings)
    }
}

fn read_scene(name: &str) -> Result<NamedScene, String> {
    let file = if SCENES.contains(&name) {
        let root = std::env::var("BEVY_ASSET_ROOT")
            .or_else(|_| std::env::var("CARGO_MANIFEST_DIR"))
            .unwrap_or_default();
        Path::new(&root).join(format!("assets/scenes/{name}.scene.ron"))
    } else {
        PathBuf::from(name)
    };
    let text =
        read_text(&file).map_err(|e| format!("{e}. Shipped scenes are {}", SCENES.join(", ")))?;
    let description: SceneDescription =
        ron::from_str(&text).map_err(|error| format!("{}: {error}", file.display()))?;
    if description.camera.poses.is_empty() {
        return Err(format!("{}: `poses` is empty", file.display()));
    }
    Ok(NamedScene {
        name: stem(&file, ".scene.ron"),
        description,
    })
}

fn read_text(file: &Path) -> Result<String, String> {
    std::fs::read_to_string(file).map_err(|error| format!("{}: {error}", file.display()))
}

fn stem(file: &Path, end: &str) -> String {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    name.strip_suffix(end).unwrap_or(&name).to_owned()
}
