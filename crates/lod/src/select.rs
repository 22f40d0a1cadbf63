//! The choice: which nodes, and how many points of each, a view wants, and which of them it draws. Walks
//! the node table from its roots, worst projected spacing first, into a cut that is closed under parent
//! and within its budgets of points and bytes (kanzok2015, section 3.2; DESIGN, section 7). The cut that
//! is wanted does not depend on what is resident; what is drawn is its resident part. Plain data in and
//! out: the same input gives the same cut.

use crate::frustum::Frustum;
use crate::occlusion::Occlusion;
use crate::options::{Options, Residency};
use crate::oriented_box::OrientedBox;
use crate::parts::any_part;
use crate::prefix::{
    FACING_LEAST, Shown, effective_spacing, prefix_at_most, share_above, spacing, wanted,
};
use crate::project::Projection;
use crate::selection::{Drawn, Missing, Selection};
use crate::view::View;
use esker_points::{Lattice, Node, NodeTable};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Chooses what a view wants and what it draws. The table is one that was checked when its file was
/// opened; links of an unchecked one that don't go down the tree are not followed.
///
/// A node is wanted only where its parent is wanted whole, or has none of its own points in view; it is
/// drawn where it and all of its ancestors are resident. What `occlusion` hides is neither.
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
        places: Vec::new(),
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
    /// Distance in pixels of what is wanted in its place without it.
    spacing_px: f64,
    node: u32,
    /// Distance of the eye to its cell, at least the near plane's.
    distance: f64,
    /// Effective spacing of its parent.
    spacing: f64,
    /// Its parent's entry in [`Walk::places`].
    above: usize,
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

/// "No place": above the root.
const NOWHERE: usize = usize::MAX;

/// A node that the walk went through.
#[derive(Clone, Copy, Debug)]
struct Place {
    node: u32,
    /// Its parent's place.
    above: usize,
    /// Distance of the eye to its cell.
    distance: f64,
    /// Whether it is among the wanted.
    is_wanted: bool,
    /// Whether it and all of its ancestors are resident.
    is_resident: bool,
    /// Effective spacing of what is drawn in its place; infinite where nothing is.
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
    places: Vec<Place>,
    selection: Selection,
}

impl<R: Residency> Walk<'_, R> {
    /// Visits the roots, first those that need least, so that each gets a fair share of the points: where
    /// trees overlap or lie side by side, none is left out for another. Then wants those of which nothing is
    /// in view: they serve whatever comes into view next.
    fn visit_roots(&mut self) {
        let table = self.table;
        table.roots().for_each(|root| self.open(root, f64::INFINITY, NOWHERE));
        let mut seen = std::mem::take(&mut self.open).into_vec();
        if seen.len() > 1 {
            seen.sort_by_cached_key(|root| (self.root_need(root), root.node));
        }
        for (i, candidate) in seen.iter().enumerate() {
            let left = self.points_left() / (seen.len() - i) as u64;
            self.visit(candidate, left);
        }
        let wanted: Vec<u32> = self.selection.wanted.clone();
        for root in table.roots().filter(|root| !wanted.contains(root)) {
            let gone_through = seen.iter().any(|c| c.node == root);
            let place = self.places.iter().position(|p| gone_through && p.node == root);
            let place = place.unwrap_or_else(|| self.pass(&self.root(root)));
            if self.fits(place) {
                self.want(place, 0);
            }
        }
    }

    /// Points that the view needs of a root.
    fn root_need(&self, root: &Candidate) -> usize {
        let node = &self.table.nodes[root.node as usize];
        let contour = OrientedBox::of_contour(node, self.lattice);
        let is_seen =
            self.frustum.touches(&contour) && self.shows_points(root.node, &contour, root.spacing);
        if is_seen { self.need(root, node, node.points(), &contour, 0.0).0 } else { 0 }
    }

    /// A root, whether it is in view or not.
    fn root(&self, node: u32) -> Candidate {
        let cell = OrientedBox::of_cell(&self.table.nodes[node as usize].cell(), self.lattice);
        let distance = cell.distance(self.view.eye).max(self.view.near);
        let (spacing, spacing_px) = (f64::INFINITY, f64::INFINITY);
        Candidate { spacing_px, node, distance, spacing, above: NOWHERE }
    }

    /// Points that the budget has left.
    fn points_left(&self) -> u64 {
        self.options.points_budget.saturating_sub(self.selection.counters.points_wanted)
    }

    /// Takes a node up, unless its subtree cannot be seen; `spacing` is what is wanted without it.
    fn open(&mut self, index: u32, spacing: f64, above: usize) {
        let node = &self.table.nodes[index as usize];
        self.selection.counters.visited += 1;
        if self.residency.is_barren(index) {
            self.selection.counters.filtered += 1;
            return;
        }
        let cell = OrientedBox::of_cell(&node.cell(), self.lattice);
        if !self.frustum.touches(&cell) {
            self.selection.counters.culled += 1;
            return;
        }
        if self.is_hidden(&cell, spacing) {
            self.selection.counters.occluded += 1;
            return;
        }
        let distance = cell.distance(self.view.eye).max(self.view.near);
        let spacing_px = self.spacing_px(spacing, distance);
        self.open.push(Candidate { spacing_px, node: index, distance, spacing, above });
    }

    /// Whether a box, in whose place points of a spacing are drawn so far, is certainly hidden. Surfaces
    /// made of those may stand off by as much: they must not hide the points that would mend them.
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

    /// Decides about a node that was taken up, which may have `points_max` points.
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
            let place = self.pass(candidate);
            let spacing = spacing(node).min(candidate.spacing);
            if !is_culled && self.places.get(candidate.above).is_some_and(|p| p.is_resident) {
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

    /// Wants what the view needs of a node, as far as the budgets go, and draws it where it can be.
    /// Its effective spacing where its children may be wanted.
    fn draw(
        &mut self,
        candidate: &Candidate,
        node: &Node,
        contour: &OrientedBox,
        points_max: u64,
    ) -> Option<(f64, usize)> {
        let count = node.points();
        let place = self.pass(candidate);
        if count == 0 || !self.fits(place) {
            self.selection.counters.withheld += 1;
            return None;
        }
        let above = share_above(node, self.table.nodes.get(node.parent as usize));
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
        if self.places[place].is_resident {
            counters.drawn += 1;
            counters.points += prefix as u64;
            self.places[place].drawn_spacing = effective;
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

    /// Points that the view needs of a node of `count` points, budgets aside, and how much of it faces the
    /// eye, where that made them fewer.
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
        // Where its children are wanted all of it is: what stands on a wall seen edge-on may face us.
        let own_spacing = spacing(node).min(candidate.spacing);
        if node.child_count > 0 && self.spacing_px(own_spacing, candidate.distance) > target_px {
            return (count, 1.0);
        }
        // Both boxes hold all of its points, so the farther of the two distances bounds theirs. The
        // silhouette is not cut at the picture's border: the points are everywhere in the box.
        let distance = candidate.distance.max(contour.distance(eye));
        let shown = Shown {
            spacing_px: self.spacing_px(spacing(node), distance),
            facing: contour.facing(eye).max(FACING_LEAST),
            squares: self
                .projection
                .silhouette(contour)
                .map_or(f64::INFINITY, |s| s.squares(target_px)),
            above,
        };
        (wanted(node, count, &shown, target_px), shown.facing)
    }

    /// Notes that the walk goes through a node.
    fn pass(&mut self, candidate: &Candidate) -> usize {
        let above = self.places.get(candidate.above);
        self.places.push(Place {
            node: candidate.node,
            above: candidate.above,
            distance: candidate.distance,
            is_wanted: false,
            is_resident: above.is_none_or(|p| p.is_resident)
                && self.residency.is_resident(candidate.node),
            drawn_spacing: above.map_or(f64::INFINITY, |p| p.drawn_spacing),
        });
        self.places.len() - 1
    }

    /// Whether a place, and those above it that are not wanted yet, fit the budget of bytes.
    fn fits(&self, mut place: usize) -> bool {
        let mut bytes = self.selection.counters.bytes_wanted;
        while let Some(p) = self.places.get(place).filter(|p| !p.is_wanted) {
            bytes = bytes.saturating_add(self.residency.slot_bytes(p.node));
            place = p.above;
        }
        bytes <= self.options.bytes_budget
    }

    /// Wants a place, with `prefix` points, and first those above it that were only gone through.
    fn want(&mut self, place: usize, prefix: usize) {
        let mut chain = vec![(place, prefix)];
        let mut above = self.places[place].above;
        while let Some(p) = self.places.get(above).filter(|p| !p.is_wanted) {
            chain.push((above, 0));
            above = p.above;
        }
        while let Some((place, prefix)) = chain.pop() {
            self.want_one(place, prefix);
        }
    }

    fn want_one(&mut self, place: usize, prefix: usize) {
        self.places[place].is_wanted = true;
        let Place { node, distance, drawn_spacing, .. } = self.places[place];
        let bytes = self.residency.slot_bytes(node);
        let wanted = &mut self.selection.counters.bytes_wanted;
        *wanted = wanted.saturating_add(bytes);
        self.selection.wanted.push(node);
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

    /// Takes up the children in whose places a spacing is not fine enough.
    fn open_children(&mut self, candidate: &Candidate, spacing: f64, place: usize) {
        let target_px = self.options.target_spacing_px;
        if target_px > 0.0 && self.spacing_px(spacing, candidate.distance) <= target_px {
            return;
        }
        let table = self.table;
        for child in table.nodes[candidate.node as usize].children() {
            let goes_down = child > candidate.node
                && table.nodes.get(child as usize).is_some_and(|c| c.parent == candidate.node);
            if goes_down {
                self.open(child, spacing, place);
            }
        }
    }

    fn spacing_px(&self, spacing: f64, distance: f64) -> f64 {
        self.projection.focal_px() * spacing / distance
    }
}
