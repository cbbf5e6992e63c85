//! Heights from a file.

use std::{fs, io};

use bevy::prelude::*;

use super::format::HeightsDescription;

/// A grid of heights.
#[derive(Debug)]
pub struct Heights {
    description: HeightsDescription,
    steps: Vec<u16>,
}

impl Heights {
    /// Reads the file.
    ///
    /// # Errors
    /// If it cannot be read or is not as long as described.
    pub fn read(description: &HeightsDescription) -> io::Result<Self> {
        let bytes = fs::read(&description.file)?;
        let [columns, rows] = description.size;
        if bytes.len() != 2 * columns * rows || columns < 2 || rows < 2 {
            let message = format!("{} bytes are not {columns} by {rows} heights", bytes.len());
            return Err(io::Error::new(io::ErrorKind::InvalidData, message));
        }
        let steps = bytes.as_chunks().0.iter().copied();
        Ok(Self {
            description: description.clone(),
            steps: steps.map(u16::from_le_bytes).collect(),
        })
    }

    /// Height at (x, z), bilinear (meters); at the edge's height beyond it.
    pub fn at(&self, x: f32, z: f32) -> f32 {
        let HeightsDescription {
            size: [columns, rows],
            spacing,
            scale,
            offset,
            origin,
            ..
        } = self.description;
        let [column, row] = [
            (origin[0] + x / spacing[0]).clamp(0.0, (columns - 1) as f32),
            (origin[1] + z / spacing[1]).clamp(0.0, (rows - 1) as f32),
        ];
        let [i, j] = [
            (column as usize).min(columns - 2),
            (row as usize).min(rows - 2),
        ];
        let step = |i: usize, j: usize| f32::from(self.steps[j * columns + i]);
        let (across, down) = (column - i as f32, row - j as f32);
        let north = step(i, j).lerp(step(i + 1, j), across);
        let south = step(i, j + 1).lerp(step(i + 1, j + 1), across);
        offset + scale * north.lerp(south, down)
    }
}
