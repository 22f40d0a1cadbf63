//! Values of fields on their way to the parsers of the command line and back, and errors with the
//! name of a field.

use anyhow::{Context, Result};
use std::fmt::Display;

/// Adds the name of a field to an error.
pub(super) fn in_field<T, E>(field: impl Display, result: Result<T, E>) -> Result<T>
where
    Result<T, E>: Context<T, E>,
{
    result.with_context(|| format!("`{field}`"))
}

/// Numbers as on the command line.
pub(super) fn joined(numbers: &[f64]) -> String {
    numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(",")
}

/// The shortest decimal number that is read as `value`.
pub(super) fn decimal(value: f32) -> f64 {
    value.to_string().parse().unwrap_or_else(|_| f64::from(value))
}
