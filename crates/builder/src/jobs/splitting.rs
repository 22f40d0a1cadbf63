//! Splits cells of a take that have more rows than they may, so that the cut can divide them: a far
//! outlier makes cells large, and all points may then be in one.

use crate::budget::shares::SPILLED_BYTES_MAX;
use crate::error::BuildError;
use crate::rows::partition::{Bucket, Partition, RowBlock, block_of_rows};
use crate::rows::scratch::Scratch;
use crate::tree::parting::{BLOCK_ROWS, log2_of};
use esker_points::Task;
use rayon::prelude::*;

/// Splits buckets.
pub struct Splitter<'a> {
    /// Bytes of a row.
    pub stride: usize,
    /// Rows from which on a bucket is split, unless all are at one lattice point.
    pub rows_max: u64,
    /// Most bytes of rows that splitting keeps in memory.
    pub buffer_bytes_max: usize,
    /// Says whether to stop.
    pub task: &'a dyn Task,
}

impl Splitter<'_> {
    /// Splits buckets along the Morton curve, and returns them along the curve.
    ///
    /// # Errors
    /// If scratch space fails, or on request.
    pub fn split_all(
        &self,
        buckets: Vec<Bucket>,
        scratch: &mut Scratch,
    ) -> Result<Vec<Bucket>, BuildError> {
        let mut done = Vec::with_capacity(buckets.len());
        let mut open = buckets;
        open.reverse();
        while let Some(bucket) = open.pop() {
            if bucket.rows <= self.rows_max || bucket.cell.log2 == 0 {
                done.push(bucket);
            } else {
                open.extend(self.split(bucket, scratch)?.into_iter().rev());
            }
        }
        Ok(done)
    }

    /// Splits a bucket some levels below the smallest cell that holds its rows.
    fn split(&self, bucket: Bucket, scratch: &mut Scratch) -> Result<Vec<Bucket>, BuildError> {
        let stride = self.stride;
        let is_stored = !bucket.extents.is_empty();
        let map = if is_stored { Some(scratch.map()?) } else { None };
        let runs = bucket.runs(map.as_ref(), stride);
        let blocks: Vec<&[u8]> = runs.iter().flat_map(|r| r.chunks(BLOCK_ROWS * stride)).collect();
        // Rows in memory are in blocks that they share with other buckets, and are not freed
        // meanwhile.
        let bytes_max = if is_stored {
            self.buffer_bytes_max.min(SPILLED_BYTES_MAX as usize)
        } else {
            self.buffer_bytes_max / 8
        };
        let log2 = log2_of(&blocks, stride);
        let mut partition = Partition::new(stride, log2, bytes_max, is_stored);
        for group in blocks.chunks(rayon::current_num_threads().max(1)) {
            self.task.check()?;
            let log2 = partition.log2();
            let sorted: Vec<RowBlock> =
                group.par_iter().map(|rows| block_of_rows(rows, stride, log2)).collect();
            for block in sorted {
                if partition.is_full_for(&block) {
                    partition.spill(scratch)?;
                }
                partition.hold(block);
                if partition.is_full() {
                    partition.spill(scratch)?;
                }
            }
        }
        drop((blocks, runs));
        drop(map);
        if is_stored && partition.holds_rows() {
            partition.spill(scratch)?;
            scratch.flush()?;
        }
        let parts = partition.finish(scratch)?;
        scratch.release(bucket.extents);
        Ok(parts)
    }
}
