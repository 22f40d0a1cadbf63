//! The light cut: continues a selection with nodes that are not in the picture, since surfaces
//! beside, behind and hidden from the eye light what is seen (`bauszat2011`, section 3.1, takes
//! the whole scene for granted). They are chosen by distance alone, without frustum and occlusion,
//! as whole nodes, with budgets of their own. The selection's choice for the picture goes in and
//! stays as it is; nodes, wanted nodes and missing nodes are appended.

use crate::octree::CompactOctree;
use crate::options::{Options, Residency};
use crate::oriented_box::OrientedBox;
use crate::prefix::{effective_spacing, share_continued, spacing};
use crate::selection::{Drawn, Lacking, Missing, Selection};
use crate::subtree::{self, children_below};
use crate::view::View;
use esker_points::{Lattice, Node, NodeTable};
use std::cmp::{Ordering, Reverse};
use std::collections::{BinaryHeap, HashMap};

/// Detail and budgets of the surroundings of a picture.
///
/// The distance of neighbouring points is fine enough if it is at most `coarseness` times the
/// picture's target spacing, seen from the distance of their cell to the eye, or from the median
/// distance of the points in the picture where that is greater: what is nearer to the eye than the
/// scene is not nearer to the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surroundings {
    /// Target spacing of the surroundings over that of the picture, positive.
    pub coarseness: f64,
    /// Greatest number of wanted points, in addition to those of the picture.
    pub points_budget: u64,
    /// Greatest number of bytes in the slots of their nodes. They never take more than the nodes of
    /// the picture leave of [`Options::bytes_budget`].
    pub bytes_budget: u64,
}

impl Default for Surroundings {
    /// A usual picture is a sixteenth of all directions, so that surroundings of an eighth of its
    /// detail have a quarter of its points, and two to four times as many as whole nodes. A million
    /// points bound the time in which a tree for rays is built; where they do not suffice, the
    /// nodes whose parents are fine enough most nearly are left out.
    fn default() -> Self {
        Self { coarseness: 8.0, points_budget: 1 << 20, bytes_budget: u64::MAX }
    }
}

/// Adds the surroundings of the picture to its selection: [`Selection::surroundings`], and their
/// nodes behind those of the picture in [`Selection::wanted`] and [`Selection::missing`]. The other
/// inputs are those that the selection was made from.
///
/// A node is wanted only if its parent is wanted whole, by the picture or by its surroundings; it
/// is drawn if it and all of its ancestors are resident. What is wanted does not depend on what is
/// resident.
pub fn surround(
    table: &NodeTable,
    lattice: &Lattice,
    view: &View,
    options: &Options,
    surroundings: &Surroundings,
    residency: &impl Residency,
    selection: &mut Selection,
) {
    let picture = selection.wanted.iter().copied().zip(selection.prefixes.iter().copied());
    let picture: HashMap<u32, usize> = picture.collect();
    let nearest = median_distance(table, lattice, view, selection).max(view.near);
    let bytes_left = options.bytes_budget.saturating_sub(selection.counters.bytes_wanted);
    let mut walk = Walk {
        table,
        lattice,
        view,
        residency,
        target: options.target_spacing_px * surroundings.coarseness.max(0.0) / view.focal_px(),
        repeats_points: options.target_spacing_px <= 0.0,
        nearest,
        picture,
        points_left: surroundings.points_budget,
        bytes_left: surroundings.bytes_budget.min(bytes_left),
        open: BinaryHeap::new(),
        selection,
    };
    let above = Above { spacing: f64::INFINITY, drawn_spacing: f64::INFINITY, is_resident: true };
    table.roots().for_each(|root| walk.open(root, above));
    while let Some(candidate) = walk.open.pop() {
        walk.visit(&candidate);
    }
}

/// The octree of a picture and its surroundings, for the radii of splats that light meets: entry
/// `i` belongs to `drawn[i]`, the entries behind those to the nodes of `surroundings`.
///
/// It differs from the octree of the picture: nodes that are seen edge-on have the distance of
/// their points, not the shorter one that fills the picture ([`Drawn::effective_spacing`]), because
/// light comes from all sides.
///
/// # Panics
/// If the selection names a node that is not in the table.
pub fn light_octree(table: &NodeTable, selection: &Selection) -> CompactOctree {
    let nodes = &table.nodes;
    let mut known: HashMap<u32, f64> = HashMap::new();
    let face_on = selection.drawn.iter().map(|drawn| {
        let node = &nodes[drawn.node as usize];
        let above = nodes.get(node.parent as usize);
        let share = share_continued(node, above);
        let own = effective_spacing(node, node.points(), drawn.prefix, 1.0, share);
        let is_below = above.is_some() && node.parent < drawn.node;
        let limit = is_below.then(|| finest_down_to(nodes, &mut known, node.parent));
        Drawn { effective_spacing: own.min(limit.unwrap_or(f64::INFINITY)) as f32, ..*drawn }
    });
    let cells: Vec<Drawn> = face_on.chain(selection.surroundings.iter().copied()).collect();
    CompactOctree::new(table, &cells)
}

/// Least spacing of a node and its ancestors. `known` keeps the results.
fn finest_down_to(nodes: &[Node], known: &mut HashMap<u32, f64>, node: u32) -> f64 {
    let (mut chain, mut next) = (Vec::new(), Some(node));
    let mut least = f64::INFINITY;
    while let Some(node) = next {
        if let Some(&above) = known.get(&node) {
            least = above;
            break;
        }
        chain.push(node);
        // Links that do not go up the tree are not followed.
        next = Some(nodes[node as usize].parent).filter(|&parent| parent < node);
    }
    while let Some(node) = chain.pop() {
        least = least.min(spacing(&nodes[node as usize]));
        known.insert(node, least);
    }
    least
}

/// Median distance of the eye to the wanted points of the picture, by the contours of their nodes;
/// 0 without points.
fn median_distance(
    table: &NodeTable,
    lattice: &Lattice,
    view: &View,
    selection: &Selection,
) -> f64 {
    let wanted = selection.wanted.iter().zip(&selection.prefixes);
    let mut seen: Vec<(f64, usize)> = wanted
        .filter(|&(_, &prefix)| prefix > 0)
        .map(|(&node, &prefix)| {
            let contour = OrientedBox::of_contour(&table.nodes[node as usize], lattice);
            (contour.distance(view.eye), prefix)
        })
        .collect();
    seen.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let half = seen.iter().map(|&(_, points)| points).sum::<usize>() / 2;
    let mut below = 0;
    let middle = seen.iter().find(|&&(_, points)| {
        below += points;
        below > half
    });
    middle.map_or(0.0, |&(distance, _)| distance)
}

/// What the ancestors of a node have in its place.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Above {
    /// Spacing of their points, if all of them are drawn; infinite above roots.
    spacing: f64,
    /// Spacing of those that are resident; infinite if none is.
    drawn_spacing: f64,
    /// Whether all of them are resident.
    is_resident: bool,
}

/// A node whose parent is wanted whole.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Candidate {
    /// Spacing of its ancestors' points over their distance.
    coarse: f64,
    node: u32,
    /// Its index in the file, which does not depend on what is known of the table.
    index: u32,
    above: Above,
}

impl Candidate {
    fn key(&self) -> (u64, Reverse<u32>) {
        // Bits of non-negative floats sort as the floats do.
        (self.coarse.max(0.0).to_bits(), Reverse(self.index))
    }
}

impl Eq for Candidate {}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.key().cmp(&other.key())
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

struct Walk<'a, R> {
    table: &'a NodeTable,
    lattice: &'a Lattice,
    view: &'a View,
    residency: &'a R,
    /// Spacing over distance that is fine enough.
    target: f64,
    /// Whether points that coincide with others are wanted.
    repeats_points: bool,
    /// Least distance that counts.
    nearest: f64,
    /// Wanted nodes of the picture and their numbers of points.
    picture: HashMap<u32, usize>,
    points_left: u64,
    bytes_left: u64,
    open: BinaryHeap<Candidate>,
    selection: &'a mut Selection,
}

impl<R: Residency> Walk<'_, R> {
    /// Makes a node a candidate, unless its ancestors are fine enough in its place.
    fn open(&mut self, node: u32, above: Above) {
        if self.residency.rejects_subtree(node) {
            return;
        }
        let coarse = above.spacing / self.distance(node, above.spacing);
        if above.spacing.is_infinite() || coarse > self.target {
            let index = self.table.index_in_file(node);
            self.open.push(Candidate { coarse, node, index, above });
        }
    }

    /// Distance of the eye to the points of a node and below it, or less; `spacing` is that of its
    /// parent.
    fn distance(&mut self, node: u32, spacing: f64) -> f64 {
        let mut lacking = Vec::new();
        let eye = self.view.eye;
        let distance = subtree::distance(self.table, self.lattice, node, eye, &mut lacking);
        let distance = distance.max(self.nearest);
        let spacing_px = spacing / distance * self.view.focal_px();
        let lacking = lacking.into_iter().map(|node| Lacking { node, spacing_px });
        self.selection.lacking.extend(lacking);
        distance
    }

    /// Takes a candidate that the picture has not taken, and opens the children of whole nodes.
    fn visit(&mut self, candidate: &Candidate) {
        let Candidate { node: index, above, .. } = *candidate;
        let node = &self.table.nodes[index as usize];
        let repeats = node.is_continuation() && node.cell_log2 == 0;
        if repeats && !self.repeats_points {
            return;
        }
        let count = node.points();
        let in_picture = self.picture.get(&index).copied();
        let (points, is_taken) = match in_picture.filter(|&points| points > 0) {
            Some(points) => (points, true),
            None => {
                let points = count.min(self.residency.points_max(index));
                (points, self.take(candidate, node, points, in_picture.is_some()))
            }
        };
        // A filter may leave no point of a node and some of its children.
        if is_taken && (points == count || points == 0) {
            let own = spacing(node).min(above.spacing);
            let is_resident = above.is_resident && self.residency.is_resident(index);
            let draws = is_resident && points > 0;
            let drawn_spacing = if draws { own } else { above.drawn_spacing };
            if node.lacks_children() {
                let apart = own / self.distance(index, above.spacing);
                let spacing_px = apart * self.view.focal_px();
                self.selection.lacking.push(Lacking { node: index, spacing_px });
            }
            self.open_children(index, Above { spacing: own, drawn_spacing, is_resident });
        }
    }

    /// Wants `points` points of a node, if they are within the budgets, and draws the node if it is
    /// resident. `is_wanted`: the picture wants it for its children. Returns whether it is wanted.
    fn take(&mut self, candidate: &Candidate, node: &Node, points: usize, is_wanted: bool) -> bool {
        let Candidate { node: index, above, .. } = *candidate;
        let bytes = if is_wanted { 0 } else { self.residency.slot_bytes(index) };
        let counters = &mut self.selection.counters;
        if points as u64 > self.points_left || bytes > self.bytes_left {
            counters.surroundings_withheld += 1;
            return false;
        }
        self.points_left -= points as u64;
        self.bytes_left -= bytes;
        counters.bytes_wanted = counters.bytes_wanted.saturating_add(bytes);
        let is_resident = self.residency.is_resident(index);
        if !is_wanted {
            self.selection.wanted.push(index);
            self.selection.prefixes.push(points);
            if !is_resident {
                let missing = self.missing(candidate, node, points, bytes);
                self.selection.missing.push(missing);
            }
        }
        if is_resident && above.is_resident && points > 0 {
            let parent = self.table.nodes.get(node.parent as usize);
            let share = share_continued(node, parent);
            let spacing = effective_spacing(node, node.points(), points, 1.0, share);
            let effective_spacing = spacing.min(above.spacing) as f32;
            let drawn = Drawn { node: index, prefix: points, effective_spacing };
            self.selection.surroundings.push(drawn);
            self.selection.counters.surroundings += 1;
            self.selection.counters.surroundings_points += points as u64;
        }
        true
    }

    fn missing(
        &mut self,
        candidate: &Candidate,
        node: &Node,
        prefix: usize,
        bytes: u64,
    ) -> Missing {
        let distance = OrientedBox::of_contour(node, self.lattice).distance(self.view.eye);
        let apart =
            candidate.above.drawn_spacing / self.distance(candidate.node, candidate.above.spacing);
        let spacing_px = apart * self.view.focal_px();
        Missing { node: candidate.node, prefix, distance, spacing_px, bytes }
    }

    fn open_children(&mut self, index: u32, above: Above) {
        let table = self.table;
        for child in children_below(table, index) {
            self.open(child, above);
        }
    }
}
