//! Cells whose points the cell above has not yet chosen from, and those from which it has, but which are not finished.

use crate::sample::shape::Moments;
use crate::sample::spacing::TurnCounts;
use crate::sample::turns::LAST_TURN;
use crate::tree::subtree::Children;
use esker_points::Cell;
use std::ops::Range;

/// A cell whose points the cell above has not yet chosen from.
pub struct PendingCell {
    /// The smallest cell that holds its points.
    pub cell: Cell,
    /// Of all points in the cell.
    pub moments: Moments,
    /// What it offers: rows, ascending (which is along the Morton curve); then those that it does not offer, but
    /// has been given by cells below that had few left.
    pub offered: Vec<u32>,
    /// How many it offers.
    pub sampled: usize,
    /// The turn of each of these rows in thinning; empty where no sample has turns_below them.
    pub turns: Vec<u16>,
    /// Their local spacing, in the file's unit; as many as turns. 0 where the cell's is to be taken.
    pub radii: Vec<f32>,
    /// For each point that it offers, the share of the spacing around that its radius has at most, wherever it
    /// is drawn ([`crate::sample::fringe`]); empty where that is 1.
    pub shares: Vec<f32>,
    /// What lies below.
    pub below: Below,
}

/// What lies below a cell.
pub enum Below {
    /// Finished nodes, or nothing.
    Finished(Children),
    /// Cells that have lost what this one took.
    Ready(Vec<ReadyCell>),
    /// Rows that coincide with those that the cell offers.
    Coincident(Range<u32>),
    /// Nodes that are finished elsewhere: of which of the cells that are chosen from together, and whether there are any.
    Elsewhere { of: usize, is_any: bool },
}

/// A cell that can be finished.
pub struct ReadyCell {
    /// The cell.
    pub pending: PendingCell,
    /// The turns of what the cell above took of its offer; [`LAST_TURN`] for the rest.
    pub taken: Vec<u16>,
    /// The spacing of the sample above.
    pub above: f64,
}

impl PendingCell {
    /// How many of the points that it offers were picked at each turn.
    pub fn turn_counts(&self) -> TurnCounts {
        TurnCounts::of(&self.turns[..self.sampled])
    }

    /// What it offers, with this spacing, gets no more than its share of that for a radius.
    pub fn narrow(&mut self, spacing: f64) {
        for (radius, share) in self.radii.iter_mut().zip(&self.shares).filter(|(_, s)| **s < 1.0) {
            let widest = share * spacing as f32;
            *radius = if *radius > 0.0 { radius.min(widest) } else { widest };
        }
    }

    /// Whether there are, or will be, nodes below.
    pub fn has_below(&self) -> bool {
        match &self.below {
            Below::Finished(children) => !children.is_empty(),
            Below::Ready(cells) => cells.iter().any(ReadyCell::is_left),
            Below::Coincident(rows) => !rows.is_empty(),
            Below::Elsewhere { is_any, .. } => *is_any,
        }
    }

    /// Whether the cell was not split: only then it has neither turns yet nor nodes below.
    pub fn is_leaf(&self) -> bool {
        self.turns.is_empty() && !self.has_below()
    }

    /// The turns that cells below have given to what they offer, in all so many; empty where none has.
    pub fn turns_below(children: &[Self], offered: usize) -> Vec<u16> {
        if children.iter().all(|c| c.turns.is_empty()) {
            return Vec::new();
        }
        let mut turns = Vec::with_capacity(offered);
        for child in children {
            let known = &child.turns[..child.turns.len().min(child.sampled)];
            turns.extend_from_slice(known);
            turns.resize(turns.len() + child.sampled - known.len(), LAST_TURN);
        }
        turns
    }
}

impl PendingCell {
    /// The shares of what cells offer, in all so many; empty where all are 1.
    pub fn shares(children: &[Self], offered: usize) -> Vec<f32> {
        if children.iter().all(|c| c.shares.is_empty()) {
            return Vec::new();
        }
        let mut shares = Vec::with_capacity(offered);
        for child in children {
            shares.extend_from_slice(&child.shares);
            shares.resize(shares.len() + child.sampled - child.shares.len(), 1.0);
        }
        shares
    }
}

impl ReadyCell {
    /// Whether a node of it will be.
    fn is_left(&self) -> bool {
        let is_own = |turn: &u16| *turn == LAST_TURN;
        self.pending.offered.len() > self.taken.len() || self.taken.iter().any(is_own)
    }
}

impl Below {
    /// The finished nodes; none where others wait to be.
    pub fn take(&mut self) -> Children {
        match std::mem::take(self) {
            Self::Finished(children) => children,
            Self::Ready(_) | Self::Coincident(_) | Self::Elsewhere { .. } => Children::default(),
        }
    }

    /// The finished nodes, which from now on are elsewhere.
    pub fn put_elsewhere(&mut self) -> Children {
        let children = self.take();
        *self = Self::Elsewhere { of: 0, is_any: !children.is_empty() };
        children
    }

    /// Cells that are not finished.
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
