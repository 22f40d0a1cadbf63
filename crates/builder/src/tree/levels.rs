//! Builds the tree from buckets. They are joined to chunks, or split, until each fits memory; cells
//! above are combined from their children. The list of steps does not depend on time or threads.
//! Parts of a tree may be built by different machines, and joined.

use crate::budget::memory::Peak;
use crate::error::BuildError;
use crate::page::histograms::Counts;
use crate::rows::coincident::{Coincident, ROWS_MIN};
use crate::rows::journal_record::Kind;
use crate::rows::partition::Bucket;
use crate::rows::row::Rows;
use crate::rows::store::Store;
use crate::sample::cell::Context;
use crate::sample::pending::Below;
use crate::sample::shape::Moments;
use crate::tree::subtree::Subtree;
use crate::tree::waiting::{PartialTree, RecordedChunk, SampledCell};
use esker_points::{Cell, Task};

/// Builds a tree from buckets.
pub struct TreeBuilder<'a> {
    /// Sampling and finishing of cells.
    pub context: &'a Context,
    /// Files of the build.
    pub store: &'a mut Store,
    /// Most rows of a chunk of several buckets, and of a chunk of one bucket.
    pub chunk_rows_max: (u64, u64),
    /// Most bytes of rows that splitting a bucket keeps in memory.
    pub buffer_bytes_max: usize,
    /// Receives the progress, and says whether to stop.
    pub task: &'a dyn Task,
    /// Samples the memory in use.
    pub peak: &'a Peak,
}

/// A step of the build. Each adds one cell to [`PartialTree::cells`],
/// except that a split adds steps.
pub enum Step {
    /// Builds the points of these buckets, which fit memory.
    Chunk(Vec<Bucket>),
    /// Splits a bucket that does not fit memory.
    Split(Bucket),
    /// Builds a lattice point with more coincident points than fit memory.
    Coincident(Bucket),
    /// Samples this cell from its children, which are the last cells; their number.
    Combine(Cell, usize),
}

/// A step of the tree above parts, in the order in which they are done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PartStep {
    /// Adds the part of this index.
    Part(u32),
    /// Samples this cell from its children, which are the last cells; their number.
    Combine(Cell, u32),
}

/// Writes the pages of the part of an index to the file, and returns its record.
pub type OpenPart<'o> = dyn FnMut(u32, &mut Store) -> Result<RecordedChunk, BuildError> + 'o;

impl TreeBuilder<'_> {
    /// Builds the tree of buckets in Morton order; `None` if there are no rows.
    ///
    /// # Errors
    /// If scratch or the file fail, or on request.
    pub fn build(&mut self, buckets: Vec<Bucket>) -> Result<Option<Subtree>, BuildError> {
        let mut tree = PartialTree::from(self.store.writer.offset());
        self.build_cell(buckets, &mut tree)?;
        self.finish_root(tree)
    }

    /// Builds a part of a tree: of buckets in Morton order, at least one, that hold all points of
    /// their cell. Returns what the cell offers to the cells above, with the nodes below it, whose
    /// pages are in the file.
    ///
    /// # Errors
    /// If scratch or the file fail, or on request.
    pub fn build_part(&mut self, buckets: Vec<Bucket>) -> Result<SampledCell, BuildError> {
        let mut tree = PartialTree::from(self.store.writer.offset());
        self.build_cell(buckets, &mut tree)?;
        self.store.write(std::mem::take(&mut tree.outgoing))?;
        self.store.writer.flush()?;
        tree.cells.pop().ok_or_else(|| BuildError::Proof("a part lost its rows".into()))
    }

    /// Builds the tree above parts, by `steps` in their order; `None` if there are no parts. `open`
    /// writes the pages of a part to the file, and returns its record.
    ///
    /// # Errors
    /// If `open` or the file fail, or on request.
    pub fn join(
        &mut self,
        steps: &[PartStep],
        open: &mut OpenPart<'_>,
    ) -> Result<Option<Subtree>, BuildError> {
        let mut tree = PartialTree::from(self.store.writer.offset());
        for step in steps {
            self.task.check()?;
            match *step {
                PartStep::Part(part) => {
                    let mut chunk = open(part, self.store)?;
                    chunk.cell.shift_pages(chunk.pages.start, tree.page_offset);
                    tree.page_offset += chunk.pages.end - chunk.pages.start;
                    let is_placed = tree.page_offset == self.store.writer.offset();
                    if !is_placed || !self.context.counts.add_all(&chunk.counts) {
                        return Err(BuildError::Proof(format!("part {part} lost its pages")));
                    }
                    self.task.advance(chunk.rows);
                    tree.cells.push(chunk.cell);
                }
                PartStep::Combine(cell, child_count) => {
                    tree.combine(self.context, cell, child_count as usize);
                    self.store.write(std::mem::take(&mut tree.outgoing))?;
                }
            }
            self.peak.sample();
        }
        self.finish_root(tree)
    }

    /// Builds the cells of buckets, up to one that holds them all.
    fn build_cell(
        &mut self,
        buckets: Vec<Bucket>,
        tree: &mut PartialTree,
    ) -> Result<(), BuildError> {
        let mut steps = Vec::new();
        if !buckets.is_empty() {
            self.plan_steps(buckets, &mut steps);
            self.store_borders(&steps)?;
        }
        while let Some(step) = steps.pop() {
            self.task.check()?;
            match step {
                Step::Chunk(buckets) => {
                    if !self.resume_chunk(&buckets, tree)? {
                        steps.push(Step::Chunk(buckets));
                        self.build_chunks(&mut steps, tree)?;
                    }
                }
                Step::Split(bucket) => {
                    self.store.write(std::mem::take(&mut tree.outgoing))?;
                    let cell = bucket.cell;
                    let buckets = self.split(bucket)?;
                    let before = steps.len();
                    self.plan_steps(buckets, &mut steps);
                    if steps.len() - before > 1 {
                        self.store.release_border(&cell);
                    }
                    self.store_borders(&steps[before..])?;
                }
                Step::Coincident(bucket) => {
                    if !self.resume_chunk(std::slice::from_ref(&bucket), tree)? {
                        self.build_coincident(bucket, tree)?;
                    }
                }
                Step::Combine(cell, child_count) => tree.combine(self.context, cell, child_count),
            }
        }
        Ok(())
    }

    /// Finishes the uppermost node; `None` if there are no points.
    fn finish_root(&mut self, mut tree: PartialTree) -> Result<Option<Subtree>, BuildError> {
        let Some(cell) = tree.cells.pop() else { return Ok(None) };
        let rows = Rows { bytes: &cell.rows, stride: self.context.rows.bytes() };
        let mut root = self.context.finish(&rows, cell.pending, &[], None, &self.context.counts);
        tree.place(root.as_mut_slice());
        self.store.write(tree.outgoing)?;
        Ok(root)
    }

    /// Restores a chunk from the journal; returns whether the journal has it.
    fn resume_chunk(
        &mut self,
        buckets: &[Bucket],
        tree: &mut PartialTree,
    ) -> Result<bool, BuildError> {
        let Some(record) = self.store.journal.next(Kind::Chunk)? else { return Ok(false) };
        let rows: u64 = buckets.iter().map(|b| b.rows).sum();
        // Pages of cells above earlier chunks come before those of this one.
        self.store.write(std::mem::take(&mut tree.outgoing))?;
        let chunk = RecordedChunk::get(&record, &self.context.rows)
            .filter(|chunk| chunk.rows == rows && chunk.pages.start == tree.page_offset);
        let damaged = |store: &Store| store.journal.damaged("a part of what it has built");
        let chunk = chunk.ok_or_else(|| damaged(self.store))?;
        let page_bytes = chunk.pages.end - chunk.pages.start;
        if !self.context.counts.add_all(&chunk.counts)
            || !self.store.writer.skip(page_bytes, chunk.crc)?
        {
            return Err(damaged(self.store));
        }
        tree.page_offset = chunk.pages.end;
        tree.cells.push(chunk.cell);
        let extents = buckets.iter().flat_map(|b| b.extents.iter().copied());
        self.store.scratch.release(extents.collect());
        self.task.advance(rows);
        Ok(true)
    }

    /// Pushes the steps that build `buckets` on the stack, the first step last.
    fn plan_steps(&self, mut buckets: Vec<Bucket>, steps: &mut Vec<Step>) {
        let rows: u64 = buckets.iter().map(|b| b.rows).sum();
        let (joined_max, single_max) = self.chunk_rows_max;
        let is_small = rows == self.context.points && rows <= self.context.arranged_points_max();
        if rows <= joined_max || is_small {
            return steps.push(Step::Chunk(buckets));
        }
        if buckets.len() == 1 {
            return steps.extend(buckets.into_iter().map(|bucket| {
                if rows <= single_max {
                    Step::Chunk(vec![bucket])
                } else if bucket.cell.log2 == 0 {
                    Step::Coincident(bucket)
                } else {
                    Step::Split(bucket)
                }
            }));
        }
        let first = buckets[0].cell.corner;
        let last = buckets[buckets.len() - 1].cell.last();
        let cell = Cell::enclosing(first, last);
        let mut octants = Vec::new();
        for octant in (0..8).rev() {
            let start = buckets.partition_point(|b| cell.octant(b.cell.corner) < octant);
            let own = buckets.split_off(start);
            if !own.is_empty() {
                octants.push(own);
            }
        }
        steps.push(Step::Combine(cell, octants.len()));
        octants.into_iter().for_each(|own| self.plan_steps(own, steps));
    }

    /// Stores what the chunks of these steps need of each other to estimate normals.
    fn store_borders(&mut self, steps: &[Step]) -> Result<(), BuildError> {
        if self.store.borders.is_none() || steps.len() < 2 || self.store.resume_borders()? {
            return Ok(());
        }
        let known = self.store.border_cells().len();
        for step in steps {
            self.task.check()?;
            let buckets = match step {
                Step::Chunk(buckets) => buckets,
                Step::Split(bucket) | Step::Coincident(bucket) => std::slice::from_ref(bucket),
                Step::Combine(..) => continue,
            };
            self.store.add_border(buckets, &self.context.rows)?;
        }
        self.store.record_borders(known)
    }

    /// Builds a lattice point with more coincident points than memory holds: a chain of nodes,
    /// filled one after the other in the order of rows.
    fn build_coincident(
        &mut self,
        bucket: Bucket,
        tree: &mut PartialTree,
    ) -> Result<(), BuildError> {
        let stride = self.context.rows.bytes();
        let borders = self.store.borders.take();
        self.store.write(std::mem::take(&mut tree.outgoing))?;
        let is_recorded = self.store.journal.is_recording();
        tree.begin_chunk(is_recorded);
        let counts = self.context.counts.beside();
        let map = self.store.map(&bucket)?;
        let runs = bucket.runs(map.as_ref(), stride);
        self.store.check_rows(&bucket, &runs, &self.context.rows)?;
        let beside = borders.as_ref().map(|_| self.store.scratch.map()).transpose()?;
        let surface = borders.as_ref().zip(beside);
        let surface =
            surface.map(|(beside, map)| (beside, beside.estimate_stack(&bucket.cell, &runs, &map)));
        // Only references are held, which are smaller than rows.
        let rows_max = self.chunk_rows_max.1.max(ROWS_MIN);
        let rows = Coincident { runs, stride, rows_max, task: self.task };
        let (mut head, mut chain, mut carry) = (None, Vec::new(), Vec::new());
        rows.in_order(&mut |row| {
            let start = carry.len();
            carry.extend_from_slice(row);
            if let Some((borders, surface)) = &surface {
                borders.set_of_stack(&mut carry[start..], surface);
            }
            if carry.len() == self.context.capacity * stride {
                let rows = Rows { bytes: &carry, stride };
                self.link(&rows, bucket.cell, &counts, tree, &mut head, &mut chain)?;
                carry.clear();
            }
            Ok(())
        })?;
        if !carry.is_empty() {
            let rows = Rows { bytes: &carry, stride };
            self.link(&rows, bucket.cell, &counts, tree, &mut head, &mut chain)?;
        }
        drop(rows);
        drop(map);
        self.store.borders = borders;
        let mut head = head.ok_or_else(|| BuildError::Proof("a bucket lost its rows".into()))?;
        for (moments, mut node) in chain.into_iter().rev() {
            head.pending.moments.merge(&moments);
            node.children = head.pending.below.take();
            head.pending.below = Below::Finished(vec![node].into());
        }
        let offer = is_recorded.then(|| head.record());
        tree.end_chunk(self.context, (counts, bucket.rows), offer.as_ref(), head.below());
        tree.cells.push(head);
        tree.outgoing.extents = bucket.extents;
        Ok(())
    }

    /// Adds the next node to a chain of coincident points: the head, or a node that continues it.
    fn link(
        &mut self,
        rows: &Rows<'_>,
        cell: Cell,
        counts: &Counts,
        tree: &mut PartialTree,
        head: &mut Option<SampledCell>,
        chain: &mut Vec<(Moments, Subtree)>,
    ) -> Result<(), BuildError> {
        let pending = self.context.leaf(rows, 0..rows.len() as u32, cell);
        self.task.advance(rows.len() as u64);
        if head.is_none() {
            *head = Some(SampledCell { pending, rows: rows.bytes.to_vec() });
        } else if let Some((moments, mut node)) = self.context.continuation(rows, pending, counts) {
            tree.place(std::slice::from_mut(&mut node));
            self.store.write(std::mem::take(&mut tree.outgoing))?;
            chain.push((moments, node));
        }
        Ok(())
    }
}
