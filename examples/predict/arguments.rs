//! The command line, and what of it makes no sense.

use core::ops::RangeInclusive;
use std::path::PathBuf;

use bevy_pssm::{
    ParallelSplitShadows, SplitScheme, geometry::slice::ViewVolume, plan::split_planes,
};
use clap::{Parser, value_parser};
use glam::{DMat3, DVec2, DVec3};

use super::{
    cascades::{Fit, Setup, Warp},
    figures::Figure,
};

/// Predicts how sharp shadows can be under a split scheme, from the geometry of view, light and
/// maps alone.
///
/// Only perspective aliasing is measured (Lloyd et al. 2006): texels that the view makes too
/// large. How a surface is turned to light and eye, filters and blending are left out.
///
/// Printed for each cascade:
///
///   pixels per texel   how many pixels of the image a texel covers where that is worst, along
///                      the map's x and y (with a warp, y is the warp's direction); above 1,
///                      texels show
///
///   texels per pixel   the inverse
///
///   storage factor     texels that the map needs so that none shows, per pixel of the image
///
///   seam               error just beyond over error just before the plane where the cascade
///                      begins, where on the plane that is farthest from 1; at 1 the border is
///                      invisible
#[derive(Parser, Debug)]
#[command(name = "predict", verbatim_doc_comment)]
pub struct Arguments {
    /// Where the split scheme starts (meters from the eye).
    #[arg(
        long,
        default_value_t = 1.0,
        value_parser = meters,
        allow_negative_numbers = true,
        value_name = "METERS",
    )]
    pub near: f64,
    /// Where shadows end (meters from the eye).
    #[arg(
        long,
        default_value_t = 500.0,
        value_parser = meters,
        allow_negative_numbers = true,
        value_name = "METERS",
    )]
    pub far: f64,
    /// Vertical field of view (degrees).
    #[arg(
        long,
        default_value_t = 60.0,
        value_parser = degrees,
        allow_negative_numbers = true,
        value_name = "DEGREES",
    )]
    pub fov: f64,
    /// Width of the image over its height.
    #[arg(
        long,
        default_value_t = 4.0 / 3.0,
        value_parser = aspect,
        allow_negative_numbers = true,
        value_name = "RATIO",
    )]
    pub aspect: f64,
    /// Height of the image (pixels).
    #[arg(
        long,
        default_value_t = 1080,
        value_parser = value_parser!(u32).range(1..=65536),
        value_name = "PIXELS",
    )]
    pub height: u32,
    /// Where cascades end: `uniform`, `logarithmic`, `practical` (the plugin's default), or a
    /// scheme in RON, such as "Practical(lambda: 0.9)", "Geometric(gamma: 3, bias: 0)" or
    /// "Manual([10, 50, 200])".
    #[arg(long, default_value = "practical", value_parser = scheme, value_name = "SCHEME")]
    pub splits: SplitScheme,
    /// Number of cascades. (The plugin itself has at most 4.)
    #[arg(
        long,
        default_value_t = 4,
        value_parser = value_parser!(u32).range(1..=64),
        value_name = "K",
    )]
    pub cascades: u32,
    /// Texels per side of each map.
    #[arg(
        long,
        default_value_t = 2048,
        value_parser = value_parser!(u32).range(1..=65536),
        value_name = "TEXELS",
    )]
    pub size: u32,
    /// How maps are laid over their slices.
    #[arg(long, value_enum, default_value_t = FitName::Body)]
    pub fit: FitName,
    /// How maps are warped; only with `--fit body`.
    #[arg(long, value_enum, default_value_t = Warp::None)]
    pub warp: Warp,
    /// Direction in which light travels, as the camera sees it: x right, y up, z towards the
    /// viewer. 0,-1,0 is light from above, 0,0,-1 from behind the camera.
    #[arg(
        long,
        default_value = "0.3,-1,-0.5",
        value_parser = direction,
        allow_hyphen_values = true,
        value_name = "X,Y,Z",
    )]
    pub light: DVec3,
    /// Print CSV instead of a table.
    #[arg(long)]
    pub csv: bool,
    /// Plot a figure of Lloyd et al. 2006 instead, as CSV and SVG (far/near 1000, half the
    /// field of view 30 degrees, square image).
    #[arg(long, value_enum, conflicts_with = "csv")]
    pub figure: Option<Figure>,
    /// Folder for the figure.
    #[arg(
        long,
        default_value = "target/predict",
        requires = "figure",
        value_name = "DIR"
    )]
    pub out: PathBuf,
}

/// How a map is laid over its slice.
#[derive(clap::ValueEnum, Debug, Clone, Copy, PartialEq, Eq)]
pub enum FitName {
    /// Tightly, in a frame that turns with the camera: the paper's maps.
    Body,
    /// The plugin's `Stable`: of constant size, moved in whole texels, with a guard for filters;
    /// without blend bands.
    Stable,
}

impl Arguments {
    /// What to predict; an error if arguments that are sound one by one do not go together.
    pub fn setup(&self) -> Result<Setup, String> {
        if self.far <= self.near {
            return Err(format!(
                "--far is {}, but must be above --near ({})",
                self.far, self.near
            ));
        }
        self.check_splits()
            .map_err(|message| format!("--splits: {message}"))?;
        let fit = match (self.fit, self.warp) {
            (FitName::Body, warp) => Fit::Body(warp),
            (FitName::Stable, Warp::None) => Fit::Stable,
            (FitName::Stable, _) => {
                return Err("--warp must be none with --fit stable: \
                            a warp turns with the camera, a stable map does not"
                    .to_owned());
            }
        };
        let half = (0.5 * self.fov).to_radians().tan() * DVec2::new(self.aspect, 1.0);
        Ok(Setup {
            view: ViewVolume {
                eye: DVec3::ZERO,
                axes: DMat3::IDENTITY,
                min: [DVec2::ZERO, -half],
                max: [DVec2::ZERO, half],
                near: 0.0,
                far: f64::INFINITY,
            },
            to_light: -self.light,
            planes: split_planes(&self.splits, self.near, self.far, self.cascades as usize),
            splits: self.splits.clone(),
            fit,
            map_size: self.size,
            image_height: f64::from(self.height),
            aspect: self.aspect,
        })
    }

    fn check_splits(&self) -> Result<(), String> {
        // The plugin's own check stops at four cascades, and only these planes depend on them.
        let SplitScheme::Manual(planes) = &self.splits else {
            let config = ParallelSplitShadows {
                near: self.near as f32,
                far: self.far as f32,
                splits: self.splits.clone(),
                ..Default::default()
            };
            return config.validate(u32::MAX).map_err(|error| error.to_string());
        };
        if planes.len() + 1 != self.cascades as usize {
            return Err(format!(
                "`Manual` lists {} planes, but must list one fewer than --cascades ({})",
                planes.len(),
                self.cascades
            ));
        }
        let planes: Vec<f64> = planes.iter().copied().map(f64::from).collect();
        let all = [&[self.near], planes.as_slice(), &[self.far]].concat();
        if all.is_sorted_by(|a, b| a < b) {
            return Ok(());
        }
        Err(format!(
            "`Manual` planes must grow, from above --near ({}) to below --far ({})",
            self.near, self.far
        ))
    }
}

fn meters(text: &str) -> Result<f64, String> {
    number_in(text, 1e-3..=1e7)
}

fn degrees(text: &str) -> Result<f64, String> {
    number_in(text, 1.0..=170.0)
}

fn aspect(text: &str) -> Result<f64, String> {
    number_in(text, 0.1..=10.0)
}

fn number_in(text: &str, range: RangeInclusive<f64>) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number| range.contains(number));
    let allowed = || format!("must be a number from {} to {}", range.start(), range.end());
    number.ok_or_else(allowed)
}

fn scheme(text: &str) -> Result<SplitScheme, String> {
    match text.to_lowercase().as_str() {
        "uniform" => Ok(SplitScheme::Uniform),
        "logarithmic" => Ok(SplitScheme::Logarithmic),
        "practical" => Ok(SplitScheme::default()),
        _ => ron::from_str(text).map_err(|error| {
            format!(
                "must be uniform, logarithmic, practical, or in RON Practical(lambda: L), \
                 Geometric(gamma: G, bias: B), GeometricScaled(gamma: G, bias: B) or \
                 Manual([C1, C2, ...]) ({error})"
            )
        }),
    }
}

fn direction(text: &str) -> Result<DVec3, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|x| x.trim().parse().ok()).collect();
    numbers
        .and_then(|numbers| numbers.try_into().ok())
        .and_then(|xyz: [f64; 3]| DVec3::from_array(xyz).try_normalize())
        .ok_or_else(|| "must be three numbers X,Y,Z, not all zero".to_owned())
}
