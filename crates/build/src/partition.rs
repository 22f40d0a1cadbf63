//! Partition: rows go to buckets by the cell they lie in, in memory while they fit, else to scratch. Buckets
//! are cells of one size that coarsens when there are too many, so no bounds need be known beforehand
//! and lying ones do no harm.

use crate::error::BuildError;
use crate::row::position;
use crate::scratch::{Extent, Scratch};
use esker_points::Cell;
use std::collections::HashMap;

/// Buckets at most; beyond, their cells double.
const BUCKETS_MAX: usize = 1 << 13;
/// Bytes of a bucket's first and of its largest block.
const BLOCK_BYTES: (usize, usize) = (1 << 10, 1 << 16);

/// The rows of one cell.
#[derive(Debug)]
pub struct Bucket {
    /// The cell.
    pub cell: Cell,
    /// Number of rows.
    pub rows: u64,
    /// Rows in memory.
    pub blocks: Vec<Vec<u8>>,
    /// Rows in scratch.
    pub extents: Vec<Extent>,
}

/// Rows by cell.
pub struct Partition {
    stride: usize,
    log2: u8,
    buckets: Vec<Bucket>,
    by_corner: HashMap<[u32; 3], usize>,
    buffered_bytes: usize,
    buffer_bytes_max: usize,
}

impl Partition {
    /// An empty partition into cells of `2^log2` steps; rows beyond `buffer_bytes_max` go to scratch.
    pub fn new(stride: usize, log2: u8, buffer_bytes_max: usize) -> Self {
        Self {
            stride,
            log2,
            buckets: Vec::new(),
            by_corner: HashMap::new(),
            buffered_bytes: 0,
            buffer_bytes_max,
        }
    }

    /// Adds whole rows.
    ///
    /// # Errors
    /// Where scratch space fails.
    pub fn add(&mut self, rows: &[u8], scratch: &mut Scratch) -> Result<(), BuildError> {
        // Neighbours in a file mostly share a bucket.
        let mut last: Option<(Cell, usize)> = None;
        for row in rows.chunks_exact(self.stride) {
            let p = position(row);
            let index = match last {
                Some((cell, index)) if cell.contains(p) => index,
                _ => {
                    let index = self.bucket_of(p);
                    last = Some((self.buckets[index].cell, index));
                    index
                }
            };
            let last = self.buckets[index].blocks.last();
            if last.is_none_or(|b| b.len() + self.stride > b.capacity()) {
                self.open_block(index, scratch)?;
            }
            let bucket = &mut self.buckets[index];
            bucket.rows += 1;
            if let Some(block) = bucket.blocks.last_mut() {
                block.extend_from_slice(row);
            }
        }
        Ok(())
    }

    /// Gives a bucket room for more rows.
    fn open_block(&mut self, index: usize, scratch: &mut Scratch) -> Result<(), BuildError> {
        // Asked for each block: many buckets may be full at once.
        if self.buffered_bytes >= self.buffer_bytes_max.max(1) {
            self.spill(scratch)?;
        }
        let blocks = &mut self.buckets[index].blocks;
        let before = blocks.last().map_or(BLOCK_BYTES.0 / 2, Vec::capacity);
        let bytes = (before * 2).min(BLOCK_BYTES.1).max(self.stride);
        blocks.push(Vec::with_capacity(bytes));
        self.buffered_bytes += bytes;
        Ok(())
    }

    fn bucket_of(&mut self, p: [u32; 3]) -> usize {
        let cell = Cell::containing(p, self.log2);
        if let Some(&index) = self.by_corner.get(&cell.corner) {
            return index;
        }
        if self.buckets.len() >= BUCKETS_MAX && self.log2 < 32 {
            self.coarsen();
            return self.bucket_of(p);
        }
        self.buckets.push(Bucket { cell, rows: 0, blocks: Vec::new(), extents: Vec::new() });
        self.by_corner.insert(cell.corner, self.buckets.len() - 1);
        self.buckets.len() - 1
    }

    /// Doubles the cells and joins the buckets that then are one.
    fn coarsen(&mut self) {
        self.log2 += 1;
        self.by_corner.clear();
        let mut joined: Vec<Bucket> = Vec::new();
        for mut bucket in std::mem::take(&mut self.buckets) {
            let cell = Cell::containing(bucket.cell.corner, self.log2);
            let index = *self.by_corner.entry(cell.corner).or_insert(joined.len());
            if index == joined.len() {
                joined.push(Bucket { cell, rows: 0, blocks: Vec::new(), extents: Vec::new() });
            }
            joined[index].rows += bucket.rows;
            joined[index].blocks.append(&mut bucket.blocks);
            joined[index].extents.append(&mut bucket.extents);
        }
        self.buckets = joined;
    }

    /// Moves all rows in memory to scratch.
    fn spill(&mut self, scratch: &mut Scratch) -> Result<(), BuildError> {
        for bucket in &mut self.buckets {
            let mut whole: Option<Extent> = None;
            for block in bucket.blocks.drain(..) {
                let extent = scratch.append(&block)?;
                match &mut whole {
                    Some(w) => w.bytes += extent.bytes,
                    None => whole = Some(extent),
                }
            }
            bucket.extents.extend(whole);
        }
        self.buffered_bytes = 0;
        Ok(())
    }

    /// The buckets along the Morton curve; once anything has gone to scratch, everything does, so that
    /// memory is free for building.
    ///
    /// # Errors
    /// Where scratch space fails.
    pub fn finish(mut self, scratch: &mut Scratch) -> Result<Vec<Bucket>, BuildError> {
        if self.buckets.iter().any(|b| !b.extents.is_empty()) {
            self.spill(scratch)?;
        }
        self.buckets.sort_unstable_by_key(|b| esker_points::morton::encode3(b.cell.corner));
        Ok(self.buckets)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ntree::tests::rows_of;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_row_is_in_the_bucket_of_its_cell(points in prop::collection::vec(any::<[u32; 3]>(), 0..300), log2 in 0u8..=32, memory in 0usize..100_000) {
            let folder = tempfile::tempdir().unwrap();
            let mut scratch = Scratch::new(folder.path()).unwrap();
            let mut partition = Partition::new(12, log2, memory);
            for part in rows_of(&points).chunks(12 * 7) {
                partition.add(part, &mut scratch).unwrap();
            }
            let buckets = partition.finish(&mut scratch).unwrap();
            let map = scratch.map().ok();
            let mut back = Vec::new();
            for bucket in &buckets {
                let mut rows = 0;
                let stored = bucket.extents.iter().map(|e| &map.as_ref().unwrap()[e.offset as usize..][..e.bytes as usize]);
                for row in bucket.blocks.iter().map(Vec::as_slice).chain(stored).flat_map(|b| b.chunks(12)) {
                    prop_assert!(bucket.cell.contains(position(row)));
                    back.push(position(row));
                    rows += 1;
                }
                prop_assert_eq!(rows, bucket.rows);
            }
            let mut points = points;
            points.sort_unstable();
            back.sort_unstable();
            prop_assert_eq!(points, back);
        }
    }

    #[test]
    fn too_many_buckets_coarsen_without_losing_rows() {
        let folder = tempfile::tempdir().unwrap();
        let mut scratch = Scratch::new(folder.path()).unwrap();
        let mut partition = Partition::new(12, 0, usize::MAX);
        let points: Vec<_> = (0..60_000u32)
            .map(|i| [i.wrapping_mul(2_654_435_761), i.wrapping_mul(40_503), i << 16])
            .collect();
        partition.add(&rows_of(&points), &mut scratch).unwrap();
        let buckets = partition.finish(&mut scratch).unwrap();
        assert!(buckets.len() <= BUCKETS_MAX);
        assert_eq!(buckets.iter().map(|b| b.rows).sum::<u64>(), 60_000);
    }
}
