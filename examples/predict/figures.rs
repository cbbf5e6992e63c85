//! Figures of Lloyd et al. 2006, from maps laid over slices and faces; the
//! paper has them from closed forms.

use core::error::Error;
use std::{
    fs,
    path::{Path, PathBuf},
};

use bevy_pssm::{
    SplitScheme,
    geometry::{
        face,
        slice::{Slice, ViewVolume},
        warp::WarpFrame,
    },
    plan::split_planes,
};
use glam::{DMat3, DVec2, DVec3};
use serde::Serialize;

use super::{hemisphere, plot};

/// A figure of the paper.
#[derive(clap::ValueEnum, Debug, Clone, Copy, PartialEq, Eq)]
pub enum Figure {
    /// Figure 7: storage factor over the hemisphere of directions that light comes from.
    Lloyd7,
    /// Figure 10: storage factor over the number of z-partitions, light from above.
    Lloyd10,
    /// Figure 12: storage factor over the number of shadow maps, light from above and behind.
    Lloyd12,
}

/// Where light comes from.
#[derive(Serialize, Debug, Clone, Copy, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub enum Light {
    Overhead,
    Behind,
}

/// What is partitioned: depth (ZP), or faces and depth (FP+ZP); and whether maps are warped
/// (W).
#[derive(Serialize, Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scheme {
    #[serde(rename = "ZP")]
    Depth,
    #[serde(rename = "ZP+W")]
    DepthWarped,
    /// Warped as in Wimmer et al. 2004, not for the least worst error.
    #[serde(rename = "ZP+LiSPSM")]
    DepthLispsm,
    #[serde(rename = "FP+ZP+W")]
    FacesDepthWarped,
    /// Not a set of maps: one map under the best of all parametrisations.
    #[serde(rename = "optimum")]
    Optimum,
}

/// A point of a curve.
#[derive(Serialize, Debug, Clone, Copy)]
pub struct Point {
    pub light: Light,
    pub scheme: Scheme,
    /// z-partitions; none for the optimum, which does not depend on them.
    pub partitions: Option<u32>,
    /// Shadow maps that must be kept for the scheme.
    pub maps: Option<u32>,
    /// Texels needed so that none shows, per pixel of the image.
    pub storage_factor: f64,
}

/// Far over near of the paper's figures.
pub const RATIO: f64 = 1000.0;
/// Half the field of view in the paper's figures (degrees).
pub const THETA: f64 = 30.0;

const PARTITIONS: u32 = 16;
const MAPS: u32 = 33;

impl Figure {
    /// Its name in file names.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lloyd7 => "lloyd7",
            Self::Lloyd10 => "lloyd10",
            Self::Lloyd12 => "lloyd12",
        }
    }

    /// All points of a figure of curves, curve by curve. `None` would be a slice without a map.
    pub fn points(self) -> Option<Vec<Point>> {
        use {Light::*, Scheme::*};
        let curves: &[(Light, Scheme, u32)] = match self {
            Self::Lloyd7 => &[],
            Self::Lloyd10 => &[
                (Overhead, Depth, PARTITIONS),
                (Overhead, DepthWarped, PARTITIONS),
            ],
            Self::Lloyd12 => &[
                (Overhead, Depth, MAPS),
                (Overhead, DepthWarped, MAPS),
                (Overhead, FacesDepthWarped, MAPS / 4),
                (Behind, Depth, MAPS),
                (Behind, DepthWarped, MAPS),
                (Behind, FacesDepthWarped, MAPS / 4),
            ],
        };
        let mut points = Vec::new();
        for (light, scheme, partitions) in curves {
            for k in 1..=*partitions {
                points.push(point(*light, *scheme, k)?);
            }
        }
        if self == Self::Lloyd10 {
            points.push(Point {
                light: Overhead,
                scheme: Optimum,
                partitions: None,
                maps: None,
                storage_factor: RATIO.ln() / (2.0 * tan_theta()),
            });
        }
        Some(points)
    }
}

/// Writes a figure into a folder: its points and its plot.
pub fn write(figure: Figure, folder: &Path) -> Result<[PathBuf; 2], Box<dyn Error>> {
    let no_map = "a slice has no map";
    let files = ["csv", "svg"].map(|kind| folder.join(figure.name()).with_extension(kind));
    let context = |error: &dyn Error| format!("{}: {error}", folder.display());
    fs::create_dir_all(folder).map_err(|error| context(&error))?;
    let mut writer = csv::Writer::from_path(&files[0]).map_err(|error| context(&error))?;
    let document = if figure == Figure::Lloyd7 {
        let spots = hemisphere::spots().ok_or(no_map)?;
        spots.iter().try_for_each(|spot| writer.serialize(spot))?;
        hemisphere::svg(&spots)?
    } else {
        let points = figure.points().ok_or(no_map)?;
        points
            .iter()
            .try_for_each(|point| writer.serialize(point))?;
        plot::svg(figure, &points)?
    };
    writer.flush()?;
    fs::write(&files[1], document).map_err(|error| context(&error))?;
    Ok(files)
}

fn tan_theta() -> f64 {
    THETA.to_radians().tan()
}

/// The storage factor of a scheme for light from a direction (unit vector; the camera looks along
/// −z). `None` would be a slice without a map.
pub fn storage(scheme: Scheme, to_light: DVec3, partitions: u32) -> Option<f64> {
    let tan = DVec2::splat(tan_theta());
    let view = ViewVolume {
        eye: DVec3::ZERO,
        axes: DMat3::IDENTITY,
        min: [DVec2::ZERO, -tan],
        max: [DVec2::ZERO, tan],
        near: 0.0,
        far: f64::INFINITY,
    };
    let planes = split_planes(&SplitScheme::Logarithmic, 1.0, RATIO, partitions as usize);
    let slices = planes.windows(2).map(|pair| view.slice(pair[0], pair[1]));
    let slices: Vec<_> = slices.collect::<Option<_>>()?;
    if scheme == Scheme::FacesDepthWarped {
        of_faces(&view, &slices, to_light)
    } else {
        of_slices(&view, &slices, to_light, scheme)
    }
}

fn point(light: Light, scheme: Scheme, partitions: u32) -> Option<Point> {
    let to_light = match light {
        Light::Overhead => DVec3::Y,
        Light::Behind => DVec3::Z,
    };
    let storage_factor = storage(scheme, to_light, partitions)?;
    let maps = match (scheme, light) {
        // As many sides get a map as some direction of light needs, or the number would change
        // with it and shadows would pop.
        (Scheme::FacesDepthWarped, Light::Overhead) => 4 * partitions,
        (Scheme::FacesDepthWarped, Light::Behind) => 4 * partitions + 1,
        _ => partitions,
    };
    Some(Point {
        light,
        scheme,
        partitions: Some(partitions),
        maps: Some(maps),
        storage_factor,
    })
}

fn of_slices(view: &ViewVolume, slices: &[Slice], to_light: DVec3, scheme: Scheme) -> Option<f64> {
    let frame = WarpFrame::of_view(view, to_light)?;
    let of_slice = |slice: &Slice| {
        let body = slice.vertices();
        let depth = |corner: usize| view.depth_of(slice.corners[corner]);
        let strength = match scheme {
            Scheme::DepthWarped => frame.guarded_minimax_strength(&body),
            Scheme::DepthLispsm => frame.lispsm_strength(depth(0), depth(4)),
            _ => 0.0,
        };
        Some(frame.worst_aliasing(&body, strength)?.storage())
    };
    slices.iter().map(of_slice).sum()
}

fn of_faces(view: &ViewVolume, slices: &[Slice], to_light: DVec3) -> Option<f64> {
    let near = face::near(view, slices.first()?, to_light);
    let sides = slices
        .iter()
        .flat_map(|slice| face::sides(view, slice, to_light));
    let of_face = |face: face::Face| Some(face.worst_aliasing()?.storage());
    sides.chain(near).map(of_face).sum()
}
