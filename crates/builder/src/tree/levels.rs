//! The levels above the chunks. Buckets are joined to chunks or parted until each fits memory: a
//! list of steps that does not depend on time.

use crate::attributes::normals::UNKNOWN;
use crate::budget::memory::Peak;
use crate::error::BuildError;
use crate::page::histograms::Counts;
use crate::rows::coincident::Coincident;
use crate::rows::journal_record::Kind;
use crate::rows::partition::Bucket;
use crate::rows::row::Rows;
use crate::rows::store::Store;
use crate::sample::cell::Context;
use crate::sample::pending::Below;
use crate::sample::shape::Moments;
use crate::tree::subtree::Subtree;
use crate::tree::waiting::{Built, Held, PartRead};
use esker_points::{Cell, Task};

/// Builds a tree out of buckets.
pub struct Raiser<'a> {
    /// What every step knows.
    pub context: &'a Context,
    /// Where rows lie and pages go.
    pub store: &'a mut Store,
    /// Rows that a chunk of several buckets may have, and one of a single bucket.
    pub chunk_rows_max: (u64, u64),
    /// Bytes of rows that parting a bucket may keep in memory.
    pub buffer_bytes_max: usize,
    /// Told how far it is.
    pub task: &'a dyn Task,
    /// Watches memory.
    pub peak: &'a Peak,
}

/// What is done next. Each leaves one cell behind that is built but for its root.
pub enum Step {
    /// Builds the points of these buckets, which fit memory.
    Chunk(Vec<Bucket>),
    /// Parts a bucket that does not fit memory.
    Part(Bucket),
    /// Builds a lattice point that does not fit memory.
    Coincident(Bucket),
    /// Takes the last so many cells for the children of this one.
    Combine(Cell, usize),
}

impl Raiser<'_> {
    /// The finished tree over buckets along the Morton curve; `None` where there is no row.
    ///
    /// # Errors
    /// Where scratch or the file fail, or on request.
    pub fn tree(&mut self, buckets: Vec<Bucket>) -> Result<Option<Subtree>, BuildError> {
        let mut built = Built::default();
        built.page_offset = self.store.writer.offset();
        let mut steps = Vec::new();
        if !buckets.is_empty() {
            self.plan(buckets, &mut steps);
            self.put_aside(&steps)?;
        }
        while let Some(step) = steps.pop() {
            self.task.check()?;
            match step {
                Step::Chunk(buckets) => {
                    if !self.resume(&buckets, &mut built)? {
                        steps.push(Step::Chunk(buckets));
                        self.chunks(&mut steps, &mut built)?;
                    }
                }
                Step::Part(bucket) => {
                    self.store.write(std::mem::take(&mut built.outgoing))?;
                    let cell = bucket.cell;
                    let parts = self.part(bucket)?;
                    let before = steps.len();
                    self.plan(parts, &mut steps);
                    if steps.len() - before > 1 {
                        self.store.forget_aside(&cell);
                    }
                    self.put_aside(&steps[before..])?;
                }
                Step::Coincident(bucket) => {
                    if !self.resume(std::slice::from_ref(&bucket), &mut built)? {
                        self.coincident(bucket, &mut built)?;
                    }
                }
                Step::Combine(cell, children) => built.combine(self.context, cell, children),
            }
        }
        let Some(held) = built.held.pop() else { return Ok(None) };
        let rows = Rows { bytes: &held.rows, stride: self.context.rows.bytes() };
        let mut root = self.context.finish(&rows, held.pending, &[], None, &self.context.counts);
        built.place(root.as_mut_slice());
        self.store.write(built.outgoing)?;
        Ok(root)
    }

    /// Takes a part from the journal, where it has it.
    fn resume(&mut self, buckets: &[Bucket], built: &mut Built) -> Result<bool, BuildError> {
        let Some(record) = self.store.journal.ask(Kind::Built)? else { return Ok(false) };
        let rows: u64 = buckets.iter().map(|b| b.rows).sum();
        // What cells above have made of the parts before stands before its pages.
        self.store.write(std::mem::take(&mut built.outgoing))?;
        let part = PartRead::get(&record, &self.context.rows)
            .filter(|part| part.rows == rows && part.pages.start == built.page_offset);
        let damaged = |store: &Store| store.journal.damaged("a part of what it has built");
        let part = part.ok_or_else(|| damaged(self.store))?;
        let page_bytes = part.pages.end - part.pages.start;
        if !self.context.counts.add_all(&part.counts)
            || !self.store.writer.skip(page_bytes, part.crc)?
        {
            return Err(damaged(self.store));
        }
        built.page_offset = part.pages.end;
        built.held.push(part.held);
        let extents = buckets.iter().flat_map(|b| b.extents.iter().copied());
        self.store.scratch.release(extents.collect());
        self.task.advance(rows);
        Ok(true)
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
        if self.store.borders.is_none() || steps.len() < 2 || self.store.resume_aside()? {
            return Ok(());
        }
        let known = self.store.aside().len();
        for step in steps {
            self.task.check()?;
            let buckets = match step {
                Step::Chunk(buckets) => buckets,
                Step::Part(bucket) | Step::Coincident(bucket) => std::slice::from_ref(bucket),
                Step::Combine(..) => continue,
            };
            self.store.put_aside(buckets, &self.context.rows)?;
        }
        self.store.tell_aside(known)
    }

    /// More coincident points than memory holds: a node's worth at a time, in the order of their
    /// records.
    fn coincident(&mut self, bucket: Bucket, built: &mut Built) -> Result<(), BuildError> {
        let stride = self.context.rows.bytes();
        let borders = self.store.borders.take();
        let normal = match &borders {
            Some(borders) => borders.estimate_one(&bucket.cell, &self.store.scratch.map()?),
            None => UNKNOWN,
        };
        self.store.write(std::mem::take(&mut built.outgoing))?;
        let is_told = self.store.journal.is_live();
        built.begin(is_told);
        let counts = self.context.counts.beside();
        let map = self.store.map(&bucket)?;
        let runs = bucket.runs(map.as_ref(), stride);
        self.store.check(&bucket, &runs, &self.context.rows)?;
        let rows = Coincident { runs, stride, rows_max: self.chunk_rows_max.1, task: self.task };
        let (mut head, mut chain, mut carry) = (None, Vec::new(), Vec::new());
        rows.in_order(&mut |row| {
            let start = carry.len();
            carry.extend_from_slice(row);
            if let Some(borders) = &borders {
                borders.set(&mut carry[start..], normal);
            }
            if carry.len() == self.context.capacity * stride {
                let rows = Rows { bytes: &carry, stride };
                self.link(&rows, bucket.cell, &counts, built, &mut head, &mut chain)?;
                carry.clear();
            }
            Ok(())
        })?;
        if !carry.is_empty() {
            let rows = Rows { bytes: &carry, stride };
            self.link(&rows, bucket.cell, &counts, built, &mut head, &mut chain)?;
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
        let offer = is_told.then(|| head.offer());
        let below = match &head.pending.below {
            Below::Finished(nodes) => nodes.as_slice(),
            _ => &[],
        };
        built.end(self.context, (counts, bucket.rows), offer.as_ref(), below);
        built.held.push(head);
        built.outgoing.extents = bucket.extents;
        Ok(())
    }

    /// The next node of a chain of coincident points: its head, or one that continues it.
    fn link(
        &mut self,
        rows: &Rows<'_>,
        cell: Cell,
        counts: &Counts,
        built: &mut Built,
        head: &mut Option<Held>,
        chain: &mut Vec<(Moments, Subtree)>,
    ) -> Result<(), BuildError> {
        let pending = self.context.leaf(rows, 0..rows.len() as u32, cell);
        self.task.advance(rows.len() as u64);
        if head.is_none() {
            *head = Some(Held { pending, rows: rows.bytes.to_vec() });
        } else if let Some((moments, mut node)) = self.context.continuation(rows, pending, counts) {
            built.place(std::slice::from_mut(&mut node));
            self.store.write(std::mem::take(&mut built.outgoing))?;
            chain.push((moments, node));
        }
        Ok(())
    }
}
