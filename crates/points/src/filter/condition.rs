//! What the conditions of a filter share: their error, the result of a test of a node, and the
//! rounding of world coordinates to fractions of a step.

use crate::lattice::Lattice;

/// Fractions of a step to which faces and corners are rounded once; all later tests are on
/// integers.
pub(super) const PARTS: i64 = 256;

/// Message about an invalid filter.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct FilterError(pub String);

/// Position of a node's points relative to a filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// No point is wanted.
    Outside,
    /// All points are wanted.
    Inside,
    /// Each point must be tested.
    Across,
}

impl Side {
    /// Side for two conditions that both must hold.
    pub fn and(self, other: Self) -> Self {
        match (self, other) {
            (Self::Outside, _) | (_, Self::Outside) => Self::Outside,
            (Self::Inside, Self::Inside) => Self::Inside,
            _ => Self::Across,
        }
    }

    /// Side for two conditions of which one is enough.
    pub(super) fn or(self, other: Self) -> Self {
        match (self, other) {
            (Self::Inside, _) | (_, Self::Inside) => Self::Inside,
            (Self::Outside, Self::Outside) => Self::Outside,
            _ => Self::Across,
        }
    }
}

/// Position of a world coordinate along an axis of the lattice, in parts of a step. Rounding makes
/// a coordinate as people write it the step that it names, despite the error of `f64`. Saturates.
pub(super) fn in_parts(lattice: &Lattice, axis: usize, world: f64) -> i64 {
    (lattice.steps_axis(axis, world) * PARTS as f64).round() as i64
}
