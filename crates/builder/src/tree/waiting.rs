//! The tree while it is built: cells that wait for the cell above, pages that wait to be written,
//! and the journal's records of chunks.

use crate::page::histograms::Counts;
use crate::rows::journal_record::{Kind, Record, RecordReader};
use crate::rows::row::{RowLayout, Rows};
use crate::rows::store::Outgoing;
use crate::sample::cell::Context;
use crate::sample::pending::{Below, PendingCell};
use crate::sample::shape::Moments;
use crate::tree::finishing::Unfinished;
use crate::tree::pages::Pages;
use crate::tree::subtree::Subtree;
use esker_format::NodeStatistics;
use esker_points::task::Silent;
use esker_points::{Cell, MultisetHash, Node};
use rayon::prelude::*;
use std::ops::Range;

/// The tree while it is built.
#[derive(Default)]
pub struct PartialTree {
    /// Cells that wait for the cell above, whose children are the last ones.
    pub cells: Vec<SampledCell>,
    /// Pages and a journal record that wait to be written.
    pub outgoing: Outgoing,
    /// Offset of the next page in the file.
    pub page_offset: u64,
    /// The chunk in progress.
    chunk: ChunkPages,
}

/// Pages of a chunk in progress, for its journal record.
#[derive(Default)]
struct ChunkPages {
    /// Offset of the first page.
    page_offset: u64,
    crc: crc32fast::Hasher,
    /// Whether the journal records the chunk.
    is_recorded: bool,
}

impl From<u64> for PartialTree {
    /// An empty tree whose first page has its place at `page_offset`.
    fn from(page_offset: u64) -> Self {
        Self { page_offset, ..Self::default() }
    }
}

impl PartialTree {
    /// Takes the pages of siblings, then of the nodes below each, unless they have been taken, and
    /// gives them their places.
    pub fn place(&mut self, siblings: &mut [Subtree]) {
        let mut pages = self.pages_from_here();
        pages.take(siblings);
        self.add(pages);
    }

    /// Gives pages their places that were taken from all nodes of `trees` with offsets from 0 on.
    pub fn place_taken(&mut self, trees: &mut [Subtree], pages: Pages) {
        let mut open: Vec<&mut Subtree> = trees.iter_mut().collect();
        while let Some(tree) = open.pop() {
            tree.node.page_offset += self.page_offset;
            open.extend(tree.children.iter_mut());
        }
        self.add(pages);
    }

    /// No pages yet, with places from the next one of the file on.
    fn pages_from_here(&self) -> Pages {
        Pages::new(self.page_offset, self.chunk.is_recorded)
    }

    fn add(&mut self, pages: Pages) {
        self.page_offset += pages.bytes();
        let (pages, crc) = pages.into_parts();
        if let Some(crc) = crc {
            self.chunk.crc.combine(&crc);
        }
        self.outgoing.pages.extend(pages);
    }

    /// Begins a chunk.
    pub fn begin_chunk(&mut self, is_recorded: bool) {
        let page_offset = self.page_offset;
        self.chunk = ChunkPages { page_offset, is_recorded, ..ChunkPages::default() };
    }

    /// Ends a chunk of `rows` rows and makes its journal record, if chunks are recorded: with
    /// `offer`, made by [`SampledCell::record`], and the nodes `below`.
    pub fn end_chunk(
        &mut self,
        context: &Context,
        (counts, rows): (Counts, u64),
        offer: Option<&Record>,
        below: &[Subtree],
    ) {
        let ChunkPages { page_offset, crc, is_recorded } = std::mem::take(&mut self.chunk);
        if let Some(offer) = offer.filter(|_| is_recorded) {
            let pages = page_offset..self.page_offset;
            let chunk = (rows, pages, crc.finalize());
            self.outgoing.record = Some(record_of(context, chunk, &counts, offer, below));
        }
        context.counts.merge(&counts);
    }

    /// Samples a cell from what its children offer, which are the last `child_count` cells.
    pub fn combine(&mut self, context: &Context, cell: Cell, child_count: usize) {
        let stride = context.rows.bytes();
        let children = self.cells.split_off(self.cells.len() - child_count);
        let (bytes, pending) = join(children, stride);
        let rows = Rows { bytes: &bytes, stride };
        let mut pending = context.combine(&rows, cell, pending);
        let unfinished = Unfinished::below(&mut pending);
        // The points were reported with those of the chunks.
        let finish = |i| unfinished.finish(i, context, &rows, &context.counts, &Silent);
        (0..unfinished.len()).into_par_iter().for_each(finish);
        let mut pages = self.pages_from_here();
        let (children, _) = unfinished.into_children(&mut pages).unwrap_or_default();
        self.add(pages);
        pending.below = Below::Finished(children);
        self.cells.push(SampledCell::new(pending, &rows));
    }
}

/// Joins the rows of the children of a cell.
pub fn join(cells: Vec<SampledCell>, stride: usize) -> (Vec<u8>, Vec<PendingCell>) {
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

/// Record of a chunk, or of a part of a tree: `chunk` is the number of its rows, the place of its
/// pages and their CRC-32, `offer` what [`SampledCell::record`] makes, `below` the nodes below.
pub fn record_of(
    context: &Context,
    (rows, pages, crc): (u64, Range<u64>, u32),
    counts: &Counts,
    offer: &Record,
    below: &[Subtree],
) -> Record {
    let mut record = Record::new(Kind::Chunk);
    record.put([rows, pages.start, pages.end]);
    record.put(crc);
    counts.put(context.rows.attribute_count(), &mut record);
    record.append(offer);
    put_nodes(below, &mut record);
    record
}

/// A chunk as the journal recorded it, or a part of a tree.
pub struct RecordedChunk {
    /// Number of its rows.
    pub rows: u64,
    /// Place of its pages in the file.
    pub pages: Range<u64>,
    /// CRC-32 of its pages.
    pub crc: u32,
    /// Histogram of each attribute.
    pub counts: Vec<Vec<u64>>,
    /// Its cell.
    pub cell: SampledCell,
}

impl RecordedChunk {
    /// Reads a chunk from a record; `None` if the record is damaged.
    pub fn get(record: &[u8], layout: &RowLayout) -> Option<Self> {
        let mut from = RecordReader(record);
        let [rows, start, end] = from.get()?;
        let crc = from.get()?;
        let attributes = layout.attribute_count();
        let counts: Option<_> = (0..attributes).map(|_| from.get_all()).collect();
        let (counts, pages) = (counts?, start..end);
        let cell = SampledCell::get(&mut from, layout.bytes(), attributes)?;
        (start <= end).then_some(Self { rows, pages, crc, counts, cell })
    }
}

/// A sampled cell, with copies of the rows that it offers.
pub struct SampledCell {
    /// The cell, whose points are all of `rows`.
    pub pending: PendingCell,
    /// Rows that the cell offers.
    pub rows: Vec<u8>,
}

impl SampledCell {
    /// Copies the offered rows out of `rows`, those of the whole cell.
    pub fn new(mut pending: PendingCell, rows: &Rows<'_>) -> Self {
        let mut bytes = Vec::with_capacity(pending.offered.len() * rows.stride);
        pending.offered.iter().for_each(|&i| bytes.extend_from_slice(rows.row(i)));
        pending.offered = (0..pending.offered.len() as u32).collect();
        Self { pending, rows: bytes }
    }

    /// The nodes below, if they are finished.
    pub fn below(&self) -> &[Subtree] {
        match &self.pending.below {
            Below::Finished(nodes) => nodes,
            _ => &[],
        }
    }

    /// Moves the places of the pages of the nodes below, which were built from offset `from` on, to
    /// offset `to`.
    pub fn shift_pages(&mut self, from: u64, to: u64) {
        let Below::Finished(nodes) = &mut self.pending.below else { return };
        let mut open: Vec<&mut Subtree> = nodes.iter_mut().collect();
        while let Some(tree) = open.pop() {
            tree.node.page_offset = tree.node.page_offset.wrapping_sub(from).wrapping_add(to);
            open.extend(tree.children.iter_mut());
        }
    }

    /// Record of what the cell offers; in the journal the nodes below follow.
    pub fn record(&self) -> Record {
        let mut record = Record::new(Kind::Chunk);
        let PendingCell { cell, moments, sampled, withheld, least_radius, .. } = &self.pending;
        let PendingCell { turns, radii, shares, .. } = &self.pending;
        record.put(cell.corner);
        record.put(cell.log2);
        record.put(moments.to_numbers());
        record.put(*sampled as u64);
        record.put_all(withheld);
        record.put(*least_radius);
        record.put_all(turns);
        record.put_all(radii);
        record.put_all(shares);
        record.put_all(&self.rows);
        record
    }

    /// Reads a cell and the nodes below it, with rows of `stride` bytes and
    /// this number of attributes.
    pub fn get(from: &mut RecordReader<'_>, stride: usize, attributes: usize) -> Option<Self> {
        let cell = Cell { corner: from.get()?, log2: from.get()? };
        let moments = Moments::from_numbers(from.get()?);
        let sampled = usize::try_from(from.get::<u64>()?).ok()?;
        let (withheld, least_radius): (Vec<u32>, f64) = (from.get_all()?, from.get()?);
        let (turns, radii): (Vec<u16>, Vec<f32>) = (from.get_all()?, from.get_all()?);
        let (shares, rows): (Vec<f32>, Vec<u8>) = (from.get_all()?, from.get_all()?);
        let count = rows.len() / stride;
        let fits = |len: usize| len == 0 || len == count;
        let fits_rows = rows.len().is_multiple_of(stride) && sampled <= count;
        let is_below = |i: &u32| (*i as usize) < sampled;
        let fits_withheld = withheld.is_sorted_by(|a, b| a < b) && withheld.iter().all(is_below);
        let fits_shares = shares.is_empty() || shares.len() == sampled;
        if !fits_rows
            || !fits_withheld
            || !fits_shares
            || turns.len() != radii.len()
            || !fits(turns.len())
        {
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
        let pending = PendingCell {
            cell,
            moments,
            offered,
            sampled,
            withheld,
            apart: Vec::new(),
            least_radius,
            turns,
            radii,
            shares,
            below,
        };
        Some(Self { pending, rows })
    }
}

/// Adds nodes whose pages have their places, and all nodes below them, to a record.
fn put_nodes(nodes: &[Subtree], record: &mut Record) {
    // Children before parents, in their order. Without recursion, since chains can be long.
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
