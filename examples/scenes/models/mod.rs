//! What can stand in a scene. Every model is one unit tall, on y = 0, facing −z.

mod chess;
mod folk;
mod knight;
mod mine;
mod plants;
mod robot;
mod rock;
mod town;
mod windmill;

use bevy::prelude::*;

use super::{format::ModelKind, mesh::Body};

/// A model: its body, and parts that hang on it.
pub struct Model {
    /// What does not move by itself.
    pub body: Body,
    /// What the body is made of.
    pub finish: Finish,
    /// Further parts, each with its joint.
    pub parts: Vec<Part>,
}

/// A body that turns about its joint.
pub struct Part {
    /// In the joint's frame.
    pub body: Body,
    /// What it is made of.
    pub finish: Finish,
    /// Place of the joint.
    pub joint: Transform,
    /// How it turns.
    pub turn: Turn,
}

/// What a body is made of: its gloss. Colors are in the mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Finish {
    /// Earth, leaves, cloth.
    Matte,
    /// Paint, leather, wood.
    Satin,
    /// Lacquer and polished stone.
    Polished,
    /// Worked metal.
    Metal,
}

/// How a part turns about its joint.
#[derive(Component, Debug, Clone, Copy)]
pub enum Turn {
    /// Not at all.
    Rest,
    /// Round and round (axis, radians per second).
    Spin(Vec3, f32),
    /// To and fro (axis, amplitude in radians, radians per second, phase).
    Swing(Vec3, f32, f32, f32),
}

/// What varies between objects of one group.
#[derive(Clone, Copy)]
pub struct Style {
    /// Segments of a round body.
    pub segments: u32,
    /// Main and second color (sRGB).
    pub colors: [[f32; 3]; 2],
    /// Chooses among variants.
    pub seed: u64,
    /// Number of the variant.
    pub variant: u32,
}

impl Style {
    /// Segments for a part of lesser importance.
    fn fine(&self, factor: f32) -> u32 {
        ((self.segments as f32 * factor) as u32).max(5)
    }
}

/// Builds a model.
pub fn build(kind: ModelKind, style: Style) -> Model {
    match kind {
        ModelKind::Robot => robot::robot(style),
        ModelKind::ClawBot => mine::claw_bot(style),
        ModelKind::Windmill => windmill::windmill(style),
        ModelKind::Rock => rock::rock(style),
        ModelKind::Dwarf => folk::dwarf(style),
        ModelKind::Knight => knight::knight(style),
        ModelKind::Tree => plants::tree(style),
        ModelKind::Cactus => plants::cactus(style),
        ModelKind::House => town::house(style),
        ModelKind::Lamp => town::lamp(style),
        ModelKind::Pawn
        | ModelKind::Rook
        | ModelKind::Horse
        | ModelKind::Bishop
        | ModelKind::Queen
        | ModelKind::King => chess::piece(kind, style),
    }
}

fn at(x: f32, y: f32, z: f32) -> Transform {
    Transform::from_xyz(x, y, z)
}

fn sized(x: f32, y: f32, z: f32, size: Vec3) -> Transform {
    at(x, y, z).with_scale(size)
}

fn resting(body: Body, finish: Finish) -> Model {
    Model {
        body,
        finish,
        parts: Vec::new(),
    }
}

fn fixed(body: Body, finish: Finish) -> Part {
    Part {
        body,
        finish,
        joint: Transform::IDENTITY,
        turn: Turn::Rest,
    }
}
