//! Cells between sampling and finishing: those whose points the cell above has not chosen from yet,
//! and those from which it has.

use crate::sample::shape::Moments;
use crate::sample::spacing::TurnCounts;
use crate::sample::turns::LAST_TURN;
use crate::tree::subtree::Children;
use esker_points::Cell;
use std::ops::Range;

/// A cell whose points the cell above has not chosen from yet.
pub struct PendingCell {
    /// Smallest cell that holds its points.
    pub cell: Cell,
    /// Moments of all points in the cell.
    pub moments: Moments,
    /// Rows: first those that the cell offers, ascending (which is along the Morton curve), then
    /// those that small leaves below have given to it.
    pub offered: Vec<u32>,
    /// Number of rows that it offers, and of those that it withholds.
    pub sampled: usize,
    /// Indices of rows that a leaf of uneven density keeps for its own nodes, ascending; empty for
    /// all others.
    pub withheld: Vec<u32>,
    /// Indices of rows that the cell above has left because they would be drawn too narrow there,
    /// and their radii, in the file's unit.
    pub apart: Vec<(u32, f32)>,
    /// Least radius, in the file's unit, at which its points were picked, if its sparse parts
    /// bound that; else 0 ([`crate::sample::sparse`]).
    pub least_radius: f64,
    /// Turn of each of these rows; empty for a leaf, which has not been thinned yet.
    pub turns: Vec<u16>,
    /// Local spacing at each point, in the file's unit, one for each turn; 0 stands for the spacing
    /// of the node.
    pub radii: Vec<f32>,
    /// For each point that it offers, the largest radius wherever the point is drawn, as a share of
    /// the spacing there ([`crate::sample::fringe`]); empty if all are 1.
    pub shares: Vec<f32>,
    /// What is below the cell.
    pub below: Below,
}

/// What is below a cell.
pub enum Below {
    /// Finished nodes, or nothing.
    Finished(Children),
    /// Cells from which this one has chosen.
    Ready(Vec<ReadyCell>),
    /// Rows that coincide with those that the cell offers.
    Coincident(Range<u32>),
    /// Nodes that are finished elsewhere: `of` is the index among the cells that are sampled
    /// together, `is_any` whether there are such nodes.
    Elsewhere { of: usize, is_any: bool },
}

/// A cell from which the cell above has chosen, ready to be finished.
pub struct ReadyCell {
    /// The cell.
    pub pending: PendingCell,
    /// Turns of the offered points that the cell above took; [`LAST_TURN`] for the rest.
    pub taken: Vec<u16>,
    /// Spacing of the sample above.
    pub above: f64,
}

impl PendingCell {
    /// Rows that the cell offers.
    pub fn offers(&self) -> impl Iterator<Item = u32> {
        let mut withheld = self.withheld.iter().copied().peekable();
        let mut is_kept = move |i: u32| withheld.next_if_eq(&i).is_some();
        let offered = (0..).zip(&self.offered[..self.sampled]);
        offered.filter(move |(i, _)| !is_kept(*i)).map(|(_, row)| *row)
    }

    /// Number of rows that the cell offers.
    pub fn offer_count(&self) -> usize {
        self.sampled - self.withheld.len()
    }

    /// Turns of all its rows from those of the rows that it offers.
    pub fn taken(&self, turns: &[u16]) -> Vec<u16> {
        let mut taken = turns.to_vec();
        self.withheld.iter().for_each(|&i| taken.insert(i as usize, LAST_TURN));
        taken
    }

    /// Counts the offered points that were picked at each turn.
    pub fn turn_counts(&self) -> TurnCounts {
        TurnCounts::of(&self.turns[..self.sampled])
    }

    /// Bounds the radii of offered points by their shares of `spacing`.
    pub fn narrow(&mut self, spacing: f64) {
        for (radius, share) in self.radii.iter_mut().zip(&self.shares).filter(|(_, s)| **s < 1.0) {
            let widest = share * spacing as f32;
            *radius = if *radius > 0.0 { radius.min(widest) } else { widest };
        }
    }

    /// Whether the cell has, or will have, nodes below.
    pub fn has_below(&self) -> bool {
        match &self.below {
            Below::Finished(children) => !children.is_empty(),
            Below::Ready(cells) => cells.iter().any(ReadyCell::is_left),
            Below::Coincident(rows) => !rows.is_empty(),
            Below::Elsewhere { is_any, .. } => *is_any,
        }
    }

    /// Whether the cell was not split. Only such a cell has neither turns yet nor nodes below.
    pub fn is_leaf(&self) -> bool {
        self.turns.is_empty() && !self.has_below()
    }

    /// Joins the turns of the points that `children` offer, `offered` in total; empty if no child
    /// has turns.
    pub fn turns_below(children: &[Self], offered: usize) -> Vec<u16> {
        if children.iter().all(|c| c.turns.is_empty()) {
            return Vec::new();
        }
        let mut turns = Vec::with_capacity(offered);
        for child in children {
            let known = &child.turns[..child.turns.len().min(child.sampled)];
            turns.extend_from_slice(known);
            turns.resize(turns.len() + child.offer_count() - known.len(), LAST_TURN);
        }
        turns
    }
}

impl PendingCell {
    /// Joins the shares of the points that `children` offer, `offered` in total; empty if all are
    /// 1.
    pub fn shares(children: &[Self], offered: usize) -> Vec<f32> {
        if children.iter().all(|c| c.shares.is_empty()) {
            return Vec::new();
        }
        let mut shares = Vec::with_capacity(offered);
        for child in children {
            shares.extend_from_slice(&child.shares);
            shares.resize(shares.len() + child.offer_count() - child.shares.len(), 1.0);
        }
        shares
    }
}

impl ReadyCell {
    /// Whether points are left for a node of the cell.
    fn is_left(&self) -> bool {
        let is_own = |turn: &u16| *turn == LAST_TURN;
        self.pending.offered.len() > self.taken.len() || self.taken.iter().any(is_own)
    }
}

impl Below {
    /// Takes the finished nodes; empty if the cell waits for others.
    pub fn take(&mut self) -> Children {
        match std::mem::take(self) {
            Self::Finished(children) => children,
            Self::Ready(_) | Self::Coincident(_) | Self::Elsewhere { .. } => Children::default(),
        }
    }

    /// Takes the finished nodes and notes that they are elsewhere from now on.
    pub fn put_elsewhere(&mut self) -> Children {
        let children = self.take();
        *self = Self::Elsewhere { of: 0, is_any: !children.is_empty() };
        children
    }

    /// Takes the cells that are ready to be finished.
    pub fn take_ready(&mut self) -> Vec<ReadyCell> {
        match self {
            Self::Ready(cells) => std::mem::take(cells),
            _ => Vec::new(),
        }
    }
}

impl Default for Below {
    fn default() -> Self {
        Self::Finished(Children::default())
    }
}
