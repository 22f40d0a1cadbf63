//! The tree, bottom-up: a cell with no more points than a node holds offers them all; a larger one offers
//! an even sample of what its children offer, and what it takes, they lose. A node is finished, and its
//! page made, when the cell above has taken its share.

use crate::contour;
use crate::ntree::NTree;
use crate::order::{order, radii};
use crate::row::{RowLayout, Rows};
use crate::sample::choose;
use crate::shape::{Moments, Shape};
use crate::turn::LAST_TURN;
use bytemuck::Zeroable;
use esker_format::{Histograms, NodeStatistics, PageLayout, encode_page};
use esker_points::node::SHAPE_CONTINUATION;
use esker_points::{Cell, MultisetHash, Node, quant};
use rayon::prelude::*;
use std::sync::Mutex;

/// A radius is at most so many times its node's spacing: a lone point must not become a blob.
const RADIUS_SPACINGS_MAX: f32 = 8.0;

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

impl Pending {
    /// A turn for each point offered.
    fn all_turns(&self) -> impl Iterator<Item = u16> + '_ {
        let placed = self.turns.iter().copied();
        placed.chain(std::iter::repeat(LAST_TURN)).take(self.offered.len())
    }
}

impl Context {
    /// A cell that fits a node.
    pub fn leaf(&self, rows: &Rows<'_>, points: std::ops::Range<u32>, cell: Cell) -> Pending {
        let mut moments = Moments::default();
        points.clone().for_each(|i| moments.add(rows.position(i)));
        Pending {
            cell,
            moments,
            offered: points.collect(),
            turns: Vec::new(),
            children: Children::default(),
        }
    }

    /// More coincident points than a node holds: the first offers itself, the rest continues it.
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
        let candidates: Vec<u32> =
            children.iter().flat_map(|c| c.offered.iter().copied()).collect();
        let shape = Shape::of(moments.covariance(self.scale));
        let turns: Vec<u16> = children.iter().flat_map(Pending::all_turns).collect();
        let tree = NTree::new(rows, &candidates, &turns, &cell, &shape, self.scale);
        let sample = choose(&tree, self.capacity);
        let mut chosen: Vec<(u32, u16)> = tree
            .entries
            .iter()
            .zip(&sample.chosen)
            .filter_map(|(entry, turn)| Some((entry.row, (*turn)?)))
            .collect();
        chosen.sort_unstable();
        drop(tree);
        for child in &children {
            // A node keeps a point of its own, or it could not stand between the one above and those below.
            let gone = |row: &u32| chosen.binary_search_by_key(row, |c| c.0).is_ok();
            if !child.children.is_empty() && child.offered.iter().all(gone) {
                chosen.retain(|(row, _)| *row != child.offered[0]);
            }
        }
        let (offered, turns): (Vec<u32>, Vec<u16>) = chosen.into_iter().unzip();
        let children = children
            .into_par_iter()
            .filter_map(|child| self.finish(rows, child, &offered, Some(sample.spacing)))
            .collect();
        let children = Children(children);
        Pending { cell, moments, offered, turns, children }
    }

    /// Finishes a cell of whose offer `taken` (rows, ascending; others may be among them) have gone to the
    /// cell above, whose sample has the spacing `above`. `None` where nothing is left of it, which only
    /// happens to cells without children (see [`Context::combine`]).
    pub fn finish(
        &self,
        rows: &Rows<'_>,
        pending: Pending,
        taken: &[u32],
        above: Option<f64>,
    ) -> Option<Subtree> {
        let shape = Shape::of(pending.moments.covariance(self.scale));
        let tree =
            NTree::new(rows, &pending.offered, &pending.turns, &pending.cell, &shape, self.scale);
        let gone: Vec<bool> =
            tree.entries.iter().map(|e| taken.binary_search(&e.row).is_ok()).collect();
        let order = order(&tree, &gone, above);
        if order.entries.is_empty() {
            return None;
        }
        let spacing = self.spacing(&tree, above);
        let radii = radii(&tree);
        let cap = spacing as f32 * RADIUS_SPACINGS_MAX;
        let radius = |i: u32| match radii[i as usize] {
            0.0 => spacing as f32,
            r => r.min(cap),
        };
        let codes = order
            .entries
            .iter()
            .map(|&i| quant::radius_code(f64::from(radius(i)), spacing))
            .collect();
        let own: Vec<u32> = order.entries.iter().map(|&i| tree.entries[i as usize].row).collect();
        drop(tree);

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
        Some(Subtree { node, page, statistics, hash, bounds, children: pending.children })
    }

    /// The spacing of a node: never more than that of the sample above, never zero.
    fn spacing(&self, tree: &NTree, above: Option<f64>) -> f64 {
        let step = self.scale.iter().fold(f64::INFINITY, |a, &b| a.min(b));
        let own = tree.spacing(&tree.occupied(), tree.entries.len());
        let few = tree.entries.len() < 8;
        let spacing = match above {
            Some(above) if few || own > above => above,
            _ => own,
        };
        // Half the largest f32 keeps a multiple of it finite.
        spacing.clamp(step.max(1e-30), 1e30)
    }
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
