//! The levels above the chunks: buckets are joined to chunks or parted until each fits memory, chunks are
//! built one after the other, each in parallel, and what their roots offer is held back until the cells
//! above have chosen from it. Pages are written as soon as they are final, siblings together.

use crate::chunk::Runs;
use crate::coincident::Coincident;
use crate::error::BuildError;
use crate::memory::Peak;
use crate::partition::{Bucket, Partition};
use crate::row::{Rows, position};
use crate::scratch::Scratch;
use crate::shape::Moments;
use crate::tree::{Context, Pending, Subtree};
use esker_format::{FileWriter, NodeStatistics};
use esker_points::{Cell, NodeTable, Task};

/// Octree levels by which a bucket that is too large is parted at a time.
const PART_LEVELS: u8 = 3;

/// Builds a tree out of buckets.
pub struct Raiser<'a> {
    /// What every step knows.
    pub context: &'a Context,
    /// The file.
    pub writer: &'a mut FileWriter,
    /// Where rows lie that do not fit memory.
    pub scratch: &'a mut Scratch,
    /// Rows that a chunk may have.
    pub chunk_rows_max: u64,
    /// Bytes of rows that parting a bucket may keep in memory.
    pub buffer_bytes_max: usize,
    /// Told how far it is.
    pub task: &'a dyn Task,
    /// Watches memory.
    pub peak: &'a Peak,
}

/// A cell that is built but for its root, with the rows that the root offers.
struct Held {
    pending: Pending,
    rows: Vec<u8>,
}

impl Raiser<'_> {
    /// The finished tree over buckets along the Morton curve; `None` where there is no row.
    ///
    /// # Errors
    /// Where scratch or the file fail, or on request.
    pub fn tree(&mut self, buckets: Vec<Bucket>) -> Result<Option<Subtree>, BuildError> {
        let Some(held) = self.raise(buckets)? else { return Ok(None) };
        let rows = Rows { bytes: &held.rows, stride: self.context.rows.bytes() };
        let mut root = self.context.finish(&rows, held.pending, &[], None);
        if let Some(root) = &mut root {
            self.write(std::slice::from_mut(root))?;
        }
        Ok(root)
    }

    fn raise(&mut self, mut buckets: Vec<Bucket>) -> Result<Option<Held>, BuildError> {
        let rows: u64 = buckets.iter().map(|b| b.rows).sum();
        if rows == 0 {
            return Ok(None);
        }
        if rows <= self.chunk_rows_max {
            return self.chunk(buckets).map(Some);
        }
        if buckets.len() == 1 {
            let bucket = buckets.remove(0);
            return if bucket.cell.log2 == 0 {
                self.coincident(bucket).map(Some)
            } else {
                let parts = self.part(bucket)?;
                self.raise(parts)
            };
        }
        let first = buckets[0].cell.corner;
        let last = buckets[buckets.len() - 1].cell.last();
        let cell = Cell::enclosing(first, last);
        let mut children = Vec::new();
        for octant in 0..8 {
            let rest = buckets.iter().position(|b| cell.octant(b.cell.corner) > octant);
            let rest = buckets.split_off(rest.unwrap_or(buckets.len()));
            children.extend(self.raise(std::mem::replace(&mut buckets, rest))?);
        }
        match children.len() {
            1 => Ok(children.pop()),
            _ => self.combine(cell, children).map(Some),
        }
    }

    /// Builds the points of these buckets, which fit memory.
    fn chunk(&mut self, buckets: Vec<Bucket>) -> Result<Held, BuildError> {
        self.task.check()?;
        let stride = self.context.rows.bytes();
        let map = if buckets.iter().any(|b| !b.extents.is_empty()) {
            Some(self.scratch.map()?)
        } else {
            None
        };
        let stored = |b: &Bucket| -> Vec<&[u8]> {
            let extents = b.extents.iter();
            extents.filter_map(|e| e.of(map.as_ref()?)).collect()
        };
        let mut runs: Vec<&[u8]> = Vec::new();
        for bucket in &buckets {
            runs.extend(bucket.blocks.iter().map(Vec::as_slice));
            runs.extend(stored(bucket));
        }
        let sorted = Runs::new(runs, stride).sorted();
        self.peak.sample();
        drop(map);
        buckets.iter().flat_map(|b| &b.extents).for_each(|e| self.scratch.release(*e));
        drop(buckets);
        let rows = Rows { bytes: &sorted, stride };
        let mut pending = self.context.build(&rows, 0..rows.len() as u32, self.task);
        self.task.check()?;
        self.peak.sample();
        self.write(&mut pending.children)?;
        Ok(self.hold(pending, &rows))
    }

    /// Parts a bucket that is too large into smaller cells: some levels below the smallest cell that
    /// holds its rows, so that a far outlier or a stack of points costs one pass, not one for each level.
    fn part(&mut self, bucket: Bucket) -> Result<Vec<Bucket>, BuildError> {
        let stride = self.context.rows.bytes();
        let map = if bucket.extents.is_empty() { None } else { Some(self.scratch.map()?) };
        let (mut min, mut max) = ([u32::MAX; 3], [0; 3]);
        let stored = bucket.extents.iter().filter_map(|e| e.of(map.as_ref()?));
        for run in bucket.blocks.iter().map(Vec::as_slice).chain(stored) {
            self.task.check()?;
            for p in run.chunks_exact(stride).map(position) {
                min = [0, 1, 2].map(|i| p[i].min(min[i]));
                max = [0, 1, 2].map(|i| p[i].max(max[i]));
            }
        }
        drop(map);
        let log2 = Cell::enclosing(min, max).log2.saturating_sub(PART_LEVELS);
        let mut partition = Partition::new(stride, log2, self.buffer_bytes_max);
        for block in bucket.blocks {
            partition.add(&block, self.scratch)?;
        }
        for extent in bucket.extents {
            self.task.check()?;
            let map = self.scratch.map()?;
            if let Some(rows) = extent.of(&map) {
                partition.add(rows, self.scratch)?;
            }
            self.scratch.release(extent);
        }
        partition.finish(self.scratch)
    }

    /// More coincident points than memory holds: a node's worth at a time, in the order of their records.
    fn coincident(&mut self, mut bucket: Bucket) -> Result<Held, BuildError> {
        let stride = self.context.rows.bytes();
        let mut extents = std::mem::take(&mut bucket.extents);
        for block in bucket.blocks.drain(..) {
            extents.push(self.scratch.append(&block)?);
        }
        let map = self.scratch.map()?;
        let rows = Coincident {
            runs: extents.iter().filter_map(|e| e.of(&map)).collect(),
            stride,
            rows_max: self.chunk_rows_max,
            task: self.task,
        };
        let (mut held, mut chain, mut carry) = (None, Vec::new(), Vec::new());
        rows.in_order(&mut |row| {
            carry.extend_from_slice(row);
            if carry.len() == self.context.capacity * stride {
                self.link(std::mem::take(&mut carry), bucket.cell, &mut held, &mut chain)?;
            }
            Ok(())
        })?;
        if !carry.is_empty() {
            self.link(carry, bucket.cell, &mut held, &mut chain)?;
        }
        extents.iter().for_each(|e| self.scratch.release(*e));
        let mut held = held.ok_or_else(|| BuildError::Proof("a bucket lost its rows".into()))?;
        for (moments, mut node) in chain.into_iter().rev() {
            held.pending.moments.merge(&moments);
            node.children = std::mem::take(&mut held.pending.children);
            held.pending.children.push(node);
        }
        Ok(held)
    }

    /// The next node of a chain of coincident points: its head, or one that continues it.
    fn link(
        &mut self,
        bytes: Vec<u8>,
        cell: Cell,
        head: &mut Option<Held>,
        chain: &mut Vec<(Moments, Subtree)>,
    ) -> Result<(), BuildError> {
        let rows = Rows { bytes: &bytes, stride: self.context.rows.bytes() };
        let pending = self.context.leaf(&rows, 0..rows.len() as u32, cell);
        self.task.advance(rows.len() as u64);
        if head.is_none() {
            *head = Some(Held { pending, rows: bytes });
        } else if let Some((moments, mut node)) = self.context.continuation(&rows, pending) {
            self.write(std::slice::from_mut(&mut node))?;
            chain.push((moments, node));
        }
        Ok(())
    }

    /// Chooses a cell's points from what its children offer, and writes the children.
    fn combine(&mut self, cell: Cell, children: Vec<Held>) -> Result<Held, BuildError> {
        self.task.check()?;
        let stride = self.context.rows.bytes();
        let mut bytes = Vec::with_capacity(children.iter().map(|c| c.rows.len()).sum());
        let mut pending = Vec::with_capacity(children.len());
        for mut child in children {
            let before = (bytes.len() / stride) as u32;
            child.pending.offered.iter_mut().for_each(|i| *i += before);
            bytes.extend_from_slice(&child.rows);
            pending.push(child.pending);
        }
        let rows = Rows { bytes: &bytes, stride };
        let mut combined = self.context.combine(&rows, cell, pending);
        self.peak.sample();
        self.write(&mut combined.children)?;
        Ok(self.hold(combined, &rows))
    }

    /// Keeps only the rows that a cell offers.
    fn hold(&self, mut pending: Pending, rows: &Rows<'_>) -> Held {
        let mut bytes = Vec::with_capacity(pending.offered.len() * rows.stride);
        pending.offered.iter().for_each(|&i| bytes.extend_from_slice(rows.row(i)));
        pending.offered = (0..pending.offered.len() as u32).collect();
        Held { pending, rows: bytes }
    }

    /// Writes the pages of siblings, then of what lies below each, where they are not yet written.
    fn write(&mut self, siblings: &mut [Subtree]) -> Result<(), BuildError> {
        let mut open = vec![siblings];
        while let Some(group) = open.pop() {
            for tree in group.iter_mut().filter(|t| !t.page.is_empty()) {
                let page = std::mem::take(&mut tree.page);
                tree.node.page_bytes = page.len() as u32;
                tree.node.page_offset = self.writer.write_page(&page)?;
            }
            let below = group.iter_mut().map(|t| t.children.as_mut_slice());
            open.extend(below.filter(|b| b.iter().any(|c| !c.page.is_empty())).rev());
        }
        Ok(())
    }
}

/// The node table of a tree, and the statistics of its nodes in the table's order: siblings together,
/// parents before children.
pub fn assemble(root: Option<Subtree>) -> (NodeTable, Vec<NodeStatistics>) {
    let (mut table, mut statistics) = (NodeTable::default(), Vec::new());
    let mut open = Vec::new();
    if let Some(mut root) = root {
        root.node.parent = esker_points::node::NONE;
        table.nodes.push(root.node);
        statistics.push(root.statistics);
        open.push((0u32, root.children.take()));
    }
    while let Some((parent, children)) = open.pop() {
        if children.is_empty() {
            continue;
        }
        let first = table.nodes.len() as u32;
        table.nodes[parent as usize].first_child = first;
        table.nodes[parent as usize].child_count = children.len() as u8;
        let mut below = Vec::with_capacity(children.len());
        for (i, mut child) in children.into_iter().enumerate() {
            child.node.parent = parent;
            table.nodes.push(child.node);
            statistics.push(child.statistics);
            below.push((first + i as u32, child.children.take()));
        }
        open.extend(below.into_iter().rev());
    }
    (table, statistics)
}
