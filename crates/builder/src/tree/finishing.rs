//! Finishes the nodes below a cell: each separately, in any order and on any thread; then they are
//! joined to subtrees, and their pages get the order of the file. That order is a property of the
//! tree: the nodes of the children of a cell stand together, behind all nodes below them. So it
//! does not depend on how the points were cut into chunks.

use crate::page::histograms::Counts;
use crate::rows::row::Rows;
use crate::sample::cell::Context;
use crate::sample::pending::{Below, PendingCell, ReadyCell};
use crate::tree::pages::Pages;
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
    /// Whether its node is continued by a chain of coincident points.
    is_coincident: bool,
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
                let is_coincident = matches!(cut.pending.below, Below::Coincident(_));
                open.push((Some(cells.len()), cut.pending.below.take_ready()));
                let state = Mutex::new(State::Ready(Box::new(cut)));
                cells.push(UnfinishedCell { parent, points, elsewhere, is_coincident, state });
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
    /// sampled cell whose result has the nodes below it, if they are finished elsewhere. Their
    /// pages are taken into `pages`. `None` if finishing a node has panicked.
    pub fn into_children(self, pages: &mut Pages) -> Option<(Children, Vec<Option<usize>>)> {
        let (mut groups, mut top) = (vec![Vec::new(); self.cells.len()], Vec::new());
        for (i, cell) in self.cells.iter().enumerate() {
            cell.parent.map_or(&mut top, |parent| &mut groups[parent]).push(i);
        }
        let mut cells: Vec<Option<UnfinishedCell>> = self.cells.into_iter().map(Some).collect();
        join(&top, &groups, &mut cells, pages)
    }
}

/// Joins the nodes of sibling cells, `group`, and all below them to subtrees, and takes their
/// pages: first those below each, then their own. Recursive: cells are nested at most 33 deep.
fn join(
    group: &[usize],
    groups: &[Vec<usize>],
    cells: &mut [Option<UnfinishedCell>],
    pages: &mut Pages,
) -> Option<(Children, Vec<Option<usize>>)> {
    let (mut trees, mut below, mut elsewhere) = (Vec::new(), Vec::new(), Vec::new());
    for &i in group {
        let (children, _) = join(&groups[i], groups, cells, pages)?;
        let cell = cells[i].take()?;
        let State::Finished(Some(mut tree)) = cell.state.into_inner().ok()? else { continue };
        if cell.is_coincident {
            // The chain stands where it would if the cell were a chunk of its own.
            pages.take(&mut tree.children);
        }
        trees.push(*tree);
        below.push(children);
        elsewhere.push(cell.elsewhere);
    }
    pages.take(&mut trees);
    for (tree, mut below) in trees.iter_mut().zip(below) {
        tree.last_mut().children.extend(below.take());
    }
    Some((trees.into(), elsewhere))
}
