//! The partition: rows go to buckets by their cells, in memory while they fit, then to scratch. A
//! block of rows is sorted into cells on any thread; buckets then refer to ranges of it. All cells
//! have one size, which doubles when there are too many, so bounds need not be known beforehand.

use crate::error::BuildError;
use crate::rows::corners::{CornerMap, key};
use crate::rows::journal_record::{Record, RecordReader};
use crate::rows::row::position;
use crate::rows::scratch::{BlockBytes, Extent, Map, Scratch};
use esker_points::{Cell, morton};
use std::ops::Range;
use std::sync::Arc;

/// Most buckets; if there were more, the cells double.
pub const BUCKETS_MAX: usize = 1 << 14;

/// Rows sorted into cells of one size.
pub struct RowBlock {
    log2: u8,
    rows: Vec<u8>,
    cells: Vec<CellRows>,
}

/// The corner of a cell, and its rows in a block.
type CellRows = ([u32; 3], Range<u32>);

impl RowBlock {
    /// Sorts rows into cells of `2^log2` steps. `fill` passes whole rows, any number at a time, and
    /// `positions` are their positions in the same order. Fewer than 2^32 rows.
    pub fn new(
        stride: usize,
        log2: u8,
        positions: impl Iterator<Item = [u32; 3]>,
        fill: impl FnOnce(&mut dyn FnMut(&[u8])),
    ) -> Self {
        let (cell_of, mut cells) = cells_of(log2, positions);
        let mut end = 0;
        for (_, range) in &mut cells {
            // So far the end of the range is the number of rows.
            *range = end..end + range.end;
            end = range.end;
        }
        let mut next: Vec<usize> = cells.iter().map(|c| c.1.start as usize * stride).collect();
        let mut rows = vec![0; cell_of.len() * stride];
        let mut from = 0;
        fill(&mut |more| {
            let count = more.len() / stride;
            let mut start = 0;
            // Consecutive points of a file mostly share a cell.
            for alike in cell_of[from..from + count].chunk_by(|a, b| a == b) {
                let bytes = &more[start..start + alike.len() * stride];
                let to = &mut next[alike[0] as usize];
                rows[*to..*to + bytes.len()].copy_from_slice(bytes);
                (start, *to) = (start + bytes.len(), *to + bytes.len());
            }
            from += count;
        });
        Self { log2, rows, cells }
    }
}

impl RowBlock {
    /// Bytes of memory, including those for lists of its cells while they are written to scratch.
    fn bytes(&self) -> usize {
        self.rows.len() + self.cells.len() * (size_of::<BlockRows>() + size_of::<BlockBytes>())
    }
}

/// For each position the index of its cell, and the cells, in order of appearance, with the number
/// of their positions as end of the range.
fn cells_of(log2: u8, positions: impl Iterator<Item = [u32; 3]>) -> (Vec<u32>, Vec<CellRows>) {
    let mut cells: Vec<CellRows> = Vec::new();
    let mut by_corner = CornerMap::<u32>::default();
    let mut cell_of = Vec::with_capacity(positions.size_hint().0);
    let mut last: Option<(Cell, u32)> = None;
    for p in positions {
        let index = match last {
            Some((cell, index)) if cell.contains(p) => index,
            _ => {
                let cell = Cell::containing(p, log2);
                let index = *by_corner.entry(key(cell.corner)).or_insert(cells.len() as u32);
                if index as usize == cells.len() {
                    cells.push((cell.corner, 0..0));
                }
                last = Some((cell, index));
                index
            }
        };
        cells[index as usize].1.end += 1;
        cell_of.push(index);
    }
    (cell_of, cells)
}

/// Rows of a bucket in a block that it shares with others.
#[derive(Clone, Debug)]
struct BlockRows {
    block: Arc<Vec<u8>>,
    rows: Range<u32>,
}

impl BlockRows {
    /// The bytes of these rows, of `stride` bytes each.
    fn into_bytes(self, stride: usize) -> BlockBytes {
        let Range { start, end } = self.rows;
        BlockBytes { block: self.block, bytes: start as usize * stride..end as usize * stride }
    }
}

/// Rows of a cell in scratch.
#[derive(Clone, Copy, Debug)]
pub struct SpilledCell {
    /// Corner of the cell.
    pub corner: [u32; 3],
    /// Place of the rows.
    pub extent: Extent,
}

/// Rows that were moved to scratch together, cell by cell.
#[derive(Debug)]
pub struct Spilled {
    /// Log2 of the cells' edge.
    pub log2: u8,
    /// The cells.
    pub cells: Vec<SpilledCell>,
}

impl Spilled {
    /// Bytes of all rows.
    pub fn bytes(&self) -> u64 {
        self.cells.iter().map(|cell| cell.extent.bytes).sum()
    }

    /// Places of all rows.
    pub fn extents(&self) -> Vec<Extent> {
        self.cells.iter().map(|cell| cell.extent).collect()
    }

    /// Adds cells and places to a record.
    pub fn put(&self, record: &mut Record) {
        record.put(self.log2);
        record.put(self.cells.len() as u64);
        for cell in &self.cells {
            record.put(cell.corner);
            cell.extent.put(record);
        }
    }

    /// Reads cells and places from a record.
    pub fn get(from: &mut RecordReader<'_>) -> Option<Self> {
        let log2 = from.get::<u8>().filter(|&log2| log2 <= 32)?;
        let count = from.get::<u64>()?;
        let cell = |_| Some(SpilledCell { corner: from.get()?, extent: Extent::get(from)? });
        let cells: Option<Vec<_>> = (0..count).map(cell).collect();
        Some(Self { log2, cells: cells? })
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
    in_memory: Vec<BlockRows>,
    /// Rows in scratch.
    pub extents: Vec<Extent>,
}

impl Bucket {
    /// An empty bucket.
    pub fn new(cell: Cell) -> Self {
        Self { cell, rows: 0, in_memory: Vec::new(), extents: Vec::new() }
    }

    /// The rows, as runs of whole rows. `map` must be newer than the rows in scratch.
    pub fn runs<'a>(&'a self, map: Option<&'a Map>, stride: usize) -> Vec<&'a [u8]> {
        let bytes = |p: &BlockRows| p.rows.start as usize * stride..p.rows.end as usize * stride;
        let in_memory = self.in_memory.iter().map(|p| &p.block[bytes(p)]);
        let in_scratch = self.extents.iter().filter_map(|e| e.of(map?));
        in_memory.chain(in_scratch).collect()
    }
}

/// Rows by cell.
pub struct Partition {
    stride: usize,
    log2: u8,
    buckets: Vec<Bucket>,
    by_corner: CornerMap<u32>,
    buffered_bytes: usize,
    buffer_bytes_max: usize,
    /// Whether rows go to scratch: then half of the memory fills while the other half is written.
    is_spilling: bool,
}

impl Partition {
    /// An empty partition into cells of `2^log2` steps. Rows beyond `buffer_bytes_max` go to
    /// scratch; `is_spilling` states that this is expected.
    pub fn new(stride: usize, log2: u8, buffer_bytes_max: usize, is_spilling: bool) -> Self {
        Self {
            stride,
            log2,
            buckets: Vec::new(),
            by_corner: CornerMap::default(),
            buffered_bytes: 0,
            buffer_bytes_max,
            is_spilling,
        }
    }

    /// Log2 of the cells' edge.
    pub fn log2(&self) -> u8 {
        self.log2
    }

    /// Whether the rows in memory must go to scratch before `block` is added.
    pub fn is_full_for(&self, block: &RowBlock) -> bool {
        self.buffered_bytes > 0 && self.buffered_bytes + block.bytes() > self.held_bytes_max()
    }

    /// Whether more rows are in memory than allowed.
    pub fn is_full(&self) -> bool {
        self.buffered_bytes > self.held_bytes_max()
    }

    /// Most bytes of rows in memory, without those that are being written to scratch.
    fn held_bytes_max(&self) -> usize {
        if self.is_spilling { self.buffer_bytes_max / 2 } else { self.buffer_bytes_max }
    }

    /// Whether any rows are in memory.
    pub fn holds_rows(&self) -> bool {
        self.buffered_bytes > 0
    }

    /// Adds a block in memory, with cells no larger than those of the partition.
    pub fn hold(&mut self, block: RowBlock) {
        debug_assert!(block.log2 <= self.log2);
        self.buffered_bytes += block.bytes();
        let rows = Arc::new(block.rows);
        for (corner, range) in block.cells {
            let index = self.bucket_of(corner);
            let bucket = &mut self.buckets[index];
            bucket.rows += range.len() as u64;
            bucket.in_memory.push(BlockRows { block: Arc::clone(&rows), rows: range });
        }
    }

    /// Adds rows that an earlier build has moved to scratch.
    pub fn restore(&mut self, spilled: &Spilled) {
        while self.log2 < spilled.log2 {
            self.coarsen();
        }
        for cell in &spilled.cells {
            let index = self.bucket_of(cell.corner);
            let bucket = &mut self.buckets[index];
            bucket.rows += cell.extent.bytes / self.stride as u64;
            bucket.extents.push(cell.extent);
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

    /// Doubles the cells and joins the buckets that share a new cell.
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
            into.in_memory.append(&mut bucket.in_memory);
            into.extents.append(&mut bucket.extents);
        }
        self.buckets = joined;
    }

    /// Moves all rows in memory to scratch, in Morton order, so that rows of one chunk are near
    /// each other. They are written in the background until [`Scratch::flush`].
    ///
    /// # Errors
    /// If scratch space fails, for these rows or earlier ones.
    pub fn spill(&mut self, scratch: &mut Scratch) -> Result<Spilled, BuildError> {
        let mut along: Vec<&mut Bucket> =
            self.buckets.iter_mut().filter(|bucket| !bucket.in_memory.is_empty()).collect();
        along.sort_unstable_by_key(|b| morton::encode3(b.cell.corner));
        let stride = self.stride;
        let runs = along
            .iter_mut()
            .map(|bucket| bucket.in_memory.drain(..).map(|rows| rows.into_bytes(stride)).collect());
        let extents = scratch.append_in_background(runs.collect())?;
        let mut cells = Vec::with_capacity(along.len());
        for (bucket, extent) in along.into_iter().zip(extents) {
            cells.push(SpilledCell { corner: bucket.cell.corner, extent });
            bucket.extents.push(extent);
        }
        // New rows may fill half of the memory while the other half is being written.
        if self.buffered_bytes > self.buffer_bytes_max / 2 {
            scratch.flush()?;
        }
        (self.buffered_bytes, self.is_spilling) = (0, true);
        Ok(Spilled { log2: self.log2, cells })
    }

    /// The buckets in Morton order. If any rows are in scratch, all go there, so that memory is
    /// free for building.
    ///
    /// # Errors
    /// If scratch space fails.
    pub fn finish(mut self, scratch: &mut Scratch) -> Result<Vec<Bucket>, BuildError> {
        if self.buckets.iter().any(|b| !b.extents.is_empty()) {
            self.spill(scratch)?;
        }
        self.buckets.sort_unstable_by_key(|b| morton::encode3(b.cell.corner));
        Ok(self.buckets)
    }
}

/// Sorts whole rows into cells of `2^log2` steps.
pub fn block_of_rows(rows: &[u8], stride: usize, log2: u8) -> RowBlock {
    let positions = rows.chunks_exact(stride).map(position);
    RowBlock::new(stride, log2, positions, |take| take(rows))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::candidates::tests::rows_of;
    use proptest::prelude::*;

    fn add(partition: &mut Partition, block: RowBlock, scratch: &mut Scratch) {
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
