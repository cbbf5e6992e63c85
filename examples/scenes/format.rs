//! The form of `*.scene.ron`.

use bevy::{
    asset::{AssetLoader, LoadContext, io::Reader},
    prelude::*,
    reflect::TypePath,
};
use serde::Deserialize;

/// A scene: where to look from, what light falls, and what stands where.
#[derive(Asset, TypePath, Deserialize, Debug, Clone)]
#[serde(deny_unknown_fields)]
pub struct SceneDescription {
    /// Name for people.
    pub title: String,
    /// Everything random follows from it.
    pub seed: u64,
    /// Asset path of the shadow preset.
    pub shadows: String,
    /// Bevy's own shadows as suit the scene best.
    #[serde(default)]
    pub built_in: BuiltInDescription,
    /// Lens and path.
    pub camera: CameraPath,
    /// The directional light.
    pub sun: SunDescription,
    /// What is overhead.
    pub sky: SkyDescription,
    /// What is between here and there.
    pub haze: HazeDescription,
    /// Light from everywhere.
    pub ambient: AmbientDescription,
    /// What everything stands on.
    pub ground: GroundDescription,
    /// What stands on it.
    pub groups: Vec<Group>,
    /// What else stands on it, from glTF files.
    #[serde(default)]
    pub imports: Vec<Import>,
}

/// Bevy's own shadows, as the trade-off report tunes them: with the fewest wrong pixels at the
/// scene's poses.
#[derive(Deserialize, Debug, Clone, Copy, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct BuiltInDescription {
    /// Where the first cascade ends (meters).
    pub first_far: f32,
    /// `DirectionalLight::shadow_normal_bias`.
    pub normal_bias: f32,
    /// `DirectionalLight::shadow_depth_bias`.
    pub depth_bias: f32,
}

impl Default for BuiltInDescription {
    fn default() -> Self {
        Self {
            first_far: 60.0,
            normal_bias: 1.2,
            depth_bias: 0.05,
        }
    }
}

/// The camera's lens and the closed path it flies along.
#[derive(Deserialize, Debug, Clone)]
#[serde(deny_unknown_fields)]
pub struct CameraPath {
    /// Distance of the near plane (meters).
    pub near: f32,
    /// Distance of the far plane (meters).
    pub far: f32,
    /// Vertical field of view (degrees).
    pub fov_degrees: f32,
    /// Time for one round (seconds).
    pub seconds: f32,
    /// Stations of the path.
    pub poses: Vec<Pose>,
}

/// A station of a camera path. Heights are above the ground there (meters).
#[derive(Deserialize, Debug, Clone)]
#[serde(deny_unknown_fields)]
pub struct Pose {
    /// Name, for pictures' labels.
    pub name: String,
    /// Where the camera is.
    pub eye: [f32; 3],
    /// What it looks at.
    pub target: [f32; 3],
}

/// A sun.
#[derive(Deserialize, Debug, Clone)]
#[serde(deny_unknown_fields)]
pub struct SunDescription {
    /// Where it stands, clockwise from −z seen from above (degrees).
    pub azimuth: f32,
    /// Its height over the horizon (degrees).
    pub elevation: f32,
    /// Its light (lux).
    pub illuminance: f32,
    /// Its color (sRGB).
    pub color: [f32; 3],
    /// How fast its azimuth grows when it moves.
    pub degrees_per_second: f32,
}

/// A sky. Its horizon has the haze's color.
#[derive(Deserialize, Debug, Clone)]
#[serde(deny_unknown_fields)]
pub struct SkyDescription {
    /// Color overhead (sRGB).
    pub zenith: [f32; 3],
    /// How much of it is clouded, 0 to 1.
    pub clouds: f32,
}

/// A haze, denser with the square of the distance.
#[derive(Deserialize, Debug, Clone)]
#[serde(deny_unknown_fields)]
pub struct HazeDescription {
    /// Its color (sRGB).
    pub color: [f32; 3],
    /// Distance at which it has swallowed 95 % of the contrast (meters).
    pub visibility: f32,
    /// How much sunlight it scatters towards a camera that looks at the sun.
    pub glow: f32,
    /// How narrow that glow is.
    pub glow_exponent: f32,
}

/// A light without direction.
#[derive(Deserialize, Debug, Clone)]
#[serde(deny_unknown_fields)]
pub struct AmbientDescription {
    /// Its color (sRGB).
    pub color: [f32; 3],
    /// Its brightness (cd/m²).
    pub brightness: f32,
}

/// The ground: a square grid.
#[derive(Deserialize, Debug, Clone)]
#[serde(deny_unknown_fields)]
pub struct GroundDescription {
    /// Its relief.
    pub kind: GroundKind,
    /// Length of its sides (meters).
    pub size: f32,
    /// Cells per side, two triangles each.
    pub cells: u32,
    /// Height of its relief, as a factor.
    #[serde(default = "full_relief")]
    pub relief: f32,
    /// Main and second color (sRGB).
    pub colors: [[f32; 3]; 2],
    /// Where a measured ground's heights are.
    #[serde(default)]
    pub heights: Option<HeightsDescription>,
}

/// A grid of heights in a file: rows from north (−z) to south, each from west (−x) to east, of
/// unsigned little-endian 16-bit numbers.
#[derive(Deserialize, Debug, Clone)]
#[serde(deny_unknown_fields)]
pub struct HeightsDescription {
    /// The file, from the current folder.
    pub file: String,
    /// Columns and rows.
    pub size: [usize; 2],
    /// Between columns and between rows (meters).
    pub spacing: [f32; 2],
    /// Height is so many meters per step,
    pub scale: f32,
    /// from this one on (meters).
    pub offset: f32,
    /// Column and row that lie at the scene's origin.
    pub origin: [f32; 2],
}

fn full_relief() -> f32 {
    1.0
}

/// Reliefs.
#[derive(Deserialize, Debug, Clone, Copy, PartialEq, Eq)]
pub enum GroundKind {
    /// Gentle swells.
    Plain,
    /// Flat, in eight by eight fields within a frame.
    Board,
    /// Dunes.
    Desert,
    /// Ridges around a terraced open pit.
    Pit,
    /// Heights from a file.
    Measured,
}

/// Objects of one kind.
#[derive(Deserialize, Debug, Clone)]
#[serde(deny_unknown_fields)]
pub struct Group {
    /// What they are.
    pub model: ModelKind,
    /// Segments of their round parts, as a factor.
    pub detail: f32,
    /// Height, least and greatest (meters).
    pub height: [f32; 2],
    /// Where they stand.
    pub layout: Layout,
    /// Main and second color (sRGB).
    pub colors: [[f32; 3]; 2],
    /// How many shapes of the model there are, shared by the group's objects.
    #[serde(default = "one_variant")]
    pub variants: u32,
    /// How they move.
    #[serde(default)]
    pub motion: Motion,
}

fn one_variant() -> u32 {
    1
}

/// Objects from a glTF file: its first scene.
#[derive(Deserialize, Debug, Clone)]
#[serde(deny_unknown_fields)]
pub struct Import {
    /// The file, from the current folder.
    pub file: String,
    /// Least and greatest scale.
    pub scale: [f32; 2],
    /// Where they stand.
    pub layout: Layout,
}

/// What can be built.
#[derive(Deserialize, Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelKind {
    /// A war robot on two legs.
    Robot,
    /// A chess piece.
    Pawn,
    /// A chess piece.
    Rook,
    /// The chess piece otherwise called a knight.
    Horse,
    /// A chess piece.
    Bishop,
    /// A chess piece.
    Queen,
    /// A chess piece.
    King,
    /// A bearded axe-bearer.
    Dwarf,
    /// A lancer in plate.
    Knight,
    /// A tree in leaf.
    Tree,
    /// A saguaro.
    Cactus,
    /// A tracked digger with a claw.
    ClawBot,
    /// A wind pump on a lattice mast.
    Windmill,
    /// A boulder among pebbles.
    Rock,
    /// A town house of three to five stories.
    House,
    /// A street lamp.
    Lamp,
}

/// Where a group's objects stand.
#[derive(Deserialize, Debug, Clone)]
pub enum Layout {
    /// Rows and columns around a center.
    Ranks {
        /// Middle of the ranks (x, z).
        center: [f32; 2],
        /// Objects side by side, and ranks behind each other.
        count: [u32; 2],
        /// Distance between neighbors along both (meters).
        spacing: [f32; 2],
        /// Where they look, clockwise from −z (degrees).
        facing: f32,
    },
    /// At random in a ring, no two closer than a distance.
    Scatter {
        /// How many.
        count: u32,
        /// Middle of the ring (x, z).
        center: [f32; 2],
        /// Inner and outer radius (meters).
        radius: [f32; 2],
        /// Least distance between two (meters).
        apart: f32,
        /// Greatest slope of the ground under one (meters per meter).
        #[serde(default = "any_slope")]
        slope: f32,
    },
    /// Along the sides of a town's blocks, looking at its streets.
    Blocks {
        /// Middle of the town (x, z).
        center: [f32; 2],
        /// Blocks along x and z.
        count: [u32; 2],
        /// Distance between the middles of neighboring blocks (meters).
        pitch: [f32; 2],
        /// Sides of the rectangles about blocks' middles on which objects stand (meters).
        size: [f32; 2],
        /// Distance between neighbors, or a little more (meters).
        spacing: f32,
    },
    /// Where listed: x, z and facing (degrees).
    Places(Vec<(f32, f32, f32)>),
}

fn any_slope() -> f32 {
    0.45
}

/// How objects move.
#[derive(Component, Deserialize, Debug, Clone, Copy, Default, PartialEq)]
pub enum Motion {
    /// Not at all.
    #[default]
    Still,
    /// Where they are, their parts turning and swinging.
    Parts {
        /// Speed of the parts, as a factor.
        rate: f32,
    },
    /// There and back again along a straight line, with a turn at either end.
    March {
        /// Length of the line (meters).
        length: f32,
        /// Radius of the turns (meters).
        radius: f32,
        /// Speed (meters per second).
        speed: f32,
    },
    /// Round a circle.
    Walk {
        /// Radius of the circle (meters).
        radius: f32,
        /// Speed (meters per second).
        speed: f32,
    },
}

impl CameraPath {
    /// The camera's place after a time, on a smooth closed curve through the poses. `ground`
    /// gives the height of the ground at (x, z).
    pub fn sample(&self, seconds: f32, ground: impl Fn(f32, f32) -> f32) -> Transform {
        let count = self.poses.len();
        if count == 0 {
            return Transform::IDENTITY;
        }
        let along = (seconds / self.seconds).rem_euclid(1.0) * count as f32;
        let index = along as usize % count;
        let pose = |offset: usize| &self.poses[(index + count + offset - 1) % count];
        let on_curve = |of: &dyn Fn(&Pose) -> Vec3| {
            let [a, b, c, d] = [of(pose(0)), of(pose(1)), of(pose(2)), of(pose(3))];
            let t = along.fract();
            // Catmull–Rom.
            0.5 * (2.0 * b
                + (c - a) * t
                + (2.0 * a - 5.0 * b + 4.0 * c - d) * t * t
                + (3.0 * (b - c) + d - a) * t * t * t)
        };
        let place = |p: [f32; 3]| Vec3::new(p[0], p[1] + ground(p[0], p[2]), p[2]);
        let mut eye = on_curve(&|pose| place(pose.eye));
        let target = on_curve(&|pose| place(pose.target));
        eye.y = eye.y.max(ground(eye.x, eye.z) + 1.5);
        Transform::from_translation(eye).looking_at(target, Vec3::Y)
    }

    /// The camera at one of its poses.
    pub fn pose(&self, index: usize, ground: impl Fn(f32, f32) -> f32) -> Transform {
        self.sample(
            self.seconds * index as f32 / self.poses.len().max(1) as f32,
            ground,
        )
    }
}

/// Why a scene could not be loaded.
#[derive(thiserror::Error, Debug)]
pub enum SceneError {
    /// The file could not be read.
    #[error("could not read the scene: {0}")]
    Io(#[from] std::io::Error),
    /// The file does not describe a scene.
    #[error("{0}: {1}")]
    Parse(String, ron::error::SpannedError),
}

/// Loads `*.scene.ron`.
#[derive(TypePath, Default)]
pub struct SceneLoader;

impl AssetLoader for SceneLoader {
    type Asset = SceneDescription;
    type Settings = ();
    type Error = SceneError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        _: &(),
        context: &mut LoadContext<'_>,
    ) -> Result<SceneDescription, SceneError> {
        let mut bytes = Vec::new();
        reader.read_to_end(&mut bytes).await?;
        ron::de::from_bytes(&bytes)
            .map_err(|error| SceneError::Parse(context.path().to_string(), error))
    }

    fn extensions(&self) -> &[&str] {
        &["scene.ron"]
    }
}
