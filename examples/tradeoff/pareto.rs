//! Settings than which none is both better and cheaper.

use crate::study::row::Row;

/// What is paid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// The shadow passes' time.
    Time,
    /// Memory.
    Memory,
}

impl Axis {
    /// The price of a row.
    pub fn of(self, row: &Row) -> f64 {
        match self {
            Self::Time => row.shadow_gpu_ms,
            Self::Memory => row.mib,
        }
    }
}

/// The rows that no other dominates: none is as cheap and has as few wrong pixels, and fewer of
/// one of the two. Cheapest first.
pub fn front(rows: &[Row], axis: Axis) -> Vec<usize> {
    let point = |row: &Row| [axis.of(row), row.wrong_pct];
    let dominates = |a: [f64; 2], b: [f64; 2]| a[0] <= b[0] && a[1] <= b[1] && a != b;
    let mut front: Vec<usize> = (0..rows.len())
        .filter(|i| {
            !rows
                .iter()
                .any(|other| dominates(point(other), point(&rows[*i])))
        })
        .collect();
    front.sort_by(|a, b| axis.of(&rows[*a]).total_cmp(&axis.of(&rows[*b])));
    front
}
