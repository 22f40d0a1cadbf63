//! Splits a bucket that does not fit memory into smaller cells. Rows that go to scratch a second
//! time are recorded in the journal and freed at their old place run by run, so that at most one
//! run of rows is in scratch twice.

use crate::budget::shares::SPILLED_BYTES_MAX;
use crate::error::BuildError;
use crate::rows::journal_record::{Kind, Record};
use crate::rows::partition::{Bucket, Partition, RowBlock, block_of_rows};
use crate::rows::row::position;
use crate::rows::scratch::{Extent, take_first};
use crate::rows::store::Store;
use crate::tree::levels::TreeBuilder;
use esker_points::Cell;
use rayon::prelude::*;

/// Octree levels by which a bucket is split at a time.
const SPLIT_LEVELS: u8 = 3;
/// Rows that are sorted into cells together.
pub(crate) const BLOCK_ROWS: usize = 1 << 16;

/// Most bytes of rows that are in scratch twice while a bucket is split with this many bytes of
/// rows in memory.
pub fn duplicate_bytes_max(buffer_bytes_max: u64, row_bytes: usize) -> u64 {
    let block_bytes = (BLOCK_ROWS * row_bytes) as u64;
    (buffer_bytes_max.min(SPILLED_BYTES_MAX) / 2).max(block_bytes)
}

/// A bucket that is being split into smaller cells.
struct BucketSplitter<'a> {
    store: &'a mut Store,
    partition: Partition,
    /// Places of rows in scratch that are not split yet.
    left: Vec<Extent>,
    /// Record of rows that are being written to scratch, and their old places.
    moving: (Option<Record>, Vec<Extent>),
}

impl TreeBuilder<'_> {
    /// Splits a bucket some levels below the smallest cell that holds its rows, so that a far
    /// outlier, or many coincident points, cost one pass and not one for each level.
    pub(crate) fn split(&mut self, mut bucket: Bucket) -> Result<Vec<Bucket>, BuildError> {
        let (stride, store) = (self.context.rows.bytes(), &mut *self.store);
        let is_stored = !bucket.extents.is_empty();
        // Rows that an earlier build has split are restored from the journal.
        let mut restored = Vec::new();
        while let Some(spilled) = store.resume_split(&mut bucket, stride)? {
            restored.push(spilled);
        }
        let map = store.map(&bucket)?;
        let runs = bucket.runs(map.as_ref(), stride);
        store.check_rows(&bucket, &runs, &self.context.rows)?;
        let blocks: Vec<&[u8]> = runs.iter().flat_map(|r| r.chunks(BLOCK_ROWS * stride)).collect();
        let log2 = restored.first().map_or_else(|| log2_of(&blocks, stride), |first| first.log2);
        // Rows in memory are in blocks shared with other buckets, so they
        // cannot be freed meanwhile.
        let buffer_bytes_max = if is_stored {
            self.buffer_bytes_max.min(SPILLED_BYTES_MAX as usize)
        } else {
            self.buffer_bytes_max / 8
        };
        let mut partition = Partition::new(stride, log2, buffer_bytes_max, is_stored);
        restored.iter().for_each(|spilled| partition.restore(spilled));
        let left = bucket.extents.clone();
        let mut splitter = BucketSplitter { store, partition, left, moving: Default::default() };
        for group in blocks.chunks(rayon::current_num_threads().max(1)) {
            self.task.check()?;
            let log2 = splitter.partition.log2();
            let sorted: Vec<_> =
                group.par_iter().map(|rows| block_of_rows(rows, stride, log2)).collect();
            sorted.into_iter().try_for_each(|block| splitter.add(block))?;
        }
        drop((blocks, runs));
        drop(bucket);
        splitter.finish(is_stored)
    }
}

impl BucketSplitter<'_> {
    fn add(&mut self, block: RowBlock) -> Result<(), BuildError> {
        if self.partition.is_full_for(&block) {
            self.spill()?;
        }
        self.partition.hold(block);
        if self.partition.is_full() { self.spill() } else { Ok(()) }
    }

    /// Moves all rows in memory to scratch.
    fn spill(&mut self) -> Result<(), BuildError> {
        self.complete_move()?;
        let spilled = self.partition.spill(&mut self.store.scratch)?;
        if self.left.is_empty() {
            return Ok(());
        }
        if self.store.journal.keeps_rows() {
            let mut record = Record::new(Kind::Split);
            spilled.put(&mut record);
            self.moving.0 = Some(record);
        }
        self.moving.1 = take_first(&mut self.left, spilled.bytes());
        Ok(())
    }

    /// Waits until moved rows are in scratch, records them, and frees their old places.
    fn complete_move(&mut self) -> Result<(), BuildError> {
        let (record, extents) = std::mem::take(&mut self.moving);
        if extents.is_empty() {
            return Ok(());
        }
        self.store.scratch.flush()?;
        record.map_or(Ok(()), |record| self.store.journal.append(record))?;
        self.store.scratch.release(extents);
        Ok(())
    }

    /// Returns the smaller buckets, in scratch if the bucket `was_stored` there.
    fn finish(mut self, was_stored: bool) -> Result<Vec<Bucket>, BuildError> {
        if was_stored && self.partition.holds_rows() {
            self.spill()?;
        }
        self.complete_move()?;
        self.partition.finish(&mut self.store.scratch)
    }
}

/// Log2 of the edge of the cells into which rows, given as whole blocks, are split.
pub(crate) fn log2_of(blocks: &[&[u8]], stride: usize) -> u8 {
    let empty = || ([u32::MAX; 3], [0; 3]);
    let join = |a: ([u32; 3], [u32; 3]), b: ([u32; 3], [u32; 3])| {
        ([0, 1, 2].map(|i| a.0[i].min(b.0[i])), [0, 1, 2].map(|i| a.1[i].max(b.1[i])))
    };
    let bounds_of = |rows: &&[u8]| {
        let positions = rows.chunks_exact(stride).map(position);
        positions.fold(empty(), |bounds, p| join(bounds, (p, p)))
    };
    let (min, max) = blocks.par_iter().map(bounds_of).reduce(empty, join);
    Cell::enclosing(min, max).log2.saturating_sub(SPLIT_LEVELS)
}
