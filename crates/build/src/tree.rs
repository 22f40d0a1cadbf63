//! The tree, bottom-up: a cell with no more points than a node holds offers them all; a larger one offers
//! an even sample of what its children offer, and what it takes, they lose. A node is finished, and its
//! page made, when the cell above has taken its share.

use crate::candidates::Candidates;
use crate::contour;
use crate::order::{order, parts};
use crate::row::{RowLayout, Rows};
use crate::sample::{choose, place};
use crate::shape::{Moments, Shape};
use crate::spacing::{radii, spacing};
use crate::turn::LAST_TURN;
use bytemuck::Zeroable;
use esker_format::{Histograms, NodeStatistics, PageLayout, Ranges, encode_page};
use esker_points::node::SHAPE_CONTINUATION;
use esker_points::{Cell, MultisetHash, Node, NodeTable, quant};
use rayon::prelude::*;
use std::sync::Mutex;

/// A radius is at most so many times its node's spacing: a lone point must not become a blob.
const RADIUS_SPACINGS_MAX: f64 = 8.0;
/// A cell is not split before it has so many nodes' points.
const LEAF_NODES: usize = 2;

/// What every step of the building knows.
pub struct Context {
    /// Rows.
    pub rows: RowLayout,
    /// Pages.
    pub pages: PageLayout,
    /// Length of a step, an axis.
    pub scale: [f64; 3],
    /// Points a node holds.
    pub capacity: usize,
    /// One for each thread of the pool, so that none waits.
    pub histograms: Vec<Mutex<Histograms>>,
}

/// A cell whose points the cell above has not yet chosen from.
pub struct Pending {
    /// The smallest cell that holds its points.
    pub cell: Cell,
    /// Of all points in the cell.
    pub moments: Moments,
    /// What it offers: rows, ascending (which is along the Morton curve).
    pub offered: Vec<u32>,
    /// The turn of each of these in thinning; empty where no sample has placed them.
    pub turns: Vec<u16>,
    /// Their local spacing, in the file's unit; as many as turns. 0 where the cell's is to be taken.
    pub radii: Vec<f32>,
    /// What lies below.
    pub children: Children,
}

/// A finished node and all below it.
pub struct Subtree {
    /// Its record; links and the page's place are set when the table is assembled.
    pub node: Node,
    /// Its page, until it is written.
    pub page: Vec<u8>,
    /// Of its own points.
    pub statistics: NodeStatistics,
    /// Hash of its own points.
    pub hash: MultisetHash,
    /// Least and greatest lattice coordinates of its own points.
    pub bounds: [[u32; 3]; 2],
    /// Its children, in Morton order.
    pub children: Children,
}

/// Children, which are dropped one after the other: a chain of continuations is longer than a stack.
#[derive(Default)]
pub struct Children(Vec<Subtree>);

impl Children {
    /// The children themselves.
    pub fn take(&mut self) -> Vec<Subtree> {
        std::mem::take(&mut self.0)
    }
}

impl std::ops::Deref for Children {
    type Target = Vec<Subtree>;
    fn deref(&self) -> &Vec<Subtree> {
        &self.0
    }
}

impl std::ops::DerefMut for Children {
    fn deref_mut(&mut self) -> &mut Vec<Subtree> {
        &mut self.0
    }
}

impl FromIterator<Subtree> for Children {
    fn from_iter<I: IntoIterator<Item = Subtree>>(trees: I) -> Self {
        Self(trees.into_iter().collect())
    }
}

impl Drop for Children {
    fn drop(&mut self) {
        let mut open = self.take();
        while let Some(mut tree) = open.pop() {
            open.append(&mut tree.children);
        }
    }
}

impl Context {
    /// What all nodes so far have counted.
    pub fn counted(&self) -> Histograms {
        let mut sum: Option<Histograms> = None;
        for part in &self.histograms {
            let part = part.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            match &mut sum {
                Some(sum) => sum.merge(&part),
                None => sum = Some(part.clone()),
            }
        }
        sum.unwrap_or_else(|| Histograms::new(Ranges::from_pairs(Vec::new())))
    }

    /// Adds what nodes have counted that are not made anew; whether it is of as many attributes and bins.
    pub fn count(&self, counts: &[Vec<u64>]) -> bool {
        let Some(Ok(mut part)) = self.histograms.first().map(Mutex::lock) else { return false };
        counts.iter().enumerate().all(|(a, counts)| {
            let counts = counts.as_slice().try_into();
            counts.map(|counts| part.add_counts(a, counts)).is_ok()
        })
    }

    /// A cell that is not split: it offers all of its points.
    pub fn leaf(&self, rows: &Rows<'_>, points: std::ops::Range<u32>, cell: Cell) -> Pending {
        Pending {
            cell,
            moments: Moments::of(points.clone().map(|i| rows.position(i)), &cell),
            offered: points.collect(),
            turns: Vec::new(),
            radii: Vec::new(),
            children: Children::default(),
        }
    }

    /// Points that a cell may have without being split. What the cells above leave of them may be more than a node
    /// holds: then nodes continue it.
    pub fn leaf_points_max(&self) -> usize {
        self.capacity * LEAF_NODES
    }

    /// More coincident points than a leaf may have: the first offers itself, the rest continues it.
    pub fn coincident(&self, rows: &Rows<'_>, points: std::ops::Range<u32>, cell: Cell) -> Pending {
        let mut head = self.leaf(rows, points.start..points.start + self.capacity as u32, cell);
        let rest = (points.start + self.capacity as u32..points.end).step_by(self.capacity);
        for first in rest.rev() {
            let last = points.end.min(first + self.capacity as u32);
            let pending = self.leaf(rows, first..last, cell);
            if let Some((moments, mut node)) = self.continuation(rows, pending) {
                head.moments.merge(&moments);
                node.children = std::mem::take(&mut head.children);
                head.children.push(node);
            }
        }
        head
    }

    /// A node that continues the one above it in the same cell, and the moments of its points.
    pub fn continuation(&self, rows: &Rows<'_>, pending: Pending) -> Option<(Moments, Subtree)> {
        let moments = pending.moments;
        let mut node = self.finish(rows, pending, &[], None)?;
        node.node.shape |= SHAPE_CONTINUATION;
        Some((moments, node))
    }

    /// A cell made of the cells in it: takes an even sample of what they offer and finishes them.
    pub fn combine(&self, rows: &Rows<'_>, cell: Cell, children: Vec<Pending>) -> Pending {
        let mut moments = Moments::default();
        children.iter().for_each(|c| moments.merge(&c.moments));
        let offered: Vec<u32> = children.iter().flat_map(|c| c.offered.iter().copied()).collect();
        let dimension = Shape::of(moments.covariance(self.scale)).dimension;
        let candidates = Candidates::new(rows, &offered, &cell, self.scale);
        let placed = placed(&children, offered.len());
        let mut turns = choose(&candidates, &placed, self.capacity, self.edge(&cell), dimension);
        let mut parts = Vec::with_capacity(children.len());
        let mut start = 0;
        for child in children {
            let part = start..start + child.offered.len();
            start = part.end;
            // A node keeps a point of its own, or it could not stand between the one above and those below.
            if !child.children.is_empty() && turns[part.clone()].iter().all(|t| *t != LAST_TURN) {
                turns[part.start] = LAST_TURN;
            }
            parts.push((child, part));
        }
        let chosen: Vec<usize> = (0..offered.len()).filter(|&i| turns[i] != LAST_TURN).collect();
        let radii = self.radii(&candidates, |i| turns[i] != LAST_TURN, dimension);
        drop(candidates);
        let mut pending = Pending {
            cell,
            moments,
            offered: chosen.iter().map(|&i| offered[i]).collect(),
            turns: chosen.iter().map(|&i| turns[i]).collect(),
            radii: chosen.iter().map(|&i| radii[i]).collect(),
            children: Children::default(),
        };
        let above = self.spacing(&pending, chosen.len(), dimension, None);
        let finish = |(child, part)| self.finish(rows, child, &turns[part], Some(above));
        pending.children = Children(parts.into_par_iter().filter_map(finish).collect());
        pending
    }

    /// Finishes a cell of whose offer the cell above, whose sample has the spacing `above`, has taken those points that
    /// have a turn in `taken`. What a node does not hold continues it. `None` where nothing is left, which only happens
    /// to cells without children (see [`Context::combine`]).
    pub fn finish(
        &self,
        rows: &Rows<'_>,
        mut pending: Pending,
        taken: &[u16],
        above: Option<f64>,
    ) -> Option<Subtree> {
        let shape = Shape::of(pending.moments.covariance(self.scale));
        if pending.turns.is_empty() {
            let cell = &pending.cell;
            let candidates = Candidates::new(rows, &pending.offered, cell, self.scale);
            let edge = self.edge(cell);
            pending.turns = place(&candidates, taken, above, edge, shape.dimension);
            pending.radii = self.radii(&candidates, |_| true, shape.dimension);
        }
        let is_own = |i: &u32| taken.get(*i as usize).is_none_or(|&turn| turn == LAST_TURN);
        let own: Vec<u32> = (0..pending.offered.len() as u32).filter(is_own).collect();
        let turns: Vec<u16> = own.iter().map(|&i| pending.turns[i as usize]).collect();
        let count = own.len().div_ceil(self.capacity) as u32;
        let part_of = parts(&turns, count as usize);
        let mut drawn = pending.offered.len();
        let full = self.spacing(&pending, drawn, shape.dimension, above);
        let mut below = std::mem::take(&mut pending.children);
        for part in (0..count).rev() {
            let of_part = own.iter().zip(&part_of).filter(|(_, p)| **p == part);
            let points: Vec<u32> = of_part.map(|(i, _)| *i).collect();
            let spacing = self.spacing(&pending, drawn, shape.dimension, above);
            drawn -= points.len();
            let mut tree = self.node(rows, &pending, &points, &shape, [spacing, full], below);
            if part == 0 {
                return Some(tree);
            }
            tree.node.shape |= SHAPE_CONTINUATION;
            below = Children(vec![tree]);
        }
        None
    }

    /// The radii of the offered points that are wanted, in the file's unit; 0 for the others.
    fn radii(
        &self,
        candidates: &Candidates,
        is_wanted: impl Fn(usize) -> bool,
        dimension: u32,
    ) -> Vec<f32> {
        let wanted =
            || candidates.offer.iter().zip(&candidates.q).filter(|(o, _)| is_wanted(**o as usize));
        let mut out = vec![0.0; candidates.len()];
        let steps = radii(wanted().map(|(_, q)| *q), dimension);
        for ((&offer, _), steps) in wanted().zip(steps) {
            out[offer as usize] = (f64::from(steps) * candidates.step) as f32;
        }
        out
    }

    /// A node of some of a cell's points, which are drawn with this spacing and, once all of the cell's are, with
    /// the second.
    fn node(
        &self,
        rows: &Rows<'_>,
        pending: &Pending,
        points: &[u32],
        shape: &Shape,
        [spacing, full]: [f64; 2],
        children: Children,
    ) -> Subtree {
        let turns: Vec<u16> = points.iter().map(|&i| pending.turns[i as usize]).collect();
        let order = order(&turns);
        let ordered = || order.points.iter().map(|&i| points[i as usize] as usize);
        let radius = |i: usize| match pending.radii[i] {
            0.0 => 1.0,
            r => (f64::from(r) / full).min(RADIUS_SPACINGS_MAX),
        };
        let codes = ordered().map(|i| quant::radius_code(radius(i) * spacing, spacing)).collect();
        let own: Vec<u32> = ordered().map(|i| pending.offered[i]).collect();

        let (points, hash) = self.page_points(rows, &own, codes);
        let mut node = Node::zeroed();
        (node.corner, node.cell_log2) = (pending.cell.corner, pending.cell.log2);
        node.shape = shape.dimension as u8;
        node.spacing = spacing as f32;
        node.set_levels(&order.levels);
        let bounds = set_box(&mut node, &points.positions);
        let step =
            self.scale.iter().fold(0.0f64, |a, &b| a.max(b)) * f64::from(1u32 << node.hot_shift);
        contour::enclose(&mut node, &points.positions, self.scale, step);

        let page = encode_page(&self.pages, node.box_min, node.hot_shift, &points);
        let statistics = NodeStatistics::of(&self.pages, &points);
        let slot = rayon::current_thread_index().unwrap_or(0) % self.histograms.len();
        if let Ok(mut histograms) = self.histograms[slot].lock() {
            histograms.add(&self.pages, &points);
        }
        Subtree { node, page, statistics, hash, bounds, children }
    }

    /// The spacing of the first `drawn` of a cell's points: never more than that of the sample above, never zero.
    fn spacing(&self, pending: &Pending, drawn: usize, dimension: u32, above: Option<f64>) -> f64 {
        let step = self.scale.iter().fold(f64::INFINITY, |a, &b| a.min(b));
        let own = spacing(&pending.turns, drawn, pending.moments.count as usize, dimension);
        let few = pending.offered.len() < 8;
        let spacing = match above {
            Some(above) if few || own > above => above,
            _ => own,
        };
        // Half the largest f32 keeps a multiple of it finite.
        spacing.clamp(step.max(1e-30), 1e30)
    }

    /// The edge of a cell, in the file's unit, along the axis of the longest steps.
    fn edge(&self, cell: &Cell) -> f64 {
        self.scale.iter().fold(0.0f64, |a, &b| a.max(b)) * cell.edge() as f64
    }
}

/// The turns that cells below have given to what they offer, in all so many; empty where none has.
fn placed(children: &[Pending], offered: usize) -> Vec<u16> {
    if children.iter().all(|c| c.turns.is_empty()) {
        return Vec::new();
    }
    let mut turns = Vec::with_capacity(offered);
    for child in children {
        turns.extend_from_slice(&child.turns);
        turns.resize(turns.len() + child.offered.len() - child.turns.len(), LAST_TURN);
    }
    turns
}

/// Sets the integer box of a node's own points, and returns it; there is at least one.
fn set_box(node: &mut Node, positions: &[[u32; 3]]) -> [[u32; 3]; 2] {
    let (mut min, mut max) = ([u32::MAX; 3], [0; 3]);
    for p in positions {
        for i in 0..3 {
            min[i] = min[i].min(p[i]);
            max[i] = max[i].max(p[i]);
        }
    }
    node.box_min = min;
    let extent = (0..3).map(|i| max[i] - min[i]).max().unwrap_or(0);
    node.hot_shift = quant::hot_shift(extent);
    [min, max]
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
