//! Parting a bucket that does not fit memory into smaller cells. Rows that went to scratch for the
//! second time are told to the journal and given back where they lay, run by run: what scratch has
//! at once grows by one run.

use crate::budget::shares::SPILLED_BYTES_MAX;
use crate::error::BuildError;
use crate::rows::journal_record::{Kind, Record};
use crate::rows::partition::{Block, Bucket, Partition, block_of_rows};
use crate::rows::row::position;
use crate::rows::scratch::{Extent, take_first};
use crate::rows::store::Store;
use crate::tree::levels::Raiser;
use esker_points::Cell;
use rayon::prelude::*;

/// Octree levels by which a bucket is parted at a time.
const PART_LEVELS: u8 = 3;
/// Rows that are sorted into cells together.
const BLOCK_ROWS: usize = 1 << 16;

/// Bytes of rows that scratch has twice at most while a bucket is parted, where so many may be kept
/// in memory.
pub fn twice_bytes_max(buffer_bytes_max: u64, row_bytes: usize) -> u64 {
    let block_bytes = (BLOCK_ROWS * row_bytes) as u64;
    (buffer_bytes_max.min(SPILLED_BYTES_MAX) / 2).max(block_bytes)
}

/// A bucket on its way into smaller cells.
struct Parting<'a> {
    store: &'a mut Store,
    partition: Partition,
    /// Where rows lie in scratch that are not parted yet.
    left: Vec<Extent>,
    /// The record of rows that are on their way to scratch, and where they come from.
    leaving: (Option<Record>, Vec<Extent>),
}

impl Raiser<'_> {
    /// Parts a bucket that is too large: some levels below the smallest cell that holds its rows,
    /// so that a far outlier or a stack of points costs one pass, not one for each level.
    pub(crate) fn part(&mut self, mut bucket: Bucket) -> Result<Vec<Bucket>, BuildError> {
        let (stride, store) = (self.context.rows.bytes(), &mut *self.store);
        let is_stored = !bucket.extents.is_empty();
        // A build that goes on finds parts where it finds the bucket.
        let mut parted = Vec::new();
        while let Some(spilled) = store.parted(&mut bucket, stride)? {
            parted.push(spilled);
        }
        let map = store.map(&bucket)?;
        let runs = bucket.runs(map.as_ref(), stride);
        store.check(&bucket, &runs, &self.context.rows)?;
        let blocks: Vec<&[u8]> = runs.iter().flat_map(|r| r.chunks(BLOCK_ROWS * stride)).collect();
        let log2 = parted.first().map_or_else(|| log2_of(&blocks, stride), |first| first.log2);
        // Rows in memory lie in blocks that others share, so they are not freed as they are parted.
        let buffer_bytes_max = if is_stored {
            self.buffer_bytes_max.min(SPILLED_BYTES_MAX as usize)
        } else {
            self.buffer_bytes_max / 8
        };
        let mut partition = Partition::new(stride, log2, buffer_bytes_max, is_stored);
        parted.iter().for_each(|spilled| partition.restore(spilled));
        let left = bucket.extents.clone();
        let mut parting = Parting { store, partition, left, leaving: Default::default() };
        for group in blocks.chunks(rayon::current_num_threads().max(1)) {
            self.task.check()?;
            let log2 = parting.partition.log2();
            let parted: Vec<_> =
                group.par_iter().map(|rows| block_of_rows(rows, stride, log2)).collect();
            parted.into_iter().try_for_each(|block| parting.add(block))?;
        }
        drop((blocks, runs));
        drop(bucket);
        parting.finish(is_stored)
    }
}

impl Parting<'_> {
    fn add(&mut self, block: Block) -> Result<(), BuildError> {
        if self.partition.is_full_for(&block) {
            self.spill()?;
        }
        self.partition.hold(block);
        if self.partition.is_full() { self.spill() } else { Ok(()) }
    }

    /// Moves all rows in memory to scratch.
    fn spill(&mut self) -> Result<(), BuildError> {
        self.settle()?;
        let spilled = self.partition.spill(&mut self.store.scratch)?;
        if self.left.is_empty() {
            return Ok(());
        }
        if self.store.journal.keeps_rows() {
            let mut record = Record::new(Kind::Parted);
            spilled.put(&mut record);
            self.leaving.0 = Some(record);
        }
        self.leaving.1 = take_first(&mut self.left, spilled.bytes());
        Ok(())
    }

    /// Once rows are in scratch, tells of them and gives back where they were.
    fn settle(&mut self) -> Result<(), BuildError> {
        let (record, extents) = std::mem::take(&mut self.leaving);
        if extents.is_empty() {
            return Ok(());
        }
        self.store.scratch.flush()?;
        record.map_or(Ok(()), |record| self.store.journal.tell(record))?;
        self.store.scratch.release(extents);
        Ok(())
    }

    /// The parts; what `was_stored` is again.
    fn finish(mut self, was_stored: bool) -> Result<Vec<Bucket>, BuildError> {
        if was_stored && self.partition.holds_rows() {
            self.spill()?;
        }
        self.settle()?;
        self.partition.finish(&mut self.store.scratch)
    }
}

/// Log2 of the edge of the cells that rows, in whole blocks, are parted into.
fn log2_of(blocks: &[&[u8]], stride: usize) -> u8 {
    let empty = || ([u32::MAX; 3], [0; 3]);
    let join = |a: ([u32; 3], [u32; 3]), b: ([u32; 3], [u32; 3])| {
        ([0, 1, 2].map(|i| a.0[i].min(b.0[i])), [0, 1, 2].map(|i| a.1[i].max(b.1[i])))
    };
    let bounds_of = |rows: &&[u8]| {
        let positions = rows.chunks_exact(stride).map(position);
        positions.fold(empty(), |bounds, p| join(bounds, (p, p)))
    };
    let (min, max) = blocks.par_iter().map(bounds_of).reduce(empty, join);
    Cell::enclosing(min, max).log2.saturating_sub(PART_LEVELS)
}
