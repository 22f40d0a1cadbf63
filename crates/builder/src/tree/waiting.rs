//! What is built: cells that wait for the one above, and what waits to be written; and how the
//! journal keeps it.

use crate::page::histograms::Counts;
use crate::rows::journal_record::{Kind, Reading, Record};
use crate::rows::row::{RowLayout, Rows};
use crate::rows::store::Outgoing;
use crate::sample::cell::Context;
use crate::sample::pending::{Below, PendingCell};
use crate::sample::shape::Moments;
use crate::tree::finishing::Unfinished;
use crate::tree::subtree::Subtree;
use esker_format::NodeStatistics;
use esker_points::task::Silent;
use esker_points::{Cell, MultisetHash, Node};
use rayon::prelude::*;
use std::ops::Range;

/// What is built: cells that wait for the one above, and what waits to be written.
#[derive(Default)]
pub struct Built {
    /// Cells, whose children are joined from the last ones.
    pub held: Vec<Held>,
    /// What waits to be written.
    pub outgoing: Outgoing,
    /// Where the next page will stand.
    pub page_offset: u64,
    /// The part that is being built.
    part: Part,
}

/// A part of a build that the journal knows when it is done.
#[derive(Default)]
struct Part {
    /// Where its first page stands.
    page_offset: u64,
    pages: crc32fast::Hasher,
    /// Whether the journal wants to know of it.
    is_told: bool,
}

/// Pages of nodes, in the order in which they are to stand.
#[derive(Default)]
pub struct Pages {
    pages: Vec<Vec<u8>>,
    bytes: u64,
    /// Of all of them, where that is wanted.
    crc: crc32fast::Hasher,
}

impl Pages {
    /// Takes those of siblings, then of what lies below each, where they have not been taken: the
    /// nodes are told their places from this offset on.
    pub fn take(siblings: &mut [Subtree], offset: u64, with_crc: bool) -> Self {
        let mut taken = Self::default();
        let mut open = vec![siblings];
        while let Some(group) = open.pop() {
            for tree in group.iter_mut().filter(|t| !t.page.is_empty()) {
                let page = std::mem::take(&mut tree.page);
                tree.node.page_bytes = page.len() as u32;
                tree.node.page_offset = offset + taken.bytes;
                taken.bytes += page.len() as u64;
                if with_crc {
                    taken.crc.update(&page);
                }
                taken.pages.push(page);
            }
            let below = group.iter_mut().map(|t| t.children.as_mut_slice());
            open.extend(below.filter(|b| b.iter().any(|c| !c.page.is_empty())).rev());
        }
        taken
    }
}

impl Built {
    /// Gives the pages of siblings, then of what lies below each, their places, where they have
    /// none.
    pub fn place(&mut self, siblings: &mut [Subtree]) {
        let pages = Pages::take(siblings, self.page_offset, self.part.is_told);
        self.add(pages);
    }

    /// The same with pages that were taken from all nodes of these trees, as if they stood at the
    /// beginning.
    pub fn place_taken(&mut self, trees: &mut [Subtree], pages: Pages) {
        let mut open: Vec<&mut Subtree> = trees.iter_mut().collect();
        while let Some(tree) = open.pop() {
            tree.node.page_offset += self.page_offset;
            open.extend(tree.children.iter_mut());
        }
        self.add(pages);
    }

    fn add(&mut self, pages: Pages) {
        self.page_offset += pages.bytes;
        self.part.pages.combine(&pages.crc);
        self.outgoing.pages.extend(pages.pages);
    }

    /// A part begins.
    pub fn begin(&mut self, is_told: bool) {
        self.part = Part { page_offset: self.page_offset, is_told, ..Part::default() };
    }

    /// The part, of so many rows, has ended. The journal wants to know what its cell offers, as
    /// [`Held::offer`] has it, and what nodes are below.
    pub fn end(
        &mut self,
        context: &Context,
        (counts, rows): (Counts, u64),
        offer: Option<&Record>,
        below: &[Subtree],
    ) {
        let Part { page_offset, pages, is_told } = std::mem::take(&mut self.part);
        if let Some(offer) = offer.filter(|_| is_told) {
            let mut record = Record::new(Kind::Built);
            record.put([rows, page_offset, self.page_offset]);
            record.put(pages.finalize());
            counts.put(context.rows.attribute_count(), &mut record);
            record.append(offer);
            put_nodes(below, &mut record);
            self.outgoing.record = Some(record);
        }
        context.counts.merge(&counts);
    }

    /// Chooses a cell's points from what its children offer.
    pub fn combine(&mut self, context: &Context, cell: Cell, children: usize) {
        let stride = context.rows.bytes();
        let children = self.held.split_off(self.held.len() - children);
        let (bytes, pending) = join(children, stride);
        let rows = Rows { bytes: &bytes, stride };
        let mut pending = context.combine(&rows, cell, pending);
        let unfinished = Unfinished::below(&mut pending);
        // The points have been told of.
        let finish = |i| unfinished.finish(i, context, &rows, &context.counts, &Silent);
        (0..unfinished.len()).into_par_iter().for_each(finish);
        let (mut children, _) = unfinished.into_children().unwrap_or_default();
        self.place(&mut children);
        pending.below = Below::Finished(children);
        self.held.push(Held::new(pending, &rows));
    }
}

/// Cells that one above is made of, with all their rows.
pub fn join(cells: Vec<Held>, stride: usize) -> (Vec<u8>, Vec<PendingCell>) {
    let mut bytes = Vec::with_capacity(cells.iter().map(|c| c.rows.len()).sum());
    let mut pending = Vec::with_capacity(cells.len());
    for mut cell in cells {
        let before = (bytes.len() / stride) as u32;
        cell.pending.offered.iter_mut().for_each(|i| *i += before);
        bytes.extend_from_slice(&cell.rows);
        pending.push(cell.pending);
    }
    (bytes, pending)
}

/// A part as the journal has it.
pub struct PartRead {
    /// Points that it was built from.
    pub rows: u64,
    /// Where its pages stand.
    pub pages: Range<u64>,
    /// Their CRC-32.
    pub crc: u32,
    /// What its nodes have counted, an attribute each.
    pub counts: Vec<Vec<u64>>,
    /// Its cell.
    pub held: Held,
}

impl PartRead {
    /// From a record; `None` where that is damaged.
    pub fn get(record: &[u8], layout: &RowLayout) -> Option<Self> {
        let mut from = Reading(record);
        let [rows, start, end] = from.get()?;
        let crc = from.get()?;
        let attributes = layout.attribute_count();
        let counts: Option<_> = (0..attributes).map(|_| from.get_all()).collect();
        let (counts, pages) = (counts?, start..end);
        let held = Held::get(&mut from, layout.bytes(), attributes)?;
        (start <= end).then_some(Self { rows, pages, crc, counts, held })
    }
}

/// A cell that is built but for its root, with the rows that the root has.
pub struct Held {
    /// The cell; what it has is all of the rows.
    pub pending: PendingCell,
    /// The rows.
    pub rows: Vec<u8>,
}

impl Held {
    /// A cell, all below which is finished, with only the rows of its root.
    pub fn new(mut pending: PendingCell, rows: &Rows<'_>) -> Self {
        let mut bytes = Vec::with_capacity(pending.offered.len() * rows.stride);
        pending.offered.iter().for_each(|&i| bytes.extend_from_slice(rows.row(i)));
        pending.offered = (0..pending.offered.len() as u32).collect();
        Self { pending, rows: bytes }
    }

    /// What it offers, for the journal; the nodes below follow.
    pub fn offer(&self) -> Record {
        let mut record = Record::new(Kind::Built);
        let PendingCell { cell, moments, sampled, turns, radii, shares, .. } = &self.pending;
        record.put(cell.corner);
        record.put(cell.log2);
        record.put(moments.to_numbers());
        record.put(*sampled as u64);
        record.put_all(turns);
        record.put_all(radii);
        record.put_all(shares);
        record.put_all(&self.rows);
        record
    }

    /// What was written down, of rows of `stride` bytes with so many attributes.
    pub fn get(from: &mut Reading<'_>, stride: usize, attributes: usize) -> Option<Self> {
        let cell = Cell { corner: from.get()?, log2: from.get()? };
        let moments = Moments::from_numbers(from.get()?);
        let sampled = usize::try_from(from.get::<u64>()?).ok()?;
        let (turns, radii): (Vec<u16>, Vec<f32>) = (from.get_all()?, from.get_all()?);
        let (shares, rows): (Vec<f32>, Vec<u8>) = (from.get_all()?, from.get_all()?);
        let count = rows.len() / stride;
        let fits = |len: usize| len == 0 || len == count;
        let fits_rows = rows.len().is_multiple_of(stride) && sampled <= count;
        let fits_shares = shares.is_empty() || shares.len() == sampled;
        if !fits_rows || !fits_shares || turns.len() != radii.len() || !fits(turns.len()) {
            return None;
        }
        let mut trees: Vec<Subtree> = Vec::new();
        for _ in 0..from.get::<u64>()? {
            let node: Node = from.get()?;
            let statistics = NodeStatistics::from_words(&from.get_all::<u64>()?, attributes)?;
            let (hash, bounds) = (MultisetHash(from.get()?), from.get()?);
            let children = usize::try_from(from.get::<u64>()?).ok()?;
            let children = trees.split_off(trees.len().checked_sub(children)?);
            let children = children.into_iter().collect();
            trees.push(Subtree { node, page: Vec::new(), statistics, hash, bounds, children });
        }
        let below = Below::Finished(trees.into());
        let offered = (0..count as u32).collect();
        let pending = PendingCell { cell, moments, offered, sampled, turns, radii, shares, below };
        Some(Self { pending, rows })
    }
}

/// Writes down nodes whose pages have their places, and all below them.
fn put_nodes(nodes: &[Subtree], record: &mut Record) {
    // Children before parents, in their order; without recursion, since chains are long.
    let (mut open, mut all): (Vec<&Subtree>, Vec<_>) = (nodes.iter().collect(), vec![]);
    while let Some(tree) = open.pop() {
        open.extend(tree.children.iter());
        all.push(tree);
    }
    record.put(all.len() as u64);
    for tree in all.into_iter().rev() {
        record.put(tree.node);
        record.put_all(&tree.statistics.to_words());
        record.put(tree.hash.0);
        record.put(tree.bounds);
        record.put(tree.children.len() as u64);
    }
}
