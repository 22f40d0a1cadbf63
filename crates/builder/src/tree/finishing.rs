//! The nodes below a cell: each is finished by itself, in any order and on any thread, then they
//! are put together.

use crate::page::histograms::Counts;
use crate::rows::row::Rows;
use crate::sample::cell::Context;
use crate::sample::pending::{Below, PendingCell, ReadyCell};
use crate::tree::subtree::{Children, Subtree};
use esker_points::Task;
use std::sync::{Mutex, PoisonError};

/// What is below a cell and not finished: cells before those in them, and those of one cell in
/// Morton order.
pub struct Unfinished {
    cells: Vec<Unit>,
    /// Points that are in none of them.
    others: u64,
}

/// A cell, then its node.
struct Unit {
    /// The one that it is a child of; none where that is the cell above all.
    parent: Option<usize>,
    /// Points that are in none of those below.
    points: u64,
    /// Of nodes that are finished elsewhere, where those below it are.
    elsewhere: Option<usize>,
    state: Mutex<State>,
}

enum State {
    Ready(Box<ReadyCell>),
    Finished(Option<Box<Subtree>>),
}

impl Unfinished {
    /// What is below a cell.
    pub fn below(pending: &mut PendingCell) -> Self {
        let mut cells: Vec<Unit> = Vec::new();
        let mut others = pending.moments.count;
        let mut open: Vec<(Option<usize>, Vec<ReadyCell>)> =
            vec![(None, pending.below.take_ready())];
        while let Some((parent, cuts)) = open.pop() {
            for mut cut in cuts {
                let points = cut.pending.moments.count;
                match parent {
                    Some(parent) => cells[parent].points -= points,
                    None => others -= points,
                }
                let elsewhere = match cut.pending.below {
                    Below::Elsewhere { of, .. } => Some(of),
                    _ => None,
                };
                open.push((Some(cells.len()), cut.pending.below.take_ready()));
                let state = Mutex::new(State::Ready(Box::new(cut)));
                cells.push(Unit { parent, points, elsewhere, state });
            }
        }
        Self { cells, others }
    }

    /// How many cells.
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// Points that are in none of them.
    pub fn others(&self) -> u64 {
        self.others
    }

    /// Finishes a cell's own node. Void where the task was cancelled.
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
        let Unit { points, state, .. } = &self.cells[index];
        let mut state = state.lock().unwrap_or_else(PoisonError::into_inner);
        if let State::Ready(cut) = std::mem::replace(&mut *state, State::Finished(None)) {
            let ReadyCell { pending, taken, above } = *cut;
            let tree = context.finish(rows, pending, &taken, Some(above), counts);
            *state = State::Finished(tree.map(Box::new));
        }
        task.advance(*points);
    }

    /// The nodes right below the cell, with those below them, where all are finished, and of each
    /// where the nodes below it are that are finished elsewhere; `None` where one has panicked.
    pub fn into_children(self) -> Option<(Children, Vec<Option<usize>>)> {
        let mut below: Vec<Vec<Subtree>> = self.cells.iter().map(|_| Vec::new()).collect();
        let (mut top, mut top_elsewhere) = (Vec::new(), Vec::new());
        for (i, Unit { parent, elsewhere, state, .. }) in self.cells.into_iter().enumerate().rev() {
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
