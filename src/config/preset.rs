//! Configurations as RON assets (`*.shadows.ron`).

use core::sync::atomic::{AtomicU32, Ordering};

use bevy::{
    asset::{AssetLoader, AssetPath, Handle, LoadContext, io::Reader},
    ecs::{component::Component, reflect::ReflectComponent},
    log::error,
    platform::{
        collections::HashMap,
        sync::{Arc, Mutex, PoisonError},
    },
    reflect::{Reflect, TypePath},
};

use super::{ConfigError, ParallelSplitShadows};

/// Gives a light the [`ParallelSplitShadows`] of a RON preset, and keeps it up to date when the
/// file changes, where Bevy has the feature `file_watcher`. Until then, changes to the light's own
/// component stay. Removing this component removes the other.
///
/// ```no_run
/// # use bevy::prelude::*;
/// # use bevy_pssm::prelude::*;
/// fn setup(mut commands: Commands, assets: Res<AssetServer>) {
///     commands.spawn((
///         DirectionalLight::default(),
///         ShadowPreset(assets.load("shadows/balanced.shadows.ron")),
///     ));
/// }
/// ```
#[derive(Component, Reflect, Debug, Clone, PartialEq, Eq)]
#[reflect(Component, Debug, Clone, PartialEq)]
pub struct ShadowPreset(pub Handle<ParallelSplitShadows>);

/// Why a preset could not be loaded.
#[derive(thiserror::Error, Debug)]
#[non_exhaustive]
pub enum ShadowPresetError {
    /// The file could not be read.
    #[error("could not read the shadow preset: {0}")]
    Io(#[from] std::io::Error),
    /// The file is not RON, or does not have the configuration's form.
    #[error("{path}:{}:{}: {}", .error.span.start.line, .error.span.start.col, .error.code)]
    Parse {
        /// The preset's file.
        path: String,
        /// What is wrong, and where.
        error: Box<ron::error::SpannedError>,
    },
    /// The file reads well, but a value is outside its range.
    #[error("{path}:{line}: {error}")]
    Invalid {
        /// The preset's file.
        path: String,
        /// The line that sets the field at fault; 1 if the file leaves it to its default.
        line: usize,
        /// Field, value and what is allowed.
        error: ConfigError,
    },
}

/// Loads `*.shadows.ron` files.
///
/// A file that has been good once stays good: a bad edit is logged once, and the asset keeps the
/// last good configuration. A file that never was good fails to load.
#[derive(TypePath, Debug)]
pub struct ShadowPresetLoader {
    /// What the GPU allows: known once there is a device.
    max_map_size: Arc<AtomicU32>,
    files: Mutex<HashMap<AssetPath<'static>, Known>>,
}

/// What the loader remembers of a file.
#[derive(Debug)]
struct Known {
    last_good: ParallelSplitShadows,
    /// The mistake reported last, if the file has not been good since.
    warned: Option<String>,
}

impl ShadowPresetLoader {
    pub(crate) fn new(max_map_size: Arc<AtomicU32>) -> Self {
        Self {
            max_map_size,
            files: Mutex::default(),
        }
    }

    async fn read(
        &self,
        reader: &mut dyn Reader,
        path: &AssetPath<'_>,
    ) -> Result<ParallelSplitShadows, ShadowPresetError> {
        let mut bytes = Vec::new();
        reader.read_to_end(&mut bytes).await?;
        let text = String::from_utf8(bytes)
            .map_err(|error| std::io::Error::new(std::io::ErrorKind::InvalidData, error))?;
        Self::parse(&text, path, self.max_map_size.load(Ordering::Relaxed))
    }

    /// Reads a configuration from the text of a preset.
    ///
    /// # Errors
    /// As [`ShadowPresetError`], with `path` only used for messages.
    pub fn parse(
        text: &str,
        path: &AssetPath,
        max_map_size: u32,
    ) -> Result<ParallelSplitShadows, ShadowPresetError> {
        // Some editors begin a file with a byte-order mark.
        let text = text.trim_start_matches('\u{feff}');
        let config: ParallelSplitShadows =
            ron::from_str(text).map_err(|error| ShadowPresetError::Parse {
                path: path.to_string(),
                error: Box::new(error),
            })?;
        match config.validate(max_map_size) {
            Ok(()) => Ok(config),
            Err(error) => Err(ShadowPresetError::Invalid {
                path: path.to_string(),
                line: line_of_field(text, error.field()).unwrap_or(1),
                error,
            }),
        }
    }
}

impl AssetLoader for ShadowPresetLoader {
    type Asset = ParallelSplitShadows;
    type Settings = ();
    type Error = ShadowPresetError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        _settings: &(),
        load_context: &mut LoadContext<'_>,
    ) -> Result<ParallelSplitShadows, ShadowPresetError> {
        let path = load_context.path().clone_owned();
        let read = self.read(reader, &path).await;
        let mut known = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        match (read, known.get_mut(&path)) {
            (Ok(config), _) => {
                let last_good = config.clone();
                known.insert(
                    path,
                    Known {
                        last_good,
                        warned: None,
                    },
                );
                Ok(config)
            }
            (Err(error), None) => Err(error),
            // Were this an error, Bevy would try once more and report it twice.
            (Err(error), Some(known)) => {
                let message = error.to_string();
                if known.warned.as_ref() != Some(&message) {
                    error!("Keeping the last good version of a shadow preset: {message}");
                    known.warned = Some(message);
                }
                Ok(known.last_good.clone())
            }
        }
    }

    fn extensions(&self) -> &[&str] {
        &["shadows.ron"]
    }
}

/// The line, from 1, on which `field` stands outside comments. RON gives positions for syntax
/// only; field names are unique within a preset.
fn line_of_field(text: &str, field: &str) -> Option<usize> {
    let mut in_block_comment = 0_usize;
    for (index, line) in text.lines().enumerate() {
        let mut code = String::new();
        let mut rest = line;
        while let Some(next) = rest.chars().next() {
            if rest.starts_with("/*") {
                in_block_comment += 1;
                rest = &rest[2..];
            } else if in_block_comment > 0 && rest.starts_with("*/") {
                in_block_comment -= 1;
                rest = &rest[2..];
            } else if in_block_comment == 0 && rest.starts_with("//") {
                break;
            } else {
                if in_block_comment == 0 {
                    code.push(next);
                }
                rest = &rest[next.len_utf8()..];
            }
        }
        let is_word = |c: char| c.is_alphanumeric() || c == '_';
        if code.split(|c| !is_word(c)).any(|word| word == field) {
            return Some(index + 1);
        }
    }
    None
}
