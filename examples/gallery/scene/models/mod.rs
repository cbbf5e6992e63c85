//! What can stand in a scene. Every model is one unit tall, on y = 0, facing −z.

mod chess;
mod folk;
mod machines;
mod nature;

use bevy::prelude::*;

use super::{format::ModelKind, mesh::Body};

/// A model: one resting body, and parts that move against it.
pub struct Model {
    /// What does not move by itself.
    pub body: Body,
    /// Moving parts, each with its joint.
    pub parts: Vec<Part>,
}

/// A body that turns about its joint.
pub struct Part {
    /// In the joint's frame.
    pub body: Body,
    /// Place of the joint.
    pub joint: Transform,
    /// How it turns.
    pub turn: Turn,
}

/// How a part turns about its joint.
#[derive(Component, Debug, Clone, Copy)]
pub enum Turn {
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
    /// Main and second colour (sRGB).
    pub colors: [[f32; 3]; 2],
    /// Chooses among variants.
    pub seed: u64,
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
        ModelKind::Robot => machines::robot(style),
        ModelKind::ClawBot => machines::claw_bot(style),
        ModelKind::Windmill => machines::windmill(style),
        ModelKind::Dwarf => folk::dwarf(style),
        ModelKind::Knight => folk::knight(style),
        ModelKind::Tree => nature::tree(style),
        ModelKind::Cactus => nature::cactus(style),
        ModelKind::Rock => nature::rock(style),
        piece => chess::piece(piece, style),
    }
}

fn at(x: f32, y: f32, z: f32) -> Transform {
    Transform::from_xyz(x, y, z)
}

fn resting(body: Body) -> Model {
    Model { body, parts: Vec::new() }
}
