//! Finishes the nodes of trees whose density is uneven, as [`crate::sample::uneven`] arranges them,
//! and keeps points beside dense parts in the nodes around them.

use crate::page::histograms::Counts;
use crate::rows::row::Rows;
use crate::sample::candidates::Candidates;
use crate::sample::cell::{Context, LEAF_NODES, Part, ends};
use crate::sample::order::parts;
use crate::sample::pending::PendingCell;
use crate::sample::shape::{Moments, Shape};
use crate::sample::spacing::radii;
use crate::sample::sparse::last_kept;
use crate::sample::turns::LAST_TURN;
use crate::sample::uneven::{Arranged, Arrangement, Leaf};
use crate::sample::unevenness::UNEVEN;
use crate::tree::subtree::{Children, Subtree};
use esker_points::node::SHAPE_CONTINUATION;
use esker_points::{Cell, quant};
use std::ops::Range;

/// Nodes' worth of points up to which a tree of uneven density is arranged at once: as a leaf.
const UNEVEN_NODES: usize = 8;

/// A quick test, by the numbers of points in parts of a leaf, that most leaves of even density do
/// not pass.
fn seems_uneven(rows: &Rows<'_>, leaf: &PendingCell) -> bool {
    /// Log2 of the parts along an edge.
    const PARTS_LOG2: u8 = 5;
    /// Ratio of the numbers of points of uneven parts.
    const RATIO: usize = (UNEVEN * UNEVEN) as usize;
    /// Share of parts that are sparse, and of points in dense ones, at least: one in so many.
    const SHARE: usize = 64;
    let shift = leaf.cell.log2.saturating_sub(PARTS_LOG2);
    let part = |row: &u32| rows.position(*row).map(|c| u64::from(c) >> shift);
    // Points of a part follow each other along the curve.
    let parts = leaf.offered.chunk_by(|a, b| part(a) == part(b)).map(<[u32]>::len);
    let mut counts: Vec<usize> = parts.collect();
    counts.sort_unstable();
    let mut half = leaf.offered.len() / 2;
    let median = counts.iter().rev().find(|&&count| {
        let is_last = count > half;
        half = half.saturating_sub(count);
        is_last
    });
    let median = median.copied().unwrap_or(0);
    let sparse = counts.iter().filter(|&&count| count * RATIO < median).count();
    let dense: usize = counts.iter().filter(|&&count| count > median * RATIO).sum();
    sparse * SHARE >= counts.len() || dense * SHARE >= leaf.offered.len()
}

impl Context {
    /// Number of points up to which a tree is one chunk, so that it can be arranged at once.
    pub fn arranged_points_max(&self) -> u64 {
        (self.capacity * UNEVEN_NODES) as u64
    }

    /// Number of points up to which a part of a tree is never divided, for nodes of `capacity`
    /// points: those of a leaf, and of a tree that is arranged at once.
    pub fn undivided_points_max(capacity: u32) -> u64 {
        u64::from(capacity) * UNEVEN_NODES.max(LEAF_NODES) as u64
    }

    /// Whether rows are all points of a tree that is arranged at once.
    pub fn is_uneven(&self, rows: &Rows<'_>, points: Range<u32>, cell: &Cell) -> bool {
        let count = points.len() as u64;
        if count != self.points || count > self.arranged_points_max() {
            return false;
        }
        let mut leaf = self.leaf(rows, points, *cell);
        self.set_local_spacings(rows, &mut leaf);
        self.leaf_of(rows, &leaf, (&[], None)).is_uneven()
    }

    /// Points that a leaf of a larger tree keeps for nodes of its own, because its density is
    /// uneven; empty if it is not.
    pub fn withheld(&self, rows: &Rows<'_>, leaf: &PendingCell) -> Vec<u32> {
        if !seems_uneven(rows, leaf) {
            return Vec::new();
        }
        let moments = &leaf.moments;
        let mut leaf = self.offers_of(rows, leaf);
        if !self.leaf_of(rows, &leaf, (&[], None)).is_uneven() {
            return Vec::new();
        }
        let shape = Shape::of(moments.covariance(self.scale));
        self.assign_turns(rows, &mut leaf, &[], None, &shape);
        let arrangement = self.leaf_of(rows, &leaf, (&[], None)).arrange();
        arrangement.map_or_else(Vec::new, |arrangement| arrangement.withheld)
    }

    /// Sets the radii of a leaf to its local spacings by octree cells.
    fn set_local_spacings(&self, rows: &Rows<'_>, leaf: &mut PendingCell) {
        let candidates = Candidates::new(rows, &leaf.offered, &leaf.cell, self.scale, None);
        let in_unit = |steps: f32| (f64::from(steps) * candidates.step) as f32;
        let steps = radii(&candidates.shared_log2, 2);
        leaf.radii = candidates.as_offered(steps.into_iter().map(in_unit).collect());
    }

    /// Points that a cell offers which are far from others that are close to each other, by their
    /// indices.
    pub(super) fn apart(&self, rows: &Rows<'_>, cell: &PendingCell) -> Vec<u32> {
        self.leaf_of(rows, &self.offers_of(rows, cell), (&[], None)).apart()
    }

    /// Exact local spacings of the points that a cell offers, in the file's unit.
    pub(super) fn local_spacings(&self, rows: &Rows<'_>, cell: &PendingCell) -> Vec<f32> {
        let offers = self.offers_of(rows, cell);
        let leaf = Leaf { is_part: false, ..self.leaf_of(rows, &offers, (&[], None)) };
        leaf.spacings_beyond(0.0)
    }

    /// The points that a cell offers, as a leaf, with their local spacings.
    fn offers_of(&self, rows: &Rows<'_>, cell: &PendingCell) -> PendingCell {
        let mut leaf = self.leaf(rows, 0..0, cell.cell);
        leaf.offered = cell.offered[..cell.sampled].to_vec();
        leaf.sampled = cell.sampled;
        if cell.radii.is_empty() {
            self.set_local_spacings(rows, &mut leaf);
        } else {
            leaf.radii = cell.radii[..cell.sampled].to_vec();
        }
        leaf
    }

    /// Arranges what the cell above, whose sample has the spacing `above`, has left of a leaf;
    /// `None` if its density is even.
    pub(super) fn arrangement(
        &self,
        rows: &Rows<'_>,
        pending: &PendingCell,
        taken: &[u16],
        above: Option<f64>,
    ) -> Option<Arrangement> {
        self.leaf_of(rows, pending, (taken, above)).arrange()
    }

    /// The points of a leaf, to be arranged if their density is uneven.
    fn leaf_of<'a>(
        &self,
        rows: &Rows<'_>,
        pending: &'a PendingCell,
        (taken, above): (&'a [u16], Option<f64>),
    ) -> Leaf<'a> {
        Leaf {
            positions: pending.offered.iter().map(|&i| rows.position(i)).collect(),
            turns: &pending.turns,
            radii: &pending.radii,
            scale: self.scale,
            capacity: self.capacity,
            is_part: (pending.offered.len() as u64) < self.points,
            taken,
            above: above.unwrap_or(f64::INFINITY),
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
        // Wires are narrower than the distances of their points in a plane say.
        let narrow = std::mem::replace(&mut pending.radii, arrangement.radii);
        let is_wire = |i: u32| self.wires.is_some_and(|marks| marks.is_wire(rows.row(i)));
        for ((radius, &i), narrow) in pending.radii.iter_mut().zip(&pending.offered).zip(narrow) {
            if narrow < *radius && is_wire(i) {
                *radius = narrow;
            }
        }
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

impl Context {
    /// Leaves those of the `chosen` points in their cells that are far from dense points around: in
    /// the sample they would be drawn as narrow as the finest node around them. `local` are their
    /// spacings in the sample.
    pub(super) fn leave_apart(
        &self,
        rows: &Rows<'_>,
        (parts, few, turns): (&mut [Part], &[bool], &mut [u16]),
        (chosen, local): (&[u32], &[f32]),
    ) {
        let kept = last_kept(turns);
        for ((child, part), &is_few) in parts.iter_mut().zip(few) {
            // No node is drawn around the points of cells that end here.
            let is_arranged = !child.withheld.is_empty() || child.least_radius > 0.0;
            if is_arranged || ends(child, is_few, &turns[part.clone()]) {
                continue;
            }
            let first = chosen.partition_point(|&i| (i as usize) < part.start);
            let own = first..chosen.partition_point(|&i| (i as usize) < part.end);
            let apart = self.apart(rows, child);
            for (&i, &local) in chosen[own.clone()].iter().zip(&local[own]) {
                let at = i - part.start as u32;
                if turns[i as usize] > kept && apart.binary_search(&at).is_ok() {
                    turns[i as usize] = LAST_TURN;
                    child.apart.push((at, local));
                }
            }
        }
    }

    /// Updates `shares` as [`Context::shares`] does, by the local spacings of the points in their
    /// own cells, for a sample that is bounded by its sparse parts.
    pub(super) fn exact_shares(
        &self,
        rows: &Rows<'_>,
        mut shares: Vec<f32>,
        parts: &[Part],
        (few, turns): (&[bool], &[u16]),
        above: f64,
    ) -> Vec<f32> {
        shares.resize(turns.len(), 1.0);
        for ((child, part), &is_few) in parts.iter().zip(few) {
            if ends(child, is_few, &turns[part.clone()]) {
                let local = self.local_spacings(rows, child);
                let share = |local: f32| if local > 0.0 { local / above as f32 } else { 1.0 };
                let own = shares[part.clone()].iter_mut().zip(local);
                own.for_each(|(own, local)| *own = own.min(share(local)));
                // Beside dense points the distance to these is not that of the own part.
                let apart = self.apart(rows, child);
                apart.iter().for_each(|&i| shares[part.start + i as usize] = 1.0);
            }
        }
        shares
    }
}
