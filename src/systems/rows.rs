//! Rows of a table, looked over together.

use bevy::ecs::change_detection::Tick;

/// So many: those of a mask.
pub const ROWS: usize = 64;

/// Whether any has been written since, without branches, for several at a time.
pub fn any_newer(ticks: &[Tick], last_run: Tick, this_run: Tick) -> bool {
    let age = |tick: Tick| this_run.get().wrapping_sub(tick.get());
    let oldest = age(last_run);
    ticks
        .iter()
        .fold(false, |any, tick| any | (age(*tick) < oldest))
}

/// The rows that have been written since.
pub fn newer(ticks: &[Tick], last_run: Tick, this_run: Tick) -> u64 {
    rows_where(ticks.iter(), |tick| tick.is_newer_than(last_run, this_run))
}

/// A bit for each of at most 64.
pub fn rows_where<T>(column: impl Iterator<Item = T>, is_one: impl Fn(T) -> bool) -> u64 {
    let rows = column
        .enumerate()
        .filter_map(|(row, it)| is_one(it).then_some(row));
    rows.fold(0, |rows, row| rows | (1 << row))
}
