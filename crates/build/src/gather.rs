//! Gathering: a node's own rows, wherever they lie in a chunk, as the columns of its page, and their hash.

use crate::row::Rows;
use crate::tree::Context;
use esker_format::PagePoints;
use esker_points::MultisetHash;
use std::ops::Range;

/// Rows whose columns are filled together: they stay in the first-level cache meanwhile.
const BLOCK_ROWS: usize = 256;

impl Context {
    /// The columns of a page, and the hash of its points.
    pub fn page_points(
        &self,
        rows: &Rows<'_>,
        own: &[u32],
        radius_codes: Vec<u8>,
    ) -> (PagePoints, MultisetHash) {
        let (mut hash, mut scratch) = (MultisetHash::default(), Vec::new());
        let ranges: Vec<Range<usize>> =
            (0..self.rows.attribute_count()).map(|a| self.rows.attribute(a)).collect();
        let mut points = PagePoints {
            positions: Vec::with_capacity(own.len()),
            radius_codes,
            classes: Vec::new(),
            normals: Vec::new(),
            columns: ranges.iter().map(|r| Vec::with_capacity(own.len() * r.len())).collect(),
        };
        for block in own.chunks(BLOCK_ROWS) {
            for &i in block {
                let row = rows.row(i);
                self.rows.hash(row, &mut scratch, &mut hash);
                points.positions.push(rows.position(i));
                if self.rows.has_class() {
                    points.classes.push(self.rows.class(row));
                }
            }
            for (range, column) in ranges.iter().zip(&mut points.columns) {
                match range.len() {
                    1 => take::<1>(rows, block, range.start, column),
                    2 => take::<2>(rows, block, range.start, column),
                    4 => take::<4>(rows, block, range.start, column),
                    _ => take::<8>(rows, block, range.start, column),
                }
            }
        }
        (points, hash)
    }
}

/// Appends the `N` bytes at `at` of these rows.
fn take<const N: usize>(rows: &Rows<'_>, block: &[u32], at: usize, column: &mut Vec<u8>) {
    let mut values = [[0u8; N]; BLOCK_ROWS];
    for (value, &i) in values.iter_mut().zip(block) {
        value.copy_from_slice(&rows.row(i)[at..at + N]);
    }
    column.extend_from_slice(values[..block.len()].as_flattened());
}
