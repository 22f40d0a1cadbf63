//! The levels above the chunks. Buckets are joined to chunks or parted until each fits memory: a list of steps
//! that does not depend on time. While a chunk is built, and what its root and others offer is chosen from
//! for the cells above, the pages of the one before are written and the one behind is loaded and sorted.

use crate::borders::{Borders, cell_of};
use crate::coincident::Coincident;
use crate::error::BuildError;
use crate::memory::Peak;
use crate::normals::UNKNOWN;
use crate::partition::{Bucket, Partition, block_of_rows};
use crate::row::{Rows, position};
use crate::scratch::Scratch;
use crate::shape::Moments;
use crate::sort::sort;
use crate::tree::{Context, Pending, Subtree};
use esker_format::{FileWriter, NodeStatistics};
use esker_points::{Cell, NodeTable, Task};
use rayon::prelude::*;

/// Octree levels by which a bucket that is too large is parted at a time.
const PART_LEVELS: u8 = 3;
/// Rows of a part that are sorted into cells together.
const BLOCK_ROWS: usize = 1 << 16;

/// Builds a tree out of buckets.
pub struct Raiser<'a> {
    /// What every step knows.
    pub context: &'a Context,
    /// Where rows lie and pages go.
    pub store: Store<'a>,
    /// Rows that a chunk of several buckets may have, and one of a single bucket.
    pub chunk_rows_max: (u64, u64),
    /// Bytes of rows that parting a bucket may keep in memory.
    pub buffer_bytes_max: usize,
    /// Told how far it is.
    pub task: &'a dyn Task,
    /// Watches memory.
    pub peak: &'a Peak,
}

/// The files that a tree is built between.
pub struct Store<'a> {
    /// The file.
    pub writer: &'a mut FileWriter,
    /// Where rows lie that do not fit memory.
    pub scratch: &'a mut Scratch,
    /// What chunks know of each other, where normals are estimated.
    pub borders: Option<Borders>,
}

/// What is done next. Each leaves one cell behind that is built but for its root.
enum Step {
    /// Builds the points of these buckets, which fit memory.
    Chunk(Vec<Bucket>),
    /// Parts a bucket that does not fit memory.
    Part(Bucket),
    /// Builds a lattice point that does not fit memory.
    Coincident(Bucket),
    /// Takes the last so many cells for the children of this one.
    Combine(Cell, usize),
}

/// A cell that is built but for its root, with the rows that the root offers.
struct Held {
    pending: Pending,
    rows: Vec<u8>,
}

/// What is built: cells that wait for the one above, and pages that wait to be written.
struct Built {
    held: Vec<Held>,
    pages: Vec<Vec<u8>>,
    /// Where the next page will stand.
    page_offset: u64,
}

impl Built {
    /// Gives the pages of siblings, then of what lies below each, their places, where they have none.
    fn place(&mut self, siblings: &mut [Subtree]) {
        let mut open = vec![siblings];
        while let Some(group) = open.pop() {
            for tree in group.iter_mut().filter(|t| !t.page.is_empty()) {
                let page = std::mem::take(&mut tree.page);
                tree.node.page_bytes = page.len() as u32;
                tree.node.page_offset = self.page_offset;
                self.page_offset += page.len() as u64;
                self.pages.push(page);
            }
            let below = group.iter_mut().map(|t| t.children.as_mut_slice());
            open.extend(below.filter(|b| b.iter().any(|c| !c.page.is_empty())).rev());
        }
    }

    /// Keeps a cell with only the rows that it offers.
    fn hold(&mut self, mut pending: Pending, rows: &Rows<'_>) {
        self.place(&mut pending.children);
        let mut bytes = Vec::with_capacity(pending.offered.len() * rows.stride);
        pending.offered.iter().for_each(|&i| bytes.extend_from_slice(rows.row(i)));
        pending.offered = (0..pending.offered.len() as u32).collect();
        self.held.push(Held { pending, rows: bytes });
    }

    /// Chooses a cell's points from what its children offer.
    fn combine(&mut self, context: &Context, cell: Cell, children: usize) {
        let stride = context.rows.bytes();
        let children = self.held.split_off(self.held.len() - children);
        let mut bytes = Vec::with_capacity(children.iter().map(|c| c.rows.len()).sum());
        let mut pending = Vec::with_capacity(children.len());
        for mut child in children {
            let before = (bytes.len() / stride) as u32;
            child.pending.offered.iter_mut().for_each(|i| *i += before);
            bytes.extend_from_slice(&child.rows);
            pending.push(child.pending);
        }
        let rows = Rows { bytes: &bytes, stride };
        self.hold(context.combine(&rows, cell, pending), &rows);
    }
}

impl Store<'_> {
    /// Writes pages that have their places.
    fn write(&mut self, pages: Vec<Vec<u8>>) -> Result<(), BuildError> {
        pages.into_iter().try_for_each(|page| self.writer.write_page(&page).map(|_| ()))?;
        Ok(())
    }

    /// Sorts the rows of a chunk into `rows`.
    fn load(
        &mut self,
        buckets: Vec<Bucket>,
        stride: usize,
        mut rows: Vec<u8>,
    ) -> Result<Vec<u8>, BuildError> {
        let is_stored = buckets.iter().any(|b| !b.extents.is_empty());
        let map = if is_stored { Some(self.scratch.map()?) } else { None };
        let runs: Vec<_> = buckets.iter().map(|b| b.runs(map.as_ref(), stride)).collect();
        sort(&runs, stride, &mut rows);
        drop(runs);
        drop(map);
        if let Some(borders) = &self.borders {
            borders.estimate(&cell_of(&buckets), &mut rows, self.scratch)?;
        }
        self.scratch.release(buckets.into_iter().flat_map(|b| b.extents).collect());
        Ok(rows)
    }
}

impl Raiser<'_> {
    /// The finished tree over buckets along the Morton curve; `None` where there is no row.
    ///
    /// # Errors
    /// Where scratch or the file fail, or on request.
    pub fn tree(&mut self, buckets: Vec<Bucket>) -> Result<Option<Subtree>, BuildError> {
        let page_offset = self.store.writer.offset();
        let mut built = Built { held: Vec::new(), pages: Vec::new(), page_offset };
        let mut steps = Vec::new();
        if !buckets.is_empty() {
            self.plan(buckets, &mut steps);
            self.put_aside(&steps)?;
        }
        while let Some(step) = steps.pop() {
            self.task.check()?;
            match step {
                Step::Chunk(buckets) => self.chunks(buckets, &mut steps, &mut built)?,
                Step::Part(bucket) => {
                    let parts = self.part(bucket)?;
                    let before = steps.len();
                    self.plan(parts, &mut steps);
                    self.put_aside(&steps[before..])?;
                }
                Step::Coincident(bucket) => self.coincident(bucket, &mut built)?,
                Step::Combine(cell, children) => built.combine(self.context, cell, children),
            }
        }
        let Some(held) = built.held.pop() else { return Ok(None) };
        let rows = Rows { bytes: &held.rows, stride: self.context.rows.bytes() };
        let mut root = self.context.finish(&rows, held.pending, &[], None);
        built.place(root.as_mut_slice());
        self.store.write(built.pages)?;
        Ok(root)
    }

    /// Puts the steps that build these buckets on the stack; the first one comes to lie on top.
    fn plan(&self, mut buckets: Vec<Bucket>, steps: &mut Vec<Step>) {
        let rows: u64 = buckets.iter().map(|b| b.rows).sum();
        let (joined_max, single_max) = self.chunk_rows_max;
        if rows <= joined_max {
            return steps.push(Step::Chunk(buckets));
        }
        if buckets.len() == 1 {
            return steps.extend(buckets.into_iter().map(|bucket| {
                if rows <= single_max {
                    Step::Chunk(vec![bucket])
                } else if bucket.cell.log2 == 0 {
                    Step::Coincident(bucket)
                } else {
                    Step::Part(bucket)
                }
            }));
        }
        let first = buckets[0].cell.corner;
        let last = buckets[buckets.len() - 1].cell.last();
        let cell = Cell::enclosing(first, last);
        let mut parts = Vec::new();
        for octant in (0..8).rev() {
            let start = buckets.partition_point(|b| cell.octant(b.cell.corner) < octant);
            let part = buckets.split_off(start);
            if !part.is_empty() {
                parts.push(part);
            }
        }
        steps.push(Step::Combine(cell, parts.len()));
        parts.into_iter().for_each(|part| self.plan(part, steps));
    }

    /// Puts aside what the chunks of these steps need of each other.
    fn put_aside(&mut self, steps: &[Step]) -> Result<(), BuildError> {
        let Some(borders) = self.store.borders.as_mut().filter(|_| steps.len() > 1) else {
            return Ok(());
        };
        for step in steps {
            self.task.check()?;
            match step {
                Step::Chunk(buckets) => borders.add(buckets, self.store.scratch)?,
                Step::Part(bucket) | Step::Coincident(bucket) => {
                    borders.add(std::slice::from_ref(bucket), self.store.scratch)?;
                }
                Step::Combine(..) => {}
            }
        }
        Ok(())
    }

    /// Builds chunks, and the cells above that wait for them, until another step is on top.
    fn chunks(
        &mut self,
        first: Vec<Bucket>,
        steps: &mut Vec<Step>,
        built: &mut Built,
    ) -> Result<(), BuildError> {
        let stride = self.context.rows.bytes();
        let mut rows = Some(self.store.load(first, stride, Vec::new())?);
        let mut spare = Vec::new();
        while let Some(sorted) = rows {
            let above = steps.iter().rev().take_while(|s| matches!(s, Step::Combine(..))).count();
            let above = steps.split_off(steps.len() - above);
            let next = match steps.pop() {
                Some(Step::Chunk(buckets)) => Some(buckets),
                other => {
                    steps.extend(other);
                    None
                }
            };
            let pages = std::mem::take(&mut built.pages);
            let (context, task, peak, store) =
                (self.context, self.task, self.peak, &mut self.store);
            let ((), loaded) = rayon::join(
                || {
                    let rows = Rows { bytes: &sorted, stride };
                    let pending = context.build(&rows, 0..rows.len() as u32, task);
                    peak.sample();
                    built.hold(pending, &rows);
                    for step in above.into_iter().rev() {
                        if let Step::Combine(cell, children) = step {
                            built.combine(context, cell, children);
                        }
                    }
                },
                || {
                    store.write(pages)?;
                    next.map(|buckets| store.load(buckets, stride, spare)).transpose()
                },
            );
            rows = loaded?;
            spare = sorted;
            self.peak.sample();
            self.task.check()?;
        }
        Ok(())
    }

    /// Parts a bucket that is too large into smaller cells: some levels below the smallest cell that
    /// holds its rows, so that a far outlier or a stack of points costs one pass, not one for each level.
    fn part(&mut self, mut bucket: Bucket) -> Result<Vec<Bucket>, BuildError> {
        let stride = self.context.rows.bytes();
        let scratch = &mut *self.store.scratch;
        let map = if bucket.extents.is_empty() { None } else { Some(scratch.map()?) };
        let runs = bucket.runs(map.as_ref(), stride);
        let blocks: Vec<&[u8]> = runs.iter().flat_map(|r| r.chunks(BLOCK_ROWS * stride)).collect();
        let empty = || ([u32::MAX; 3], [0; 3]);
        let join = |a: ([u32; 3], [u32; 3]), b: ([u32; 3], [u32; 3])| {
            ([0, 1, 2].map(|i| a.0[i].min(b.0[i])), [0, 1, 2].map(|i| a.1[i].max(b.1[i])))
        };
        let bounds_of = |rows: &&[u8]| {
            let positions = rows.chunks_exact(stride).map(position);
            positions.fold(empty(), |bounds, p| join(bounds, (p, p)))
        };
        let (min, max) = blocks.par_iter().map(bounds_of).reduce(empty, join);
        self.task.check()?;
        let log2 = Cell::enclosing(min, max).log2.saturating_sub(PART_LEVELS);
        // Rows in memory lie in blocks that others share, so they are not freed as they are parted.
        let buffer_bytes_max =
            if map.is_some() { self.buffer_bytes_max } else { self.buffer_bytes_max / 8 };
        let mut partition = Partition::new(stride, log2, buffer_bytes_max);
        for group in blocks.chunks(rayon::current_num_threads().max(1)) {
            self.task.check()?;
            let parted: Vec<_> =
                group.par_iter().map(|rows| block_of_rows(rows, stride, log2)).collect();
            parted.into_iter().try_for_each(|block| partition.add(block, scratch))?;
        }
        drop((blocks, runs));
        drop(map);
        scratch.release(std::mem::take(&mut bucket.extents));
        drop(bucket);
        partition.finish(scratch)
    }

    /// More coincident points than memory holds: a node's worth at a time, in the order of their records.
    fn coincident(&mut self, bucket: Bucket, built: &mut Built) -> Result<(), BuildError> {
        let stride = self.context.rows.bytes();
        let scratch = &mut *self.store.scratch;
        let borders = self.store.borders.take();
        let normal = match &borders {
            Some(borders) => borders.estimate_one(&bucket.cell, scratch)?,
            None => UNKNOWN,
        };
        let map = if bucket.extents.is_empty() { None } else { Some(scratch.map()?) };
        let rows = Coincident {
            runs: bucket.runs(map.as_ref(), stride),
            stride,
            rows_max: self.chunk_rows_max.1,
            task: self.task,
        };
        let (mut head, mut chain, mut carry) = (None, Vec::new(), Vec::new());
        rows.in_order(&mut |row| {
            let start = carry.len();
            carry.extend_from_slice(row);
            if let Some(borders) = &borders {
                borders.set(&mut carry[start..], normal);
            }
            if carry.len() == self.context.capacity * stride {
                let rows = Rows { bytes: &carry, stride };
                self.link(&rows, bucket.cell, built, &mut head, &mut chain)?;
                carry.clear();
            }
            Ok(())
        })?;
        if !carry.is_empty() {
            let rows = Rows { bytes: &carry, stride };
            self.link(&rows, bucket.cell, built, &mut head, &mut chain)?;
        }
        drop(rows);
        drop(map);
        self.store.borders = borders;
        self.store.scratch.release(bucket.extents);
        let mut head = head.ok_or_else(|| BuildError::Proof("a bucket lost its rows".into()))?;
        for (moments, mut node) in chain.into_iter().rev() {
            head.pending.moments.merge(&moments);
            node.children = std::mem::take(&mut head.pending.children);
            head.pending.children.push(node);
        }
        built.held.push(head);
        Ok(())
    }

    /// The next node of a chain of coincident points: its head, or one that continues it.
    fn link(
        &mut self,
        rows: &Rows<'_>,
        cell: Cell,
        built: &mut Built,
        head: &mut Option<Held>,
        chain: &mut Vec<(Moments, Subtree)>,
    ) -> Result<(), BuildError> {
        let pending = self.context.leaf(rows, 0..rows.len() as u32, cell);
        self.task.advance(rows.len() as u64);
        if head.is_none() {
            *head = Some(Held { pending, rows: rows.bytes.to_vec() });
        } else if let Some((moments, mut node)) = self.context.continuation(rows, pending) {
            built.place(std::slice::from_mut(&mut node));
            self.store.write(std::mem::take(&mut built.pages))?;
            chain.push((moments, node));
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
