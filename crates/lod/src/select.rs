//! The selection: which nodes, and how many points of each, a view wants, and which of them it
//! draws. Walks the node table from its roots, greatest projected spacing first, to a cut that is
//! closed under parent and within its budgets of points and bytes (kanzok2015, section 3.2). The
//! wanted cut does not depend on residency; the drawn cut is its resident part. Plain data in and
//! out: the same input gives the same cut.

use crate::frustum::Frustum;
use crate::occlusion::Occlusion;
use crate::options::{Options, Residency};
use crate::oriented_box::OrientedBox;
use crate::parts::any_part;
use crate::prefix::{
    FACING_LEAST, ProjectedNode, effective_spacing, prefix_at_most, share_continued, spacing,
    wanted,
};
use crate::project::Projection;
use crate::selection::{Drawn, Lacking, Missing, Selection};
use crate::subtree::{self, children_below};
use crate::view::View;
use esker_points::{Lattice, Node, NodeTable};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Selects the nodes that a view wants and draws. The table must have been checked when its file
/// was opened; in an unchecked one, links that do not go down the tree are not followed.
///
/// A node is wanted only if its parent is wanted whole, or has none of its own points in view; it
/// is drawn if it and all of its ancestors are resident. Nodes that `occlusion` hides are neither.
pub fn select(
    table: &NodeTable,
    lattice: &Lattice,
    view: &View,
    options: &Options,
    residency: &impl Residency,
    occlusion: Option<&dyn Occlusion>,
) -> Selection {
    let mut walk = Walk {
        table,
        lattice,
        view,
        options,
        residency,
        occlusion,
        frustum: Frustum::of(view),
        projection: Projection::of(view),
        open: BinaryHeap::new(),
        visited: Vec::new(),
        selection: Selection::default(),
    };
    walk.visit_roots();
    while let Some(candidate) = walk.open.pop() {
        walk.visit(&candidate, u64::MAX);
    }
    walk.selection
}

/// A node in view whose parent is wanted whole.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Candidate {
    /// Distance, pixels, of the points that are wanted in its place without it.
    spacing_px: f64,
    node: u32,
    /// Its index in the file, which does not depend on what is known of the table.
    index: u32,
    /// Distance of the eye to its points and those below, or less; at least the near plane's.
    distance: f64,
    /// Effective spacing of its parent.
    spacing: f64,
    /// Its parent's entry in [`Walk::visited`].
    above: usize,
}

impl Candidate {
    fn key(&self) -> (u64, Reverse<u32>) {
        // Bits of non-negative floats sort as the floats do.
        (self.spacing_px.max(0.0).to_bits(), Reverse(self.index))
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

/// Parent of the roots.
const NO_PARENT: usize = usize::MAX;

/// Spacing on the picture, pixels, from which on splats in cells beside the picture are drawn as
/// wide as if these were drawn too, and how far splats reach, at most, in spacings.
const WIDE_PX: f64 = 16.0;
const WIDE_REACH: f64 = 2.0;

/// A node that the walk has entered.
#[derive(Clone, Copy, Debug)]
struct Visited {
    node: u32,
    /// Entry of its parent.
    above: usize,
    /// Distance of the eye to its points and those below, or less.
    distance: f64,
    /// Whether it is wanted.
    is_wanted: bool,
    /// Whether it and all of its ancestors are resident.
    is_resident: bool,
    /// Effective spacing of what is drawn in its place; infinite if nothing is.
    drawn_spacing: f64,
}

struct Walk<'a, R> {
    table: &'a NodeTable,
    lattice: &'a Lattice,
    view: &'a View,
    options: &'a Options,
    residency: &'a R,
    occlusion: Option<&'a dyn Occlusion>,
    frustum: Frustum,
    projection: Projection,
    open: BinaryHeap<Candidate>,
    visited: Vec<Visited>,
    selection: Selection,
}

impl<R: Residency> Walk<'_, R> {
    /// Visits the roots, those that need the fewest points first, so that each gets a fair share:
    /// where trees overlap or are adjacent, none is left out for another. Then wants the roots that
    /// are not in view: they are drawn in whatever view comes next.
    fn visit_roots(&mut self) {
        let table = self.table;
        table.roots().for_each(|root| self.open(root, f64::INFINITY, NO_PARENT));
        let mut seen = std::mem::take(&mut self.open).into_vec();
        if seen.len() > 1 {
            seen.sort_by_cached_key(|root| (self.root_need(root), root.index));
        }
        for (i, candidate) in seen.iter().enumerate() {
            let left = self.points_left() / (seen.len() - i) as u64;
            self.visit(candidate, left);
        }
        let wanted: Vec<u32> = self.selection.wanted.clone();
        for root in table.roots().filter(|root| !wanted.contains(root)) {
            let is_entered = seen.iter().any(|c| c.node == root);
            let place = self.visited.iter().position(|p| is_entered && p.node == root);
            let place = place.unwrap_or_else(|| {
                let candidate = self.root(root);
                self.enter(&candidate)
            });
            if self.fits(place) {
                self.want(place, 0);
            }
        }
    }

    /// Points of a root that the view needs.
    fn root_need(&self, root: &Candidate) -> usize {
        let node = &self.table.nodes[root.node as usize];
        let contour = OrientedBox::of_contour(node, self.lattice);
        let is_seen =
            self.frustum.touches(&contour) && self.shows_points(root.node, &contour, root.spacing);
        if is_seen { self.need(root, node, node.points(), &contour, 0.0).0 } else { 0 }
    }

    /// A root as a candidate, in view or not.
    fn root(&mut self, node: u32) -> Candidate {
        let (spacing, spacing_px) = (f64::INFINITY, f64::INFINITY);
        let distance = self.distance(node, spacing);
        let index = self.table.index_in_file(node);
        Candidate { spacing_px, node, index, distance, spacing, above: NO_PARENT }
    }

    /// Distance of the eye to the points of a node and below it, or less; at least the near
    /// plane's. `spacing` is that of its parent.
    fn distance(&mut self, node: u32, spacing: f64) -> f64 {
        let (mut lacking, view) = (Vec::new(), self.view);
        let distance = subtree::distance(self.table, self.lattice, node, view.eye, &mut lacking);
        let distance = distance.max(view.near);
        let spacing_px = self.spacing_px(spacing, distance);
        let lacking = lacking.into_iter().map(|node| Lacking { node, spacing_px });
        self.selection.lacking.extend(lacking);
        distance
    }

    /// Points left of the budget.
    fn points_left(&self) -> u64 {
        self.options.points_budget.saturating_sub(self.selection.counters.points_wanted)
    }

    /// Makes a node a candidate, unless its subtree cannot be seen; `spacing` is that of its
    /// parent.
    fn open(&mut self, index: u32, spacing: f64, above: usize) {
        let node = &self.table.nodes[index as usize];
        self.selection.counters.visited += 1;
        if self.residency.rejects_subtree(index) {
            self.selection.counters.filtered += 1;
            return;
        }
        let cell = OrientedBox::of_cell(&node.cell(), self.lattice);
        let distance = self.distance(index, spacing);
        let spacing_px = self.spacing_px(spacing, distance);
        if !self.frustum.touches(&cell) {
            // Wide splats of the points in cells beside the picture would reach into it.
            let near = OrientedBox { half: cell.half + spacing * WIDE_REACH, ..cell };
            if spacing_px <= WIDE_PX || !self.frustum.touches(&near) {
                self.selection.counters.culled += 1;
                return;
            }
        } else if self.is_hidden(&cell, spacing) {
            self.selection.counters.occluded += 1;
            return;
        }
        let (node, index) = (index, self.table.index_in_file(index));
        self.open.push(Candidate { spacing_px, node, index, distance, spacing, above });
    }

    /// Whether a box, in whose place points of a spacing are drawn so far, is certainly hidden. A
    /// surface of such points may be off by as much: it must not hide the points that would refine
    /// it.
    fn is_hidden(&self, b: &OrientedBox, spacing: f64) -> bool {
        let Some(occlusion) = self.occlusion else { return false };
        let from_eye = b.centre - self.view.eye;
        let distance = from_eye.length();
        let nearer = from_eye * (1.0 - spacing / distance);
        spacing < distance && occlusion.hides(&OrientedBox { centre: self.view.eye + nearer, ..*b })
    }

    /// Whether some of a node's own points may be on the picture.
    fn shows_points(&self, index: u32, contour: &OrientedBox, spacing: f64) -> bool {
        let occupancy = self.table.nodes[index as usize].occupancy;
        any_part(contour, occupancy, self.table.sides_of(index), &mut |part| {
            self.frustum.touches(part) && !self.is_hidden(part, spacing)
        })
    }

    /// Decides about a candidate, which may have `points_max` points.
    fn visit(&mut self, candidate: &Candidate, points_max: u64) {
        let node = &self.table.nodes[candidate.node as usize];
        let repeats = node.is_continuation() && node.cell_log2 == 0;
        if repeats && self.options.target_spacing_px > 0.0 {
            self.selection.counters.continuations += 1;
            return;
        }
        let contour = OrientedBox::of_contour(node, self.lattice);
        let is_culled = !self.frustum.touches(&contour);
        let is_filtered = !is_culled && self.residency.points_max(candidate.node) == 0;
        if is_culled
            || is_filtered
            || !self.shows_points(candidate.node, &contour, candidate.spacing)
        {
            let counters = &mut self.selection.counters;
            counters.contour_culled += u64::from(is_culled);
            counters.filtered += u64::from(is_filtered);
            counters.contour_occluded += u64::from(!is_culled && !is_filtered);
            let place = self.enter(candidate);
            let spacing = spacing(node).min(candidate.spacing);
            let is_beside = is_culled && candidate.spacing_px <= WIDE_PX;
            if !is_beside && self.visited.get(candidate.above).is_some_and(|p| p.is_resident) {
                let effective_spacing = spacing as f32;
                let hidden = Drawn { node: candidate.node, prefix: 0, effective_spacing };
                self.selection.hidden.push(hidden);
            }
            self.open_children(candidate, spacing, place);
            return;
        }
        if let Some((spacing, place)) = self.draw(candidate, node, &contour, points_max) {
            self.open_children(candidate, spacing, place);
        }
    }

    /// Wants the points that the view needs of a node, within the budgets, and draws the node if it
    /// is resident. Returns its effective spacing if its children may be wanted.
    fn draw(
        &mut self,
        candidate: &Candidate,
        node: &Node,
        contour: &OrientedBox,
        points_max: u64,
    ) -> Option<(f64, usize)> {
        let count = node.points();
        let place = self.enter(candidate);
        if count == 0 || !self.fits(place) {
            self.selection.counters.withheld += 1;
            return None;
        }
        let above = share_continued(node, self.table.nodes.get(node.parent as usize));
        let (need, facing) = self.need(candidate, node, count, contour, above);
        let need = need.min(self.residency.points_max(candidate.node));
        let left = self.points_left().min(points_max);
        let prefix = if need as u64 <= left { need } else { prefix_at_most(node.levels(), left) };
        if prefix == 0 {
            self.selection.counters.withheld += 1;
            return None;
        }
        self.want(place, prefix);
        let effective =
            effective_spacing(node, count, prefix, facing, above).min(candidate.spacing);
        let counters = &mut self.selection.counters;
        counters.shortened += u64::from(prefix < need);
        counters.points_wanted += prefix as u64;
        if self.visited[place].is_resident {
            counters.drawn += 1;
            counters.points += prefix as u64;
            self.visited[place].drawn_spacing = effective;
            self.selection.drawn.push(Drawn {
                node: candidate.node,
                prefix,
                effective_spacing: effective as f32,
            });
        } else {
            counters.missing += 1;
        }
        (prefix == count).then_some((effective, place))
    }

    /// Points that the view needs of a node of `count` points, regardless of budgets, and how much
    /// of the node faces the eye, if that made them fewer.
    fn need(
        &self,
        candidate: &Candidate,
        node: &Node,
        count: usize,
        contour: &OrientedBox,
        above: f64,
    ) -> (usize, f64) {
        let eye = self.view.eye;
        let target_px = self.options.target_spacing_px;
        // If its children are wanted, the whole node is: objects on a wall seen edge-on may face
        // the eye.
        let own_spacing = spacing(node).min(candidate.spacing);
        if node.child_count > 0 && self.spacing_px(own_spacing, candidate.distance) > target_px {
            return (count, 1.0);
        }
        // Both boxes hold all of its points, so the greater distance is a bound for them. The
        // silhouette is not clipped at the picture's border: the points are everywhere in the box.
        let distance = candidate.distance.max(contour.distance(eye));
        let projected = ProjectedNode {
            spacing_px: self.spacing_px(spacing(node), distance),
            facing: contour.facing(eye).max(FACING_LEAST),
            squares: self
                .projection
                .silhouette(contour)
                .map_or(f64::INFINITY, |s| s.squares(target_px)),
            above,
        };
        (wanted(node, count, &projected, target_px), projected.facing)
    }

    /// Notes that the walk enters a node. Returns its entry.
    fn enter(&mut self, candidate: &Candidate) -> usize {
        let above = self.visited.get(candidate.above);
        self.visited.push(Visited {
            node: candidate.node,
            above: candidate.above,
            distance: candidate.distance,
            is_wanted: false,
            is_resident: above.is_none_or(|p| p.is_resident)
                && self.residency.is_resident(candidate.node),
            drawn_spacing: above.map_or(f64::INFINITY, |p| p.drawn_spacing),
        });
        self.visited.len() - 1
    }

    /// Whether an entry and its ancestors that are not wanted yet fit the budget of bytes.
    fn fits(&self, mut place: usize) -> bool {
        let mut bytes = self.selection.counters.bytes_wanted;
        while let Some(p) = self.visited.get(place).filter(|p| !p.is_wanted) {
            bytes = bytes.saturating_add(self.residency.slot_bytes(p.node));
            place = p.above;
        }
        bytes <= self.options.bytes_budget
    }

    /// Wants an entry, with `prefix` points, after its ancestors that were only entered.
    fn want(&mut self, place: usize, prefix: usize) {
        let mut chain = vec![(place, prefix)];
        let mut above = self.visited[place].above;
        while let Some(p) = self.visited.get(above).filter(|p| !p.is_wanted) {
            chain.push((above, 0));
            above = p.above;
        }
        while let Some((place, prefix)) = chain.pop() {
            self.want_one(place, prefix);
        }
        self.selection.wanted_in_picture = self.selection.wanted.len();
    }

    fn want_one(&mut self, place: usize, prefix: usize) {
        self.visited[place].is_wanted = true;
        let Visited { node, distance, drawn_spacing, .. } = self.visited[place];
        let bytes = self.residency.slot_bytes(node);
        let wanted = &mut self.selection.counters.bytes_wanted;
        *wanted = wanted.saturating_add(bytes);
        self.selection.wanted.push(node);
        self.selection.prefixes.push(prefix);
        if !self.residency.is_resident(node) {
            let record = &self.table.nodes[node as usize];
            let contour = OrientedBox::of_contour(record, self.lattice);
            self.selection.missing.push(Missing {
                node,
                prefix,
                distance: contour.distance(self.view.eye),
                spacing_px: self.spacing_px(drawn_spacing, distance),
                bytes,
            });
        }
    }

    /// Makes the children candidates, unless the spacing is fine enough in their place.
    fn open_children(&mut self, candidate: &Candidate, spacing: f64, place: usize) {
        let target_px = self.options.target_spacing_px;
        if target_px > 0.0 && self.spacing_px(spacing, candidate.distance) <= target_px {
            return;
        }
        if self.table.nodes[candidate.node as usize].lacks_children() {
            let spacing_px = self.spacing_px(spacing, candidate.distance);
            self.selection.lacking.push(Lacking { node: candidate.node, spacing_px });
        }
        for child in children_below(self.table, candidate.node) {
            self.open(child, spacing, place);
        }
    }

    fn spacing_px(&self, spacing: f64, distance: f64) -> f64 {
        self.projection.focal_px() * spacing / distance
    }
}
