//! Builds the octree bottom-up (after `kanzok2015`, section 3.1): a leaf offers all of its points,
//! a larger cell an even sample of what its children offer; the children lose the points it takes.
//! A node is finished, and its page encoded, once the cell above has taken its share. A small leaf
//! gives the rest of its points to the node above. See docs/design/building.md.

use crate::attributes::clips::Clips;
use crate::page::histograms::Counts;
use crate::rows::row::{RowLayout, Rows};
use crate::sample::candidates::Candidates;
use crate::sample::choose::{assign_turns, choose};
use crate::sample::compact::indices_of;
use crate::sample::contour;
use crate::sample::fringe::{self, Offer};
use crate::sample::marks::WireMarks;
use crate::sample::order::{order, parts};
use crate::sample::pending::{Below, PendingCell, ReadyCell};
use crate::sample::shape::{Moments, Shape};
use crate::sample::spacing::{TurnCounts, radii};
use crate::sample::sparse::{self, Sample};
use crate::sample::turns::LAST_TURN;
use crate::sample::uneven::RELATIVE_MAX;
use crate::sample::wires;
use crate::tree::subtree::{Children, Subtree};
use bytemuck::Zeroable;
use esker_format::{NodeStatistics, PageLayout, encode_page};
use esker_points::node::SHAPE_CONTINUATION;
use esker_points::tangents::TANGENT_BYTES;
use esker_points::{Cell, Node, morton, quant};
use std::ops::Range;

/// Largest radius in spacings of the node, so that a lone point does not become a blob; only those
/// of sparse parts are wider.
const RADIUS_SPACINGS_MAX: f64 = RELATIVE_MAX;
/// Largest radius in spacings of the sample above. More than 1, since the spacing is the typical
/// distance in that sample, not the greatest.
const RADIUS_ABOVE_MAX: f64 = 1.5;
/// A cloud of fewer points shows no surface: its points are drawn as dots, with a radius of
/// `DOT_SPACINGS`.
const SURFACE_POINTS: usize = 32;
const DOT_SPACINGS: f64 = 1.0 / 32.0;
/// Small leaves give the rest of their points to the node above, since they are not worth a node.
/// The points given are at most 1 / `GIVEN` of a node's capacity, so that the node stays an even
/// sample.
const GIVEN: usize = 16;
/// Nodes' worth of points up to which a cell is not split.
pub const LEAF_NODES: usize = 2;

/// A child of a cell, and the places of its points among those that all children offer.
pub type Part = (PendingCell, Range<usize>);

/// Settings and sums that all steps of a build share.
pub struct Context {
    /// Layout of the rows.
    pub rows: RowLayout,
    /// Layout of the pages.
    pub pages: PageLayout,
    /// Where rows say that their points are on wires; `None` if none does.
    pub wires: Option<WireMarks>,
    /// Length of a step on each axis, in the file's unit.
    pub scale: [f64; 3],
    /// Source of clip lines, if the file has any.
    pub clips: Option<Clips>,
    /// Largest number of points of a node.
    pub capacity: usize,
    /// Number of points of the tree.
    pub points: u64,
    /// Histograms of the nodes finished so far.
    pub counts: Counts,
}

impl Context {
    /// Makes a cell that is not split, which offers all of its points.
    pub fn leaf(&self, rows: &Rows<'_>, points: Range<u32>, cell: Cell) -> PendingCell {
        PendingCell {
            cell,
            moments: Moments::of(points.clone().map(|i| rows.position(i)), &cell),
            sampled: points.len(),
            offered: points.collect(),
            withheld: Vec::new(),
            apart: Vec::new(),
            least_radius: 0.0,
            turns: Vec::new(),
            radii: Vec::new(),
            shares: Vec::new(),
            below: Below::default(),
        }
    }

    /// Number of points up to which a cell is not split. What the cells above leave of them may
    /// exceed the capacity of a node; further nodes then continue it.
    pub fn leaf_points_max(&self) -> usize {
        self.capacity * LEAF_NODES
    }

    /// Makes a cell of coincident points that exceed the limit of a leaf. As many as a node holds
    /// are offered; nodes that continue the leaf hold the rest.
    pub fn coincident(&self, rows: &Rows<'_>, points: Range<u32>, cell: Cell) -> PendingCell {
        let first = points.start + self.capacity as u32;
        let mut head = self.leaf(rows, points.start..first, cell);
        head.below = Below::Coincident(first..points.end);
        head.moments = Moments::of(points.map(|i| rows.position(i)), &cell);
        head
    }

    /// Cuts `rows` into ranges of a node's capacity.
    fn nodeful(&self, rows: Range<u32>) -> impl DoubleEndedIterator<Item = Range<u32>> {
        let capacity = self.capacity as u32;
        rows.clone()
            .step_by(self.capacity)
            .map(move |i| i..rows.end.min(i.saturating_add(capacity)))
    }

    /// Finishes a node that continues the one above it in the same cell. Returns it with the
    /// moments of its points.
    pub fn continuation(
        &self,
        rows: &Rows<'_>,
        pending: PendingCell,
        counts: &Counts,
    ) -> Option<(Moments, Subtree)> {
        let moments = pending.moments;
        let mut node = self.finish(rows, pending, &[], None, counts)?;
        node.node.shape |= SHAPE_CONTINUATION;
        Some((moments, node))
    }

    /// Makes a cell of its children by taking an even sample of the points that they offer. The
    /// children are ready to be finished, but are not finished here.
    pub fn combine(&self, rows: &Rows<'_>, cell: Cell, children: Vec<PendingCell>) -> PendingCell {
        let mut moments = Moments::default();
        children.iter().for_each(|c| moments.merge(&c.moments));
        let mut offered = Vec::with_capacity(children.iter().map(|c| c.offer_count()).sum());
        children.iter().for_each(|c| offered.extend(c.offers()));
        let candidates = Candidates::new(rows, &offered, &cell, self.scale, self.wires);
        let turns_below = PendingCell::turns_below(&children, offered.len());
        // Room is left beside the sample for the points that small cells give.
        let (few, given_max) = self.few(&children);
        // The sample is never larger than those it is chosen from. Otherwise its spacing would be
        // finer than that of the cells below. Those whose sparse parts bound their spacing bound it
        // here, too.
        let least_below = children.iter().map(|c| c.least_radius).fold(0.0, f64::max);
        let counts = |c: &&PendingCell| !c.is_leaf() && c.least_radius == 0.0;
        let samples = children.iter().filter(counts).map(|c| c.sampled);
        let points = samples.chain([self.capacity - given_max]).min().unwrap_or(1);
        let shape = Shape::of(moments.covariance(self.scale));
        let dimension = shape.dimension_of(points.min(candidates.places()));
        let mut turns = choose(&candidates, &turns_below, points, self.edge(&cell), dimension);
        let shares = PendingCell::shares(&children, offered.len());
        let mut parts = Vec::with_capacity(children.len());
        let mut start = 0;
        for child in children {
            let part = start..start + child.offer_count();
            start = part.end;
            // A child with nodes below keeps a point of its own: a node without points cannot link
            // the node above to those below.
            let own = &mut turns[part.clone()];
            if child.has_below()
                && own.iter().all(|turn| *turn != LAST_TURN)
                && let Some(first) = own.first_mut()
            {
                *first = LAST_TURN;
            }
            parts.push((child, part));
        }
        // Radii of samples right above leaves are not narrowed: that would take three times as long
        // for half as many radii, none of which is as far off.
        let is_high = parts.iter().any(|(child, _)| !child.is_leaf());
        let count = moments.count as usize;
        let mut sample = self.sample(&candidates, &turns, dimension, (count, is_high));
        let positions = sample.chosen.iter().map(|&i| rows.position(offered[i as usize]));
        let least_radius = sparse::least_radius(&sample, positions, self.scale).max(least_below);
        if least_radius > 0.0 {
            sparse::unpick(&mut turns, least_radius);
            sample = self.sample(&candidates, &turns, dimension, (count, is_high));
            let positions = sample.chosen.iter().map(|&i| rows.position(offered[i as usize]));
            let local = sparse::spacings(&sample, positions.collect(), self.scale);
            self.leave_apart(rows, (&mut parts, &few, &mut turns), (&sample.chosen, &local));
            sample = self.sample(&candidates, &turns, dimension, (count, is_high));
        }
        let Sample { chosen, turns: own, radii, spacing: above } = sample;
        let mut pending = PendingCell {
            cell,
            moments,
            offered: chosen.iter().map(|&i| offered[i as usize]).collect(),
            sampled: chosen.len(),
            withheld: Vec::new(),
            apart: Vec::new(),
            least_radius,
            turns: own,
            radii,
            shares: Vec::new(),
            below: Below::default(),
        };
        let shares = match least_radius {
            0.0 => self.shares(&candidates, shares, &parts, (&few, &turns), above),
            _ => self.exact_shares(rows, shares, &parts, (&few, &turns), above),
        };
        drop(candidates);
        if !shares.is_empty() {
            pending.shares = chosen.iter().map(|&i| shares[i as usize]).collect();
            pending.narrow(above);
        }
        let mut few = few.into_iter();
        for (child, part) in parts.extract_if(.., |_| few.next() == Some(true)) {
            let shares = shares.get(part.clone()).unwrap_or_default();
            self.give(rows, child, (&turns[part], shares), above, &mut pending);
        }
        let parts = parts.into_iter();
        let ready = parts.map(|(pending, part)| {
            let taken = pending.taken(&turns[part]);
            ReadyCell { pending, taken, above }
        });
        pending.below = Below::Ready(ready.collect());
        pending
    }

    /// The points that have a turn, of a cell of `count` points.
    fn sample(
        &self,
        candidates: &Candidates,
        turns: &[u16],
        dimension: u32,
        (count, is_high): (usize, bool),
    ) -> Sample {
        let chosen = indices_of(turns, |&turn| turn != LAST_TURN);
        let own: Vec<u16> = chosen.iter().map(|&i| turns[i as usize]).collect();
        let spacing = self.spacing(&TurnCounts::of(&own), [chosen.len(), count], dimension, None);
        let radii = self.radii(candidates, turns, dimension, (|| spacing, is_high));
        Sample { chosen, turns: own, radii, spacing }
    }

    /// Finishes the nodes below a cell that wait for no others: coincident points that continue it.
    pub fn nodes_below(
        &self,
        rows: &Rows<'_>,
        pending: &mut PendingCell,
        counts: &Counts,
    ) -> Children {
        let mut below = Children::default();
        match std::mem::take(&mut pending.below) {
            Below::Finished(children) => below = children,
            Below::Ready(_) | Below::Elsewhere { .. } => (),
            Below::Coincident(rest) => {
                below = self.coincident_below(rows, rest, pending.cell, counts);
            }
        }
        below
    }

    /// Finishes a chain of nodes for rows that coincide with the points of a cell.
    pub fn coincident_below(
        &self,
        rows: &Rows<'_>,
        rest: Range<u32>,
        cell: Cell,
        counts: &Counts,
    ) -> Children {
        let mut below = Children::default();
        for rest in self.nodeful(rest).rev() {
            let leaf = self.leaf(rows, rest, cell);
            if let Some((_, mut node)) = self.continuation(rows, leaf, counts) {
                node.children = std::mem::take(&mut below);
                below.push(node);
            }
        }
        below
    }

    /// Marks the small leaves that fit into the node above, the smallest first; also returns their
    /// number of points.
    fn few(&self, children: &[PendingCell]) -> (Vec<bool>, usize) {
        let mut least: Vec<usize> = (0..children.len())
            .filter(|&i| children[i].is_leaf() && children[i].withheld.is_empty())
            .collect();
        least.sort_by_key(|&i| children[i].sampled);
        let (mut few, mut points) = (vec![false; children.len()], 0);
        for i in least {
            few[i] = (points + children[i].sampled) * GIVEN <= self.capacity;
            points += if few[i] { children[i].sampled } else { 0 };
        }
        (few, points)
    }

    /// Updates `shares`, the shares of radii of the offered points, for the cells in `parts` that
    /// end here. `above` is the spacing of the sample. See [`fringe::shares`].
    fn shares(
        &self,
        candidates: &Candidates,
        mut shares: Vec<f32>,
        parts: &[Part],
        (few, turns): (&[bool], &[u16]),
        above: f64,
    ) -> Vec<f32> {
        let offer = |((child, part), &is_few): (&Part, &bool)| {
            let weight = child.moments.count as f32 / child.sampled as f32;
            Offer { ends: ends(child, is_few, &turns[part.clone()]), weight }
        };
        let offers: Vec<Offer> = parts.iter().zip(few).map(offer).collect();
        if offers.iter().all(|offer| !offer.ends) {
            return shares;
        }
        let from: Vec<u8> =
            (0..).zip(parts).flat_map(|(i, (_, part))| part.clone().map(move |_| i)).collect();
        let own = fringe::shares(candidates, &from, &offers, above);
        shares.resize(own.len(), 1.0);
        shares.iter_mut().zip(own).for_each(|(share, own)| *share *= own);
        shares
    }

    /// Gives the rest of a leaf to the cell above, whose sample has the spacing `above`.
    fn give(
        &self,
        rows: &Rows<'_>,
        mut leaf: PendingCell,
        (taken, shares): (&[u16], &[f32]),
        above: f64,
        to: &mut PendingCell,
    ) {
        let shape = Shape::of(leaf.moments.covariance(self.scale));
        let dimension = self.assign_turns(rows, &mut leaf, taken, Some(above), &shape);
        let drawn = [leaf.sampled, leaf.moments.count as usize];
        let spacing = self.spacing(&leaf.turn_counts(), drawn, dimension, Some(above)) as f32;
        for i in (0..leaf.sampled).filter(|&i| taken[i] == LAST_TURN) {
            to.offered.push(leaf.offered[i]);
            to.turns.push(leaf.turns[i]);
            let radius = if leaf.radii[i] > 0.0 { leaf.radii[i] } else { spacing };
            let share = shares.get(i).copied().unwrap_or(1.0);
            let widest = if share < 1.0 { share * above as f32 } else { widest(above) };
            to.radii.push(radius.min(widest));
        }
    }

    /// Assigns turns and radii to the points of a leaf. Returns the dimension of their shape.
    pub fn assign_turns(
        &self,
        rows: &Rows<'_>,
        leaf: &mut PendingCell,
        taken: &[u16],
        above: Option<f64>,
        shape: &Shape,
    ) -> u32 {
        let candidates = Candidates::new(rows, &leaf.offered, &leaf.cell, self.scale, self.wires);
        let dimension = shape.dimension_of(candidates.places());
        leaf.turns = assign_turns(&candidates, taken, above, self.edge(&leaf.cell), dimension);
        let drawn = [leaf.sampled, leaf.moments.count as usize];
        let spacing = || self.spacing(&leaf.turn_counts(), drawn, dimension, above);
        leaf.radii = self.radii(&candidates, &leaf.turns, dimension, (spacing, false));
        dimension
    }

    /// Finishes the node of a cell; nodes that continue it hold what exceeds the capacity. The cell
    /// above has taken the points that have a turn in `taken`; its sample has the spacing `above`.
    /// Children that are not finished yet are left out. Returns `None` if no point is left, which
    /// happens only to cells without children (see [`Context::combine`]).
    pub fn finish(
        &self,
        rows: &Rows<'_>,
        mut pending: PendingCell,
        taken: &[u16],
        above: Option<f64>,
        counts: &Counts,
    ) -> Option<Subtree> {
        let mut below = self.nodes_below(rows, &mut pending, counts);
        let shape = Shape::of(pending.moments.covariance(self.scale));
        let dimension = if pending.turns.is_empty() {
            let dimension = self.assign_turns(rows, &mut pending, taken, above, &shape);
            let is_uneven = above.is_none() || !pending.withheld.is_empty();
            if is_uneven
                && below.is_empty()
                && let Some(arrangement) = self.arrangement(rows, &pending, taken, above)
            {
                return self.arrange(rows, pending, arrangement, counts);
            }
            dimension
        } else {
            shape.dimension_of(pending.sampled)
        };
        if let Some(above) = above {
            let most = widest(above);
            pending.radii.iter_mut().for_each(|radius| *radius = radius.min(most));
        }
        let mut own = indices_of(taken, |&turn| turn == LAST_TURN);
        own.extend(taken.len() as u32..pending.offered.len() as u32);
        let sampled = pending.sampled;
        let is_given = |i: u32| i as usize >= sampled;
        if pending.offered.len() > pending.sampled {
            own.sort_by_cached_key(|&i| {
                morton::encode3(rows.position(pending.offered[i as usize]))
            });
        }
        let turns: Vec<u16> = own.iter().map(|&i| pending.turns[i as usize]).collect();
        let count = own.len().div_ceil(self.capacity) as u32;
        let part_of = if count > 1 { parts(&turns, count as usize) } else { vec![0; own.len()] };
        let mut drawn = pending.sampled;
        let (picked, total) = (pending.turn_counts(), pending.moments.count as usize);
        let spacing = |drawn| self.spacing(&picked, [drawn, total], dimension, above);
        let full = spacing(drawn);
        if above.is_none() && total < SURFACE_POINTS {
            pending.radii.fill((full * DOT_SPACINGS) as f32);
        } else if above.is_none() {
            self.narrow_uppermost(rows, &mut pending, full);
        }
        let widest = if pending.apart.is_empty() { RADIUS_SPACINGS_MAX } else { quant::RADIUS_MAX };
        for &(i, radius) in &pending.apart {
            pending.radii[i as usize] = pending.radii[i as usize].max(radius);
        }
        for part in (0..count).rev() {
            let of_part = own.iter().zip(&part_of).filter(|(_, p)| **p == part);
            let points: Vec<u32> = of_part.map(|(i, _)| *i).collect();
            let spacing = spacing(drawn);
            drawn -= points.iter().filter(|i| !is_given(**i)).count();
            let spacing = [spacing, full];
            let mut tree = self.node(rows, &pending, &points, dimension, (spacing, widest), counts);
            tree.children = below;
            if part == 0 {
                return Some(tree);
            }
            tree.node.shape |= SHAPE_CONTINUATION;
            below = vec![tree].into();
        }
        None
    }

    /// Computes the radii, in the file's unit, of the offered points that have a turn. Radii that
    /// are wide beside `spacing` are narrowed on wires, and elsewhere if `is_high`: if the cell is
    /// not right above leaves.
    fn radii(
        &self,
        candidates: &Candidates,
        turns: &[u16],
        dimension: u32,
        (spacing, is_high): (impl FnOnce() -> f64, bool),
    ) -> Vec<f32> {
        let turns = candidates.along_curve(turns);
        let is_wanted = || turns.iter().map(|&turn| turn != LAST_TURN);
        let mut steps = radii(&candidates.shared_of(is_wanted()), dimension);
        if is_high || wires::has_any(&candidates.wires) {
            let spacing = spacing() / candidates.step;
            let places = indices_of(&turns, |&turn| turn != LAST_TURN);
            wires::narrow(&mut steps, spacing, &places, candidates);
            if is_high {
                let q = || places.iter().map(|&place| candidates.q[place as usize]).collect();
                fringe::narrow(&mut steps, q, spacing);
            }
        }
        let in_unit = |steps: f32| (f64::from(steps) * candidates.step) as f32;
        candidates.some_as_offered(steps.into_iter().map(in_unit).collect(), is_wanted())
    }

    /// Narrows the radii of the root's sample to the distance of the points around, as those of
    /// other samples above leaves. No sample above bounds them where a surface only grazes a cell.
    fn narrow_uppermost(&self, rows: &Rows<'_>, pending: &mut PendingCell, spacing: f64) {
        let sampled = pending.sampled;
        let candidates =
            Candidates::new(rows, &pending.offered[..sampled], &pending.cell, self.scale, None);
        let in_steps: Vec<f32> =
            pending.radii[..sampled].iter().map(|r| r / candidates.step as f32).collect();
        let mut steps = candidates.along_curve(&in_steps).into_owned();
        fringe::narrow(&mut steps, || candidates.q.clone(), spacing / candidates.step);
        let radii = candidates.as_offered(steps).into_iter().map(|r| r * candidates.step as f32);
        pending
            .radii
            .iter_mut()
            .zip(radii)
            .for_each(|(radius, narrow)| *radius = radius.min(narrow));
    }

    /// Orders some points of a cell as their node has them. `spacing` is that with these points
    /// drawn, `full` that with all points of the cell drawn; radii are at most `widest` spacings.
    /// Returns their rows, their radius codes, and the number of points of each level.
    pub fn ordered(
        &self,
        pending: &PendingCell,
        points: &[u32],
        ([spacing, full], widest): ([f64; 2], f64),
    ) -> (Vec<u32>, Vec<u8>, Vec<usize>) {
        let turns: Vec<u16> = points.iter().map(|&i| pending.turns[i as usize]).collect();
        let order = order(&turns);
        let code = |radius: f32| {
            let spacings = match radius {
                0.0 => 1.0,
                // Wider ones do not change with what else is drawn.
                r if widest > RADIUS_SPACINGS_MAX && f64::from(r) > full * RADIUS_SPACINGS_MAX => {
                    (f64::from(r) / spacing).min(widest)
                }
                r => (f64::from(r) / full).min(RADIUS_SPACINGS_MAX),
            };
            quant::radius_code(spacings * spacing, spacing)
        };
        // Consecutive points mostly have the same radius.
        let mut last = (0.0, code(0.0));
        let along_curve = points.iter().map(|&i| {
            let radius = pending.radii[i as usize];
            if radius != last.0 {
                last = (radius, code(radius));
            }
            last.1
        });
        let along_curve: Vec<u8> = along_curve.collect();
        let codes = order.points.iter().map(|&i| along_curve[i as usize]).collect();
        let row = |&i: &u32| pending.offered[points[i as usize] as usize];
        (order.points.iter().map(row).collect(), codes, order.levels)
    }

    /// Encodes a node of some points of a cell; `spacing` is as for [`Context::ordered`].
    pub(super) fn node(
        &self,
        rows: &Rows<'_>,
        pending: &PendingCell,
        points: &[u32],
        dimension: u32,
        spacing: ([f64; 2], f64),
        counts: &Counts,
    ) -> Subtree {
        let (own, codes, levels) = self.ordered(pending, points, spacing);
        let ([spacing, _], _) = spacing;
        let (mut points, hash) = self.page_points(rows, &own, codes);
        let mut node = Node::zeroed();
        (node.corner, node.cell_log2) = (pending.cell.corner, pending.cell.log2);
        node.shape = dimension as u8;
        node.spacing = spacing as f32;
        node.set_levels(&levels);
        let bounds = set_box(&mut node, &points.positions);
        if let Some(clips) = &self.clips {
            points.clip_lines = clips.words(rows, &own, &self.rows, &node);
        }
        if self.pages.has_tangents() {
            let code = |&i: &u32| {
                let shape = self.rows.shape(rows.row(i));
                shape.map_or([0; TANGENT_BYTES], |shape| shape.code(node.spacing))
            };
            points.tangents = own.iter().map(code).collect();
        }
        let step =
            self.scale.iter().fold(0.0f64, |a, &b| a.max(b)) * f64::from(1u32 << node.hot_shift);
        let sides = contour::enclose(&mut node, &points.positions, self.scale, step);

        let page = encode_page(&self.pages, node.box_min, node.hot_shift, &points);
        let statistics = NodeStatistics::of(&self.pages, &points).with_sides(sides);
        counts.add(&self.pages, &points);
        Subtree { node, page, statistics, hash, bounds, children: Children::default() }
    }

    /// Spacing of the first `drawn` of `total` points of a cell: at most that of the sample above,
    /// never zero.
    fn spacing(
        &self,
        picked: &TurnCounts,
        [drawn, total]: [usize; 2],
        dimension: u32,
        above: Option<f64>,
    ) -> f64 {
        let step = self.scale.iter().fold(f64::INFINITY, |a, &b| a.min(b));
        let own = picked.spacing(drawn, total, dimension);
        let few = picked.points() < 8;
        let spacing = match above {
            Some(above) if few || own > above => above,
            _ => own,
        };
        // Leaves room for multiples below the largest `f32`.
        spacing.clamp(step.max(1e-30), 1e30)
    }

    /// Edge of a cell, in the file's unit, along the axis of the longest steps.
    fn edge(&self, cell: &Cell) -> f64 {
        self.scale.iter().fold(0.0f64, |a, &b| a.max(b)) * cell.edge() as f64
    }
}

/// Whether a cell has no node of its own: it gives its few points to the cell above, or that has
/// taken them all. `turns` are those of the points that it offers.
pub fn ends(cell: &PendingCell, is_few: bool, turns: &[u16]) -> bool {
    let are_taken = || turns.iter().all(|turn| *turn != LAST_TURN);
    is_few || cell.is_leaf() && cell.withheld.is_empty() && are_taken()
}

/// Widest radius of a point that a sample of spacing `above` has not taken. A point of that sample
/// is within its spacing, so a wider disc is not needed to close a surface that crosses a border of
/// cells.
fn widest(above: f64) -> f32 {
    (above * RADIUS_ABOVE_MAX) as f32
}

/// Sets the integer box of a node's own points, of which there is at least one, and returns it.
fn set_box(node: &mut Node, positions: &[[u32; 3]]) -> [[u32; 3]; 2] {
    let (mut min, mut max) = ([u32::MAX; 3], [0; 3]);
    for p in positions {
        for i in 0..3 {
            min[i] = min[i].min(p[i]);
            max[i] = max[i].max(p[i]);
        }
    }
    node.box_min = min;
    let extent = (0..3).map(|i| max[i] - min[i]).max().unwrap_or(0);
    node.hot_shift = quant::hot_shift(extent);
    [min, max]
}
