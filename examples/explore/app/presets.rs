//! Settings from files, to files and to the clipboard.

use std::path::PathBuf;

use bevy::{asset::io::file::FileAssetReader, clipboard::Clipboard, prelude::*};
use bevy_pssm::prelude::*;

use super::{
    open::Opened,
    sides::{Compare, SideSun, Technique},
};

/// Where presets are, within the assets.
const FOLDER: &str = "shadows";
const ENDING: &str = ".shadows.ron";
/// Where one is saved to, in the current folder.
const SAVED: &str = "explored.shadows.ron";

/// The presets there are.
#[derive(Resource, Debug)]
pub struct Presets {
    /// For people; the first stands for none of them.
    pub names: Vec<String>,
    /// The one in force on the edited side.
    pub chosen: usize,
    wanted: Option<usize>,
    kept: Option<(String, bool)>,
}

impl Default for Presets {
    fn default() -> Self {
        let folder = FileAssetReader::get_base_path().join("assets").join(FOLDER);
        let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let mut names: Vec<String> = files
            .filter_map(|file| {
                let name = file.file_name().into_string().ok()?;
                Some(name.strip_suffix(ENDING)?.to_owned())
            })
            .collect();
        names.sort();
        names.insert(0, "by hand".into());
        Self {
            names,
            chosen: 0,
            wanted: None,
            kept: None,
        }
    }
}

impl Presets {
    /// Puts a preset in force on the edited side, and its file's later changes.
    pub fn choose(&mut self, index: usize) {
        self.wanted = Some(index);
    }

    /// Puts settings on the clipboard, or into a file.
    pub fn keep(&mut self, shadows: &ParallelSplitShadows, in_file: bool) {
        let pretty = ron::ser::PrettyConfig::default();
        if let Ok(text) = ron::ser::to_string_pretty(shadows, pretty) {
            self.kept = Some((text, in_file));
        }
    }
}

/// Applies, copies and saves presets.
pub struct PresetsPlugin;

impl Plugin for PresetsPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<Presets>()
            .init_resource::<Clipboard>()
            .add_systems(Update, (put_in_force, keep));
    }
}

fn put_in_force(
    mut commands: Commands,
    mut presets: ResMut<Presets>,
    mut compare: ResMut<Compare>,
    assets: Res<AssetServer>,
    loaded: Res<Assets<ParallelSplitShadows>>,
    suns: Query<(
        Entity,
        &SideSun,
        Option<(&ShadowPreset, &ParallelSplitShadows)>,
    )>,
) {
    let edited = compare.edited;
    let Some((sun, _, preset)) = suns.iter().find(|(_, sun, _)| sun.0 == edited) else {
        return;
    };
    let path = |name: &str| format!("{FOLDER}/{name}{ENDING}");
    if let Some(wanted) = presets.bypass_change_detection().wanted.take()
        && let Some(name) = presets.names.get(wanted).filter(|_| wanted > 0)
    {
        let chosen: Handle<ParallelSplitShadows> = assets.load(path(name));
        let mut sun = commands.entity(sun);
        if let (Some(_), Some(shadows)) = (preset, loaded.get(&chosen)) {
            // Also if it is the one that was chosen last, and has been changed since.
            sun.insert(shadows.clone());
        }
        sun.insert(ShadowPreset(chosen));
        compare.techniques[edited.index()] = Technique::Plugin;
        return;
    }
    // What has been changed since is no longer the file's.
    let preset = preset.filter(|(preset, now)| loaded.get(&preset.0) == Some(*now));
    let in_force = preset.and_then(|(preset, _)| preset.0.path());
    let in_force = in_force.map(ToString::to_string);
    let chosen = presets
        .names
        .iter()
        .position(|name| in_force.as_ref() == Some(&path(name)));
    let chosen = chosen.unwrap_or(0);
    if presets.chosen != chosen {
        presets.chosen = chosen;
    }
}

fn keep(
    mut presets: ResMut<Presets>,
    mut clipboard: ResMut<Clipboard>,
    mut opened: ResMut<Opened>,
) {
    let Some((text, in_file)) = presets.bypass_change_detection().kept.take() else {
        return;
    };
    opened.message = Some(if in_file {
        let file = PathBuf::from(SAVED);
        match std::fs::write(&file, text) {
            Ok(()) => format!("Saved as {}.", file.display()),
            Err(error) => format!("{} cannot be written. {error}", file.display()),
        }
    } else {
        match clipboard.set_text(text) {
            Ok(()) => "The settings are on the clipboard.".into(),
            Err(error) => format!("There is no clipboard. {error}"),
        }
    });
}
