//! The choice: which nodes, and how many points of each, a view draws. Walks the node table from the
//! root, worst projected spacing first, into a cut that is closed under parent and within the points
//! budget (kanzok2015, section 3.2; DESIGN, section 7). Plain data in and out: the same input gives
//! the same cut.

use crate::frustum::Frustum;
use crate::oriented_box::OrientedBox;
use crate::prefix::{effective_spacing, prefix_at_most, spacing, wanted};
use crate::view::View;
use esker_points::{Lattice, Node, NodeTable};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// What a view may cost and how fine it shall be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Points drawn at most; never passed.
    pub points_budget: u64,
    /// Distance of neighbouring points on the picture that is fine enough, pixels. 0 asks for every
    /// point of the nodes in view, continuations (coincident points) included.
    pub target_spacing_px: f64,
}

impl Default for Options {
    /// A point a pixel, within what two cores project in a tenth of a second.
    fn default() -> Self {
        Self { points_budget: 10_000_000, target_spacing_px: 1.0 }
    }
}

/// A node of the cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drawn {
    /// Index in the node table.
    pub node: u32,
    /// Its first points that are drawn: whole strata, at least one point.
    pub prefix: usize,
    /// Typical distance of points in its cell, these and the ancestors', the file's unit; never more
    /// than the parent's.
    pub effective_spacing: f32,
}

/// What was looked at, in nodes; `visited` is the sum of `culled`, `contour_culled`, `continuations`,
/// `withheld`, `missing` and `drawn`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Looked at.
    pub visited: u64,
    /// With their whole subtree outside of the view.
    pub culled: u64,
    /// With none of their own points in view; their children were looked at all the same.
    pub contour_culled: u64,
    /// Left out because they only repeat places that are drawn already.
    pub continuations: u64,
    /// Left out because not one stratum fitted the budget.
    pub withheld: u64,
    /// Wanted, but not resident; what is resident above them serves.
    pub missing: u64,
    /// Drawn.
    pub drawn: u64,
    /// Of those drawn: with fewer points than wanted, because of the budget.
    pub shortened: u64,
    /// Points drawn, in all.
    pub points: u64,
}

/// The cut of a view.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// What to draw, the coarsest on the picture first; parents stand before their children.
    pub drawn: Vec<Drawn>,
    /// What to load, the most urgent first.
    pub missing: Vec<u32>,
    /// How it came about.
    pub counters: Counters,
}

/// Chooses what a view draws. `resident` tells whether a node's points are at hand. The table is one
/// that was checked when its file was opened; links of an unchecked one that don't go down the tree
/// are not followed.
///
/// A node is drawn only where its parent is drawn whole, or has none of its own points in view.
pub fn select(
    table: &NodeTable,
    lattice: &Lattice,
    view: &View,
    options: &Options,
    resident: impl Fn(u32) -> bool,
) -> Selection {
    let mut walk = Walk {
        table,
        lattice,
        view,
        options,
        frustum: Frustum::of(view),
        open: BinaryHeap::new(),
        selection: Selection::default(),
    };
    if table.root().is_some() {
        walk.open(0, f64::INFINITY);
    }
    while let Some(candidate) = walk.open.pop() {
        walk.visit(&candidate, &resident);
    }
    walk.selection
}

/// A node in view whose parent is drawn whole.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Candidate {
    /// Distance in pixels of what is drawn in its place without it.
    spacing_px: f64,
    node: u32,
    /// Distance of the eye to its cell, at least the near plane's.
    distance: f64,
    /// Effective spacing of its parent.
    spacing: f64,
}

impl Candidate {
    fn key(&self) -> (u64, Reverse<u32>) {
        // Bits of floats that are not negative sort as the floats do.
        (self.spacing_px.max(0.0).to_bits(), Reverse(self.node))
    }
}

impl Eq for Candidate {}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.key().cmp(&other.key())
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

struct Walk<'a> {
    table: &'a NodeTable,
    lattice: &'a Lattice,
    view: &'a View,
    options: &'a Options,
    frustum: Frustum,
    open: BinaryHeap<Candidate>,
    selection: Selection,
}

impl Walk<'_> {
    /// Takes a node up, unless its subtree is out of view; `spacing` is what is drawn without it.
    fn open(&mut self, index: u32, spacing: f64) {
        let node = &self.table.nodes[index as usize];
        self.selection.counters.visited += 1;
        let cell = OrientedBox::of_cell(&node.cell(), self.lattice);
        if !self.frustum.touches(&cell) {
            self.selection.counters.culled += 1;
            return;
        }
        let distance = cell.distance(self.view.eye).max(self.view.near);
        let spacing_px = self.spacing_px(spacing, distance);
        self.open.push(Candidate { spacing_px, node: index, distance, spacing });
    }

    fn visit(&mut self, candidate: &Candidate, resident: &impl Fn(u32) -> bool) {
        let node = &self.table.nodes[candidate.node as usize];
        let counters = &mut self.selection.counters;
        if node.is_continuation() && self.options.target_spacing_px > 0.0 {
            counters.continuations += 1;
            return;
        }
        if !resident(candidate.node) {
            counters.missing += 1;
            self.selection.missing.push(candidate.node);
            return;
        }
        let contour = OrientedBox::of_contour(node, self.lattice);
        if !self.frustum.touches(&contour) {
            counters.contour_culled += 1;
            self.open_children(candidate, spacing(node).min(candidate.spacing));
            return;
        }
        if let Some(spacing) = self.draw(candidate, node, &contour) {
            self.open_children(candidate, spacing);
        }
    }

    /// Draws what is wanted of a node, as far as the budget goes. Its effective spacing where its
    /// children may be drawn.
    fn draw(&mut self, candidate: &Candidate, node: &Node, contour: &OrientedBox) -> Option<f64> {
        let eye = self.view.eye;
        let target_px = self.options.target_spacing_px;
        let count = node.points();
        if count == 0 {
            self.selection.counters.withheld += 1;
            return None;
        }
        // Both boxes hold all of its points, so the farther of the two distances bounds theirs.
        let distance = candidate.distance.max(contour.distance(eye));
        let own_spacing = spacing(node).min(candidate.spacing);
        let spacing_px = self.spacing_px(spacing(node), distance);
        // Where its children are wanted all of it is: what stands on a wall seen edge-on may face us.
        let refined =
            node.child_count > 0 && self.spacing_px(own_spacing, candidate.distance) > target_px;
        let facing = if refined { 1.0 } else { contour.facing(eye) };
        let need = if refined { count } else { wanted(node, count, spacing_px, target_px, facing) };
        let left = self.options.points_budget.saturating_sub(self.selection.counters.points);
        let prefix = if need as u64 <= left { need } else { prefix_at_most(node.levels(), left) };
        let counters = &mut self.selection.counters;
        if prefix == 0 {
            counters.withheld += 1;
            return None;
        }
        counters.drawn += 1;
        counters.shortened += u64::from(prefix < need);
        counters.points += prefix as u64;
        let effective = effective_spacing(node, count, prefix).min(candidate.spacing);
        self.selection.drawn.push(Drawn {
            node: candidate.node,
            prefix,
            effective_spacing: effective as f32,
        });
        (prefix == count).then_some(effective)
    }

    /// Takes up the children in whose places a spacing is not fine enough.
    fn open_children(&mut self, candidate: &Candidate, spacing: f64) {
        let target_px = self.options.target_spacing_px;
        if target_px > 0.0 && self.spacing_px(spacing, candidate.distance) <= target_px {
            return;
        }
        let table = self.table;
        for child in table.nodes[candidate.node as usize].children() {
            let goes_down = child > candidate.node
                && table.nodes.get(child as usize).is_some_and(|c| c.parent == candidate.node);
            if goes_down {
                self.open(child, spacing);
            }
        }
    }

    fn spacing_px(&self, spacing: f64, distance: f64) -> f64 {
        self.view.focal_px() * spacing / distance
    }
}
