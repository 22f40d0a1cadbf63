//! Finishes the nodes below a cell: each separately, in any order and on any thread; then they are
//! joined to subtrees.

use crate::page::histograms::Counts;
use crate::rows::row::Rows;
use crate::sample::cell::Context;
use crate::sample::pending::{Below, PendingCell, ReadyCell};
use crate::tree::subtree::{Children, Subtree};
use esker_points::Task;
use std::sync::{Mutex, PoisonError};

/// Unfinished cells below a cell: parents before children, and the children
/// of a cell in Morton order.
pub struct Unfinished {
    cells: Vec<UnfinishedCell>,
    /// Points that are in none of the cells.
    other_points: u64,
}

/// An unfinished cell, which becomes a node.
struct UnfinishedCell {
    /// Index of the parent; `None` for children of the cell itself.
    parent: Option<usize>,
    /// Points that are in no cell below.
    points: u64,
    /// Index of the sampled cell whose result has the nodes below, if they are finished elsewhere.
    elsewhere: Option<usize>,
    state: Mutex<State>,
}

enum State {
    Ready(Box<ReadyCell>),
    Finished(Option<Box<Subtree>>),
}

impl Unfinished {
    /// Takes the unfinished cells below a cell.
    pub fn below(pending: &mut PendingCell) -> Self {
        let mut cells: Vec<UnfinishedCell> = Vec::new();
        let mut other_points = pending.moments.count;
        let mut open: Vec<(Option<usize>, Vec<ReadyCell>)> =
            vec![(None, pending.below.take_ready())];
        while let Some((parent, cuts)) = open.pop() {
            for mut cut in cuts {
                let points = cut.pending.moments.count;
                match parent {
                    Some(parent) => cells[parent].points -= points,
                    None => other_points -= points,
                }
                let elsewhere = match cut.pending.below {
                    Below::Elsewhere { of, .. } => Some(of),
                    _ => None,
                };
                open.push((Some(cells.len()), cut.pending.below.take_ready()));
                let state = Mutex::new(State::Ready(Box::new(cut)));
                cells.push(UnfinishedCell { parent, points, elsewhere, state });
            }
        }
        Self { cells, other_points }
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// Points that are in none of the cells.
    pub fn other_points(&self) -> u64 {
        self.other_points
    }

    /// Finishes the node of cell `index`. Does nothing after a cancellation.
    pub fn finish(
        &self,
        index: usize,
        context: &Context,
        rows: &Rows<'_>,
        counts: &Counts,
        task: &dyn Task,
    ) {
        if task.is_cancelled() {
            return;
        }
        let UnfinishedCell { points, state, .. } = &self.cells[index];
        let mut state = state.lock().unwrap_or_else(PoisonError::into_inner);
        if let State::Ready(cut) = std::mem::replace(&mut *state, State::Finished(None)) {
            let ReadyCell { pending, taken, above } = *cut;
            let tree = context.finish(rows, pending, &taken, Some(above), counts);
            *state = State::Finished(tree.map(Box::new));
        }
        task.advance(*points);
    }

    /// The finished nodes right below the cell, with all below them; and for each the index of the
    /// sampled cell whose result has the nodes below it, if they are finished elsewhere. `None` if
    /// finishing a node has panicked.
    pub fn into_children(self) -> Option<(Children, Vec<Option<usize>>)> {
        let mut below: Vec<Vec<Subtree>> = self.cells.iter().map(|_| Vec::new()).collect();
        let (mut top, mut top_elsewhere) = (Vec::new(), Vec::new());
        for (i, cell) in self.cells.into_iter().enumerate().rev() {
            let UnfinishedCell { parent, elsewhere, state, .. } = cell;
            let mut children = std::mem::take(&mut below[i]);
            children.reverse();
            let state = state.into_inner().ok()?;
            if let State::Finished(Some(mut tree)) = state {
                tree.last_mut().children.extend(children);
                if parent.is_none() {
                    top_elsewhere.push(elsewhere);
                }
                parent.map_or(&mut top, |parent| &mut below[parent]).push(*tree);
            }
        }
        top.reverse();
        top_elsewhere.reverse();
        Some((top.into(), top_elsewhere))
    }
}
