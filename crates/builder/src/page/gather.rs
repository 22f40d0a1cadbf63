//! Gathers the rows of a node, scattered over a chunk, into the columns of its page, and hashes
//! them.

use crate::attributes::normals::stored;
use crate::rows::row::{Rows, copy_row, position};
use crate::sample::cell::Context;
use esker_format::PagePoints;
use esker_points::MultisetHash;
use esker_points::fetch::fetch;
use std::ops::Range;

/// Rows whose columns are filled together; they stay in the first-level cache.
const BLOCK_ROWS: usize = 256;
/// Rows between one that is copied and the one that is prefetched.
const AHEAD: usize = 24;

impl Context {
    /// Makes the columns of a page from the rows `own`, in their order; also returns the hash of
    /// the points.
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
            clip_lines: Vec::new(),
            tangents: Vec::new(),
            columns: ranges.iter().map(|r| Vec::with_capacity(own.len() * r.len())).collect(),
        };
        let mut block = vec![0; BLOCK_ROWS * rows.stride];
        for (start, some) in (0..).step_by(BLOCK_ROWS).zip(own.chunks(BLOCK_ROWS)) {
            let block = &mut block[..some.len() * rows.stride];
            // Rows are copied before they are processed, so that many distant reads are in flight
            // at once.
            for ((row, &i), at) in block.chunks_exact_mut(rows.stride).zip(some).zip(start..) {
                if let Some(&ahead) = own.get(at + AHEAD) {
                    let ahead = rows.row(ahead);
                    fetch(ahead, 0);
                    fetch(ahead, ahead.len() - 1);
                }
                copy_row(row, rows.row(i));
            }
            let block = Rows { bytes: block, stride: rows.stride };
            self.rows.hash_all(block.bytes, &mut scratch, &mut hash);
            for row in block.bytes.chunks_exact(block.stride) {
                points.positions.push(position(row));
                if self.rows.has_class() {
                    points.classes.push(self.rows.class(row));
                }
                points.normals.extend(self.rows.normal(row).map(stored));
            }
            for (range, column) in ranges.iter().zip(&mut points.columns) {
                match range.len() {
                    1 => take::<1>(&block, range.start, column),
                    2 => take::<2>(&block, range.start, column),
                    4 => take::<4>(&block, range.start, column),
                    _ => take::<8>(&block, range.start, column),
                }
            }
        }
        (points, hash)
    }
}

/// Appends the `N` bytes at `at` of each row, of at most [`BLOCK_ROWS`] rows.
fn take<const N: usize>(rows: &Rows<'_>, at: usize, column: &mut Vec<u8>) {
    let mut values = [[0u8; N]; BLOCK_ROWS];
    for (value, row) in values.iter_mut().zip(rows.bytes.chunks_exact(rows.stride)) {
        value.copy_from_slice(&row[at..at + N]);
    }
    column.extend_from_slice(values[..rows.len()].as_flattened());
}
