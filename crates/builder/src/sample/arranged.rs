//! Finishes the nodes of trees whose density is uneven, as [`crate::sample::uneven`] arranges them.

use crate::page::histograms::Counts;
use crate::rows::row::Rows;
use crate::sample::candidates::Candidates;
use crate::sample::cell::Context;
use crate::sample::order::parts;
use crate::sample::pending::PendingCell;
use crate::sample::shape::{Moments, Shape};
use crate::sample::spacing::radii;
use crate::sample::uneven::{Arranged, Arrangement, Leaf};
use crate::tree::subtree::{Children, Subtree};
use esker_points::node::SHAPE_CONTINUATION;
use esker_points::{Cell, quant};
use std::ops::Range;

/// Nodes' worth of points up to which a tree of uneven density is arranged at once: as a leaf.
const UNEVEN_NODES: usize = 8;

impl Context {
    /// Number of points up to which a tree is one chunk, so that it can be arranged at once.
    pub fn arranged_points_max(&self) -> u64 {
        (self.capacity * UNEVEN_NODES) as u64
    }

    /// Whether rows are all points of a tree that is arranged at once.
    pub fn is_uneven(&self, rows: &Rows<'_>, points: Range<u32>, cell: &Cell) -> bool {
        let count = points.len() as u64;
        if count != self.points || count > self.arranged_points_max() {
            return false;
        }
        let mut leaf = self.leaf(rows, points, *cell);
        let candidates = Candidates::new(rows, &leaf.offered, cell, self.scale, None);
        let in_unit = |steps: f32| (f64::from(steps) * candidates.step) as f32;
        let steps = radii(&candidates.shared_log2, 2);
        leaf.radii = candidates.as_offered(steps.into_iter().map(in_unit).collect());
        self.leaf_of(rows, &leaf).is_uneven()
    }

    /// The points of a leaf, to be arranged if their density is uneven.
    pub(super) fn leaf_of<'a>(&self, rows: &Rows<'_>, pending: &'a PendingCell) -> Leaf<'a> {
        Leaf {
            positions: pending.offered.iter().map(|&i| rows.position(i)).collect(),
            turns: &pending.turns,
            radii: &pending.radii,
            scale: self.scale,
            capacity: self.capacity,
        }
    }

    /// Finishes the nodes of a leaf of uneven density ([`crate::sample::uneven`]).
    pub(super) fn arrange(
        &self,
        rows: &Rows<'_>,
        mut pending: PendingCell,
        arrangement: Arrangement,
        counts: &Counts,
    ) -> Option<Subtree> {
        pending.radii = arrangement.radii;
        // Children come after their parents.
        let mut below: Vec<Vec<Subtree>> = arrangement.nodes.iter().map(|_| Vec::new()).collect();
        let mut root = None;
        for (number, node) in arrangement.nodes.iter().enumerate().rev() {
            pending.cell = node.cell;
            pending.moments = Moments::of(
                node.range.clone().map(|i| rows.position(pending.offered[i])),
                &node.cell,
            );
            let mut children = std::mem::take(&mut below[number]);
            children.reverse();
            let tree = self.arranged(rows, &pending, node, children.into(), counts);
            match node.parent {
                Some(parent) => below[parent].extend(tree),
                None => root = tree,
            }
        }
        root
    }

    /// Finishes a node of an uneven leaf; nodes that continue it hold what exceeds the capacity.
    fn arranged(
        &self,
        rows: &Rows<'_>,
        pending: &PendingCell,
        node: &Arranged,
        mut below: Children,
        counts: &Counts,
    ) -> Option<Subtree> {
        let shape = Shape::of(pending.moments.covariance(self.scale));
        let total = node.range.len();
        let dimension = shape.dimension_of(total);
        let turns: Vec<u16> = node.points.iter().map(|&i| pending.turns[i as usize]).collect();
        let count = turns.len().div_ceil(self.capacity);
        let part_of = if count > 1 { parts(&turns, count) } else { vec![0; turns.len()] };
        let step = self.scale.iter().fold(f64::INFINITY, |a, &b| a.min(b)).max(1e-30);
        let full = node.spacing.clamp(step, 1e30);
        let mut left = total;
        for part in (0..count as u32).rev() {
            let of_part = node.points.iter().zip(&part_of).filter(|(_, p)| **p == part);
            let points: Vec<u32> = of_part.map(|(i, _)| *i).collect();
            let coarser = (total as f64 / left as f64).powf(1.0 / f64::from(dimension.clamp(1, 2)));
            left -= points.len();
            let spacing = ([full * coarser, full], quant::RADIUS_MAX);
            let mut tree = self.node(rows, pending, &points, dimension, spacing, counts);
            tree.children = below;
            if part == 0 {
                return Some(tree);
            }
            tree.node.shape |= SHAPE_CONTINUATION;
            below = vec![tree].into();
        }
        None
    }
}
