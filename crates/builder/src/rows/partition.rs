//! Partition: rows go to buckets by the cell they lie in, in memory while they fit, else to
//! scratch. A block of rows is sorted into cells on any thread; buckets then take its parts as they
//! lie. Cells are of one size that coarsens when there are too many, so no bounds need be known
//! beforehand and lying ones do no harm.

use crate::error::BuildError;
use crate::rows::journal_record::{Reading, Record};
use crate::rows::row::position;
use crate::rows::scratch::{Extent, Map, Run, Scratch};
use esker_points::{Cell, morton};
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::ops::Range;
use std::sync::Arc;

/// Buckets at most; beyond, their cells double.
pub const BUCKETS_MAX: usize = 1 << 14;

/// Rows sorted into cells of one size.
pub struct Block {
    log2: u8,
    rows: Vec<u8>,
    parts: Vec<Part>,
}

/// The corner of a cell, and its rows in a block.
type Part = ([u32; 3], Range<u32>);

impl Block {
    /// Sorts rows into cells of `2^log2` steps: `positions` is what stands in the rows that `fill`
    /// hands over in the same order, whole ones, any number at a time. Below 2^32 rows.
    pub fn new(
        stride: usize,
        log2: u8,
        positions: impl Iterator<Item = [u32; 3]>,
        fill: impl FnOnce(&mut dyn FnMut(&[u8])),
    ) -> Self {
        let (part_of, mut parts) = parts_of(log2, positions);
        let mut end = 0;
        for (_, range) in &mut parts {
            // The count of rows was its end.
            *range = end..end + range.end;
            end = range.end;
        }
        let mut next: Vec<usize> = parts.iter().map(|p| p.1.start as usize * stride).collect();
        let mut rows = vec![0; part_of.len() * stride];
        let mut from = 0;
        fill(&mut |more| {
            let count = more.len() / stride;
            let mut start = 0;
            // Neighbours in a file mostly share a cell.
            for alike in part_of[from..from + count].chunk_by(|a, b| a == b) {
                let bytes = &more[start..start + alike.len() * stride];
                let to = &mut next[alike[0] as usize];
                rows[*to..*to + bytes.len()].copy_from_slice(bytes);
                (start, *to) = (start + bytes.len(), *to + bytes.len());
            }
            from += count;
        });
        Self { log2, rows, parts }
    }
}

impl Block {
    /// Bytes of memory, also of what it takes to send its parts to scratch.
    fn bytes(&self) -> usize {
        self.rows.len() + self.parts.len() * (size_of::<Piece>() + size_of::<Run>())
    }
}

/// Which cell each position lies in, numbered as they come, and the cells with the count of their
/// positions.
fn parts_of(log2: u8, positions: impl Iterator<Item = [u32; 3]>) -> (Vec<u32>, Vec<Part>) {
    let mut parts: Vec<Part> = Vec::new();
    let mut by_corner = Cells::default();
    let mut part_of = Vec::with_capacity(positions.size_hint().0);
    let mut last: Option<(Cell, u32)> = None;
    for p in positions {
        let part = match last {
            Some((cell, part)) if cell.contains(p) => part,
            _ => {
                let cell = Cell::containing(p, log2);
                let part = *by_corner.entry(key(cell.corner)).or_insert(parts.len() as u32);
                if part as usize == parts.len() {
                    parts.push((cell.corner, 0..0));
                }
                last = Some((cell, part));
                part
            }
        };
        parts[part as usize].1.end += 1;
        part_of.push(part);
    }
    (part_of, parts)
}

/// Rows of a bucket in a block that others share.
#[derive(Clone, Debug)]
struct Piece {
    block: Arc<Vec<u8>>,
    rows: Range<u32>,
}

impl Piece {
    /// Its bytes, where a row has `stride`.
    fn run(self, stride: usize) -> Run {
        let Range { start, end } = self.rows;
        Run { block: self.block, bytes: start as usize * stride..end as usize * stride }
    }
}

/// Rows of a cell in scratch.
#[derive(Clone, Copy, Debug)]
pub struct Stored {
    /// The cell's corner.
    pub corner: [u32; 3],
    /// Where they lie.
    pub extent: Extent,
}

/// Rows that went to scratch together, a cell's behind another's.
#[derive(Debug)]
pub struct Spilled {
    /// Log2 of the cells' edge.
    pub log2: u8,
    /// What lies where.
    pub parts: Vec<Stored>,
}

impl Spilled {
    /// Their bytes.
    pub fn bytes(&self) -> u64 {
        self.parts.iter().map(|part| part.extent.bytes).sum()
    }

    /// Where they lie.
    pub fn extents(&self) -> Vec<Extent> {
        self.parts.iter().map(|part| part.extent).collect()
    }

    /// Adds them to a record.
    pub fn put(&self, record: &mut Record) {
        record.put(self.log2);
        record.put(self.parts.len() as u64);
        for part in &self.parts {
            record.put(part.corner);
            part.extent.put(record);
        }
    }

    /// Reads them from a record.
    pub fn get(from: &mut Reading<'_>) -> Option<Self> {
        let log2 = from.get::<u8>().filter(|&log2| log2 <= 32)?;
        let count = from.get::<u64>()?;
        let stored = |_| Some(Stored { corner: from.get()?, extent: Extent::get(from)? });
        let parts: Option<Vec<_>> = (0..count).map(stored).collect();
        Some(Self { log2, parts: parts? })
    }
}

/// The rows of one cell.
#[derive(Debug)]
pub struct Bucket {
    /// The cell.
    pub cell: Cell,
    /// Number of rows.
    pub rows: u64,
    /// Rows in memory.
    pieces: Vec<Piece>,
    /// Rows in scratch.
    pub extents: Vec<Extent>,
}

impl Bucket {
    /// No rows of this cell.
    pub fn new(cell: Cell) -> Self {
        Self { cell, rows: 0, pieces: Vec::new(), extents: Vec::new() }
    }

    /// Its rows, as whole runs; those in scratch by a mapping made since.
    pub fn runs<'a>(&'a self, map: Option<&'a Map>, stride: usize) -> Vec<&'a [u8]> {
        let bytes = |p: &Piece| p.rows.start as usize * stride..p.rows.end as usize * stride;
        let held = self.pieces.iter().map(|p| &p.block[bytes(p)]);
        let stored = self.extents.iter().filter_map(|e| e.of(map?));
        held.chain(stored).collect()
    }
}

/// Rows by cell.
pub struct Partition {
    stride: usize,
    log2: u8,
    buckets: Vec<Bucket>,
    by_corner: Cells,
    buffered_bytes: usize,
    buffer_bytes_max: usize,
    /// Whether rows go to scratch: then half of the memory fills while the other is written.
    is_spilling: bool,
}

impl Partition {
    /// An empty partition into cells of `2^log2` steps; rows beyond `buffer_bytes_max` go to
    /// scratch, which is likely to happen where it `is_spilling`.
    pub fn new(stride: usize, log2: u8, buffer_bytes_max: usize, is_spilling: bool) -> Self {
        Self {
            stride,
            log2,
            buckets: Vec::new(),
            by_corner: Cells::default(),
            buffered_bytes: 0,
            buffer_bytes_max,
            is_spilling,
        }
    }

    /// Log2 of the cells' edge.
    pub fn log2(&self) -> u8 {
        self.log2
    }

    /// Whether memory has no room for a block beside what is in it.
    pub fn is_full_for(&self, block: &Block) -> bool {
        self.buffered_bytes > 0 && self.buffered_bytes + block.bytes() > self.held_bytes_max()
    }

    /// Whether memory has more than it should.
    pub fn is_full(&self) -> bool {
        self.buffered_bytes > self.held_bytes_max()
    }

    /// Bytes of rows beside those on their way to scratch.
    fn held_bytes_max(&self) -> usize {
        if self.is_spilling { self.buffer_bytes_max / 2 } else { self.buffer_bytes_max }
    }

    /// Whether any rows are in memory.
    pub fn holds_rows(&self) -> bool {
        self.buffered_bytes > 0
    }

    /// Adds a block in memory, of cells no larger than this partition's.
    pub fn hold(&mut self, block: Block) {
        debug_assert!(block.log2 <= self.log2);
        self.buffered_bytes += block.bytes();
        let rows = Arc::new(block.rows);
        for (corner, range) in block.parts {
            let index = self.bucket_of(corner);
            let bucket = &mut self.buckets[index];
            bucket.rows += range.len() as u64;
            bucket.pieces.push(Piece { block: Arc::clone(&rows), rows: range });
        }
    }

    /// Adds what an earlier build has put in scratch, out of cells of this size.
    pub fn restore(&mut self, spilled: &Spilled) {
        while self.log2 < spilled.log2 {
            self.coarsen();
        }
        for part in &spilled.parts {
            let index = self.bucket_of(part.corner);
            let bucket = &mut self.buckets[index];
            bucket.rows += part.extent.bytes / self.stride as u64;
            bucket.extents.push(part.extent);
        }
    }

    fn bucket_of(&mut self, p: [u32; 3]) -> usize {
        let cell = Cell::containing(p, self.log2);
        if let Some(&index) = self.by_corner.get(&key(cell.corner)) {
            return index as usize;
        }
        if self.buckets.len() >= BUCKETS_MAX && self.log2 < 32 {
            self.coarsen();
            return self.bucket_of(p);
        }
        self.buckets.push(Bucket::new(cell));
        self.by_corner.insert(key(cell.corner), self.buckets.len() as u32 - 1);
        self.buckets.len() - 1
    }

    /// Doubles the cells and joins the buckets that then are one.
    fn coarsen(&mut self) {
        self.log2 += 1;
        self.by_corner.clear();
        let mut joined: Vec<Bucket> = Vec::new();
        for mut bucket in std::mem::take(&mut self.buckets) {
            let cell = Cell::containing(bucket.cell.corner, self.log2);
            let index = *self.by_corner.entry(key(cell.corner)).or_insert(joined.len() as u32);
            if index as usize == joined.len() {
                joined.push(Bucket::new(cell));
            }
            let into = &mut joined[index as usize];
            into.rows += bucket.rows;
            into.pieces.append(&mut bucket.pieces);
            into.extents.append(&mut bucket.extents);
        }
        self.buckets = joined;
    }

    /// Moves all rows in memory to scratch, along the Morton curve: what is built together lies
    /// together. What goes where; it is on its way until [`Scratch::flush`].
    ///
    /// # Errors
    /// Where scratch space fails, for these rows or those before.
    pub fn spill(&mut self, scratch: &mut Scratch) -> Result<Spilled, BuildError> {
        let mut along: Vec<&mut Bucket> =
            self.buckets.iter_mut().filter(|bucket| !bucket.pieces.is_empty()).collect();
        along.sort_unstable_by_key(|b| morton::encode3(b.cell.corner));
        let runs = along
            .iter_mut()
            .map(|bucket| bucket.pieces.drain(..).map(|piece| piece.run(self.stride)).collect());
        let extents = scratch.append_meanwhile(runs.collect())?;
        let mut parts = Vec::with_capacity(along.len());
        for (bucket, extent) in along.into_iter().zip(extents) {
            parts.push(Stored { corner: bucket.cell.corner, extent });
            bucket.extents.push(extent);
        }
        // More than half of the memory is not to be filled beside.
        if self.buffered_bytes > self.buffer_bytes_max / 2 {
            scratch.flush()?;
        }
        (self.buffered_bytes, self.is_spilling) = (0, true);
        Ok(Spilled { log2: self.log2, parts })
    }

    /// The buckets along the Morton curve; once anything has gone to scratch, everything does, so
    /// that memory is free for building.
    ///
    /// # Errors
    /// Where scratch space fails.
    pub fn finish(mut self, scratch: &mut Scratch) -> Result<Vec<Bucket>, BuildError> {
        if self.buckets.iter().any(|b| !b.extents.is_empty()) {
            self.spill(scratch)?;
        }
        self.buckets.sort_unstable_by_key(|b| morton::encode3(b.cell.corner));
        Ok(self.buckets)
    }
}

/// Numbers by the corners of cells.
type Cells = HashMap<u128, u32, BuildHasherDefault<CornerHasher>>;

/// The corner of a cell as a number.
fn key([x, y, z]: [u32; 3]) -> u128 {
    u128::from(x) | u128::from(y) << 32 | u128::from(z) << 64
}

/// A quick hash of a corner: asked for every point of a scan without order.
#[derive(Default)]
struct CornerHasher(u64);

impl Hasher for CornerHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&b| self.write_u128(b.into()));
    }

    fn write_u128(&mut self, corner: u128) {
        // Odd numbers without a pattern: the fraction of the golden ratio, and FNV's prime.
        let mixed = (self.0 ^ corner as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
            ^ ((corner >> 64) as u64).wrapping_mul(0x0100_0000_01b3);
        self.0 = (mixed ^ mixed >> 32).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(26);
    }
}

/// Sorts whole rows into cells of `2^log2` steps.
pub fn block_of_rows(rows: &[u8], stride: usize, log2: u8) -> Block {
    let positions = rows.chunks_exact(stride).map(position);
    Block::new(stride, log2, positions, |take| take(rows))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::candidates::tests::rows_of;
    use proptest::prelude::*;

    fn add(partition: &mut Partition, block: Block, scratch: &mut Scratch) {
        if partition.is_full_for(&block) {
            partition.spill(scratch).unwrap();
        }
        partition.hold(block);
        if partition.is_full() {
            partition.spill(scratch).unwrap();
        }
    }

    proptest! {
        #[test]
        fn every_row_is_in_the_bucket_of_its_cell(points in prop::collection::vec(any::<[u32; 3]>(), 0..300), log2 in 0u8..=32, memory in 0usize..100_000, is_spilling: bool) {
            let folder = tempfile::tempdir().unwrap();
            let mut scratch = Scratch::new(folder.path()).unwrap();
            let mut partition = Partition::new(12, log2, memory, is_spilling);
            for part in rows_of(&points).chunks(12 * 7) {
                let log2 = partition.log2();
                add(&mut partition, block_of_rows(part, 12, log2), &mut scratch);
            }
            let buckets = partition.finish(&mut scratch).unwrap();
            let map = scratch.map().ok();
            let mut back = Vec::new();
            for bucket in &buckets {
                let mut rows = 0;
                for row in bucket.runs(map.as_ref(), 12).into_iter().flat_map(|b| b.chunks(12)) {
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
        let mut partition = Partition::new(12, 0, usize::MAX, false);
        let points: Vec<_> = (0..60_000u32)
            .map(|i| [i.wrapping_mul(2_654_435_761), i.wrapping_mul(40_503), i << 16])
            .collect();
        add(&mut partition, block_of_rows(&rows_of(&points), 12, 0), &mut scratch);
        let buckets = partition.finish(&mut scratch).unwrap();
        assert!(buckets.len() <= BUCKETS_MAX);
        assert_eq!(buckets.iter().map(|b| b.rows).sum::<u64>(), 60_000);
    }
}
