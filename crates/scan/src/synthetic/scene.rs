//! The trait of generated scenes: a world and how it is scanned.

use super::point::Point;
use crate::source::Scanner;
use esker_points::Grid;
use std::ops::Range;

/// Points of a block, which are generated together and become a batch.
pub(crate) const BLOCK_POINTS: u64 = 1 << 14;

/// A world and how it is scanned.
pub(crate) trait Scene: Send + Sync {
    /// The grid of its coordinates.
    fn grid(&self) -> Grid;
    /// Positions of the scanners, if they do not move.
    fn scanner(&self) -> Option<Scanner> {
        None
    }
    /// Corners of a box around all points, without the grid's offset.
    fn bounds(&self) -> [[f64; 3]; 2];
    /// Appends the points of a range, which begins at a multiple of [`BLOCK_POINTS`] and is not
    /// longer.
    fn block(&self, range: Range<u64>, out: &mut Vec<Point>);
}
