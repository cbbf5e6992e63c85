//! What can be wrong with a configuration.

use core::{fmt::Display, ops::RangeInclusive};

/// Farther than the Earth's diameter is a mistake, and would overflow no sooner (meters).
pub(super) const MAX_DISTANCE: f32 = 1e7;

/// Nearer than a micrometer is a mistake, too (meters).
pub(super) const MIN_DISTANCE: f32 = 1e-6;

/// A value outside its range. The message names field, value and what is allowed.
#[derive(thiserror::Error, Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum ConfigError {
    /// A number is too small, too large or not a number.
    #[error("`{field}` is {value}, but must be {allowed}")]
    OutOfRange {
        /// The field's name, as written in RON.
        field: &'static str,
        /// The value found.
        value: String,
        /// What is allowed, in words.
        allowed: String,
    },
    /// A list has the wrong length.
    #[error("`{field}` lists {count} values, but must list {expected}: {reason}")]
    WrongCount {
        /// The field's name, as written in RON.
        field: &'static str,
        /// Values found.
        count: usize,
        /// Values needed.
        expected: usize,
        /// Why that many.
        reason: &'static str,
    },
    /// Manual split planes must grow from near to far.
    #[error(
        "`{field}` plane {index} is {value}, but must lie above {above} (the plane before it, \
         or `near`) and below {below} (`far`)"
    )]
    NotIncreasing {
        /// The field's name, as written in RON.
        field: &'static str,
        /// Position in the list, from 0.
        index: usize,
        /// The value found.
        value: f32,
        /// The lower bound, exclusive.
        above: f32,
        /// The upper bound, exclusive.
        below: f32,
    },
}

impl ConfigError {
    /// The name of the field at fault, as written in RON.
    pub fn field(&self) -> &'static str {
        match self {
            Self::OutOfRange { field, .. }
            | Self::WrongCount { field, .. }
            | Self::NotIncreasing { field, .. } => field,
        }
    }

    pub(super) fn out_of_range(
        field: &'static str,
        value: impl Display,
        allowed: impl Display,
    ) -> Self {
        Self::OutOfRange {
            field,
            value: value.to_string(),
            allowed: allowed.to_string(),
        }
    }

    pub(super) fn check_range<T: PartialOrd + Display>(
        field: &'static str,
        value: T,
        range: RangeInclusive<T>,
    ) -> Result<(), Self> {
        if range.contains(&value) {
            return Ok(());
        }
        let allowed = format!("from {} to {}", range.start(), range.end());
        Err(Self::out_of_range(field, value, allowed))
    }

    pub(super) fn check_distance(field: &'static str, value: f32) -> Result<(), Self> {
        Self::check_range(field, value, MIN_DISTANCE..=MAX_DISTANCE)
    }
}
