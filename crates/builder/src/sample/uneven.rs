//! Arranges the points of a leaf whose density is uneven in nodes of their own, coarse local
//! spacings first. A node has one spacing, from which follow how many of its points a view draws
//! and how wide they are. Where the distances of points differ too much for that, the leaf becomes
//! a small octree: an uneven cell takes an even sample that holds its sparse parts whole, and the
//! cells below it hold the rest, down to cells that are even. See docs/design/building.md.

use crate::attributes::knn::Query;
use crate::attributes::knn_index::KnnIndex;
use crate::sample::turns::{LAST_TURN, radius_at};
use crate::sample::unevenness::{
    BETWEEN_AREA, DENSE_SHARE, JUMP_POINTS, SPARSE_AREA, SPARSE_AREA_OF_CELLS, UNEVEN, Unevenness,
    median,
};
use esker_points::Cell;
use std::ops::Range;

/// Distances beyond this multiple of the median, and below its inverse, are uneven in a cell of an
/// uneven leaf.
const CELL_UNEVEN: f32 = 3.0;
/// Least number of points that are farther apart in an uneven cell. Fewer cross a border of
/// densities and go into the densest node around.
const CELL_SPARSE_POINTS: usize = 12;
/// Cells with at most this many points are not divided, and a sample has at least as many.
const NODE_POINTS: usize = 256;
/// Remaining points of an octant that are not worth a node.
const FEW: usize = 32;
/// Radius of a sample over the typical distance of the sparse half of its cell: all of the sparse
/// points are in the sample.
pub const SAMPLE_RADIUS: f32 = 0.5;
/// Edge of the square of a point in a thinned sample, over the radius of thinning.
const SQUARE_EDGE: f64 = 1.15;
/// Radii up to this multiple of the spacing shrink as finer nodes are drawn around a point
/// ([`esker_points::quant::SCALED_CODE_MAX`]).
pub const RELATIVE_MAX: f64 = 8.0;
/// Greatest distance of a point of an inner node over the spacing that is drawn around it. Where it
/// is greater, the point goes into a finer node.
const REFINED_MAX: f64 = 3.0;
/// Range of the radii of other points of inner nodes, in the spacing that is drawn around them.
/// They close the sample where only that is drawn, and are not much wider than that takes.
const REFINED_RADII: [f64; 2] = [0.7, 1.75];
/// Neighbours whose distance bounds a radius. On a surface the sixth is 1.4 times the local spacing
/// away, at a border twice.
const NEIGHBOURS: usize = 6;
/// Local spacing over the distance of the last of [`NEIGHBOURS`], on a surface.
const SPACING_OF_NEIGHBOURS: f32 = 0.72;
/// The same for a point beside a border, which has no neighbours on one side.
const SPACING_AT_BORDER: f32 = 0.85;
/// Distance of a point to the nearest one, over the local spacing of those around, from which on it
/// is not one of them: it lies in a sparse part, beside a dense one. Of random points at the border
/// of a dense part, one in a million is as far from the others.
const APART: f32 = 3.0;
/// Local spacing of a point over the median of an even cell, from which on it is not one of its
/// points.
const FAR: f32 = 2.0;
/// Search of the nearest points; the reach exceeds the lattice.
const QUERY: Query = Query { count: NEIGHBOURS, count_max: NEIGHBOURS, reach: 1e12 };
/// Distances that are not searched.
const UNKNOWN: [f32; 2] = [0.0, f32::INFINITY];
/// No node.
const NONE: u32 = u32::MAX;
/// A node above the leaf.
const ABOVE: u32 = u32::MAX - 1;

/// The points of a leaf, along the Morton curve.
pub struct Leaf<'a> {
    /// Lattice coordinates.
    pub positions: Vec<[u32; 3]>,
    /// Turns of thinning.
    pub turns: &'a [u16],
    /// Local spacing by octree cells, in the file's unit; 0 where it is unknown.
    pub radii: &'a [f32],
    /// Length of a step on each axis, in the file's unit.
    pub scale: [f64; 3],
    /// Most points of a node.
    pub capacity: usize,
    /// Whether the leaf is part of a larger tree.
    pub is_part: bool,
    /// Turns of points that a cell above has taken, [`LAST_TURN`] for others; empty if there are
    /// none.
    pub taken: &'a [u16],
    /// Spacing of the sample above, in the file's unit; infinite if there is none.
    pub above: f64,
}

/// A node of an uneven leaf.
pub struct Arranged {
    /// Its cell.
    pub cell: Cell,
    /// All points of the leaf in its cell.
    pub range: Range<usize>,
    /// Its own points, along the curve.
    pub points: Vec<u32>,
    /// Index of its parent; `None` for the first node.
    pub parent: Option<usize>,
    /// Typical distance of points with all of its own drawn, in the file's unit.
    pub spacing: f64,
    children: Vec<usize>,
}

/// The nodes of an uneven leaf, parents first and siblings in Morton order.
pub struct Arrangement {
    /// Nodes.
    pub nodes: Vec<Arranged>,
    /// Radius of each point, in the file's unit.
    pub radii: Vec<f32>,
    /// Points that cells above must not take, ascending: one of each node, which links those above
    /// and below it, and points that would be drawn too narrow among those of dense parts.
    pub withheld: Vec<u32>,
}

impl Leaf<'_> {
    /// Whether the density is uneven. Cells at the rim of a scan seem sparse, so the exact
    /// distances of the points that seem far apart decide.
    pub fn is_uneven(&self) -> bool {
        let by_cells = Unevenness::of(self.radii);
        // Few points beside a dense part have no known spacing by cells.
        let unknown = self.radii.iter().filter(|&&radius| radius == 0.0).count();
        let may_jump = self.is_part && (by_cells.sparse + unknown >= JUMP_POINTS);
        let mut known: Vec<f32> = self.radii.iter().copied().filter(|&r| r > 0.0).collect();
        if known.is_empty() || !may_jump && !by_cells.is_great(SPARSE_AREA_OF_CELLS) {
            return false;
        }
        let far = median(&mut known) * UNEVEN;
        let exact = Unevenness::of(&self.spacings_beyond(far));
        exact.is_great(SPARSE_AREA) || self.is_part && exact.is_jump(BETWEEN_AREA)
    }

    /// Local spacings of all points, exact where they are unknown by cells or beyond `far`. In a
    /// part of a tree those of lone points beyond `far` are 0.
    pub fn spacings_beyond(&self, far: f32) -> Vec<f32> {
        let index = self.index();
        let (_, place_of) = &index;
        let mut is_far = vec![false; place_of.last().map_or(0, |&last| last as usize + 1)];
        for (&place, &radius) in place_of.iter().zip(self.radii) {
            is_far[place as usize] |= radius > far || radius == 0.0;
        }
        let near = self.near(&index, |place| is_far[place]);
        let mut local = self.local_spacings(&index, &near);
        if self.is_part {
            let is_alone = alone(&index, &local, |i| local[i] > far);
            local.iter_mut().zip(is_alone).filter(|(_, a)| *a).for_each(|(l, _)| *l = 0.0);
        }
        local
    }

    /// Points that are far from others which are close to each other, by their indices.
    pub fn apart(&self) -> Vec<u32> {
        let mut known: Vec<f32> = self.radii.iter().copied().filter(|&r| r > 0.0).collect();
        if known.is_empty() {
            return Vec::new();
        }
        let far = median(&mut known) * FAR;
        let whole = Leaf { is_part: false, positions: self.positions.clone(), ..*self };
        let local = whole.spacings_beyond(far);
        (0..).zip(&local).filter(|(_, local)| **local > far).map(|(i, _)| i).collect()
    }

    /// Arranges the points; `None` if the density is even.
    pub fn arrange(&self) -> Option<Arrangement> {
        if !self.is_uneven() {
            return None;
        }
        let index = self.index();
        let near = self.near(&index, |_| true);
        let local = self.local_spacings(&index, &near);
        let mut home = vec![NONE; self.positions.len()];
        let taken = |(_, turn): &(_, &u16)| **turn != LAST_TURN;
        home.iter_mut().zip(self.taken).filter(taken).for_each(|(home, _)| *home = ABOVE);
        let mut work = Work { leaf: self, local, home, nodes: Vec::new() };
        // Depth first, so that a node comes before those below it; siblings are pushed in reverse.
        let mut open = vec![(0..self.positions.len(), None)];
        while let Some((range, parent)) = open.pop() {
            work.open(range, parent, &mut open);
        }
        work.widen_apart(&index, &near);
        work.bound_strays(&index);
        let moved = work.refine();
        Some(work.finish(moved))
    }

    fn index(&self) -> (KnnIndex, Vec<u32>) {
        let mut places: Vec<[u32; 3]> = Vec::with_capacity(self.positions.len());
        let mut place_of = Vec::with_capacity(self.positions.len());
        for &p in &self.positions {
            if places.last() != Some(&p) {
                places.push(p);
            }
            place_of.push(places.len() as u32 - 1);
        }
        (KnnIndex::new(&places, self.scale), place_of)
    }

    /// Distances of each wanted place to the nearest other one and to the last of [`NEIGHBOURS`],
    /// in the file's unit; [`UNKNOWN`] for others.
    fn near(
        &self,
        (index, _): &(KnnIndex, Vec<u32>),
        is_wanted: impl Fn(usize) -> bool + Sync,
    ) -> Vec<[f32; 2]> {
        let distances = |steps: &[[f64; 3]]| {
            let lengths = || steps.iter().map(|step| self.length(step));
            Some([lengths().reduce(f32::min)?, lengths().reduce(f32::max)?])
        };
        index.map(&QUERY, is_wanted, distances, UNKNOWN)
    }

    /// Length of a vector in steps, in the file's unit.
    fn length(&self, step: &[f64; 3]) -> f32 {
        (0..3).map(|axis| (step[axis] * self.scale[axis]).powi(2)).sum::<f64>().sqrt() as f32
    }

    /// Local spacings of all points, in the file's unit: of the octree cell around a point, but
    /// about the distance of the nearest points, since a cell at a border of densities says little.
    fn local_spacings(&self, (_, place_of): &(KnnIndex, Vec<u32>), near: &[[f32; 2]]) -> Vec<f32> {
        let of_point = place_of.iter().zip(self.radii).map(|(&place, &radius)| {
            let [_, far] = near[place as usize];
            let own = far * SPACING_OF_NEIGHBOURS;
            if far.is_infinite() || radius > own / 2.0 { radius.min(far) } else { own }
        });
        of_point.collect()
    }
}

/// An arrangement in progress.
struct Work<'a> {
    leaf: &'a Leaf<'a>,
    /// Local spacing of each point, in the file's unit.
    local: Vec<f32>,
    /// Node of each point: [`NONE`] before it has one.
    home: Vec<u32>,
    nodes: Vec<Arranged>,
}

impl Work<'_> {
    /// Makes a node of the points in `range` that have none, or of an even sample of them, and
    /// opens the cells of the rest.
    fn open(
        &mut self,
        range: Range<usize>,
        parent: Option<usize>,
        open: &mut Vec<(Range<usize>, Option<usize>)>,
    ) {
        let mut left: Vec<usize> = range.clone().filter(|&i| self.home[i] == NONE).collect();
        if left.is_empty() {
            return;
        }
        let at = |i: usize| self.leaf.positions[i];
        // Points that a cell above has taken are drawn as fine as those around them.
        let mut around = range.clone().filter(|&i| self.home[i] >= ABOVE);
        let first = around.next().unwrap_or(left[0]);
        let last = around.next_back().unwrap_or(first);
        let cell = Cell::enclosing(at(first), at(last));
        let start = range.clone().find(|&i| cell.contains(at(i))).unwrap_or(first);
        let end = range.rev().find(|&i| cell.contains(at(i))).map_or(last, |i| i) + 1;
        let above = parent.map_or(self.leaf.above, |parent| self.nodes[parent].spacing);
        let number = self.nodes.len();
        let sample = self.sample(&cell, start..end, &left);
        let spacing = match sample {
            Some(radius) => {
                left.retain(|&i| radius_at(self.leaf.turns[i]) >= radius);
                let edge = SQUARE_EDGE * radius;
                rms(left.iter().map(|&i| f64::from(self.local[i]).max(edge)), edge)
            }
            None => {
                let mut known: Vec<f32> = left.iter().map(|&i| self.local[i]).collect();
                let median = f64::from(median(&mut known));
                let all = || (start..end).map(|i| f64::from(self.local[i]));
                let is_dense = |&own: &f64| own <= median * f64::from(CELL_UNEVEN);
                // Few sparse points go into this node with radii of their own.
                let takes_all = end - start - all().filter(is_dense).count() >= CELL_SPARSE_POINTS;
                rms(all().filter(|own| takes_all || is_dense(own)), median)
            }
        };
        left.iter().for_each(|&i| self.home[i] = number as u32);
        if let Some(parent) = parent {
            self.nodes[parent].children.push(number);
        }
        self.nodes.push(Arranged {
            cell,
            range: start..end,
            points: Vec::new(),
            parent,
            spacing: spacing.min(above),
            children: Vec::new(),
        });
        if sample.is_some() {
            self.open_octants(&cell, start..end, number, open);
        }
    }

    /// Radius of the sample that a cell takes; `None` if it takes all of the points `left`.
    fn sample(&self, cell: &Cell, range: Range<usize>, left: &[usize]) -> Option<f64> {
        if left.len() <= NODE_POINTS || cell.log2 == 0 {
            return None;
        }
        let mut own: Vec<f32> = left.iter().map(|&i| self.local[i]).collect();
        let median = median(&mut own);
        let dense = own.iter().filter(|&&local| local < median / CELL_UNEVEN).count();
        let mut all: Vec<f32> = self.local[range].to_vec();
        let sparse = all.iter().filter(|&&local| local > median * CELL_UNEVEN).count();
        if sparse < CELL_SPARSE_POINTS && dense * DENSE_SHARE < own.len() {
            return None;
        }
        // The sparse half by area, or, in part of a tree, half of what is sparse.
        if self.leaf.is_part && sparse >= CELL_SPARSE_POINTS {
            all.retain(|&local| local > median * CELL_UNEVEN);
        }
        let coarse = coarser_half(&mut all);
        let radius = f64::from(coarse.unwrap_or(median) * SAMPLE_RADIUS);
        // Neither too few points nor more than a node holds.
        let mut turns: Vec<u16> = left.iter().map(|&i| self.leaf.turns[i]).collect();
        turns.sort_unstable();
        let of = |rank: usize| turns.get(rank).map(|&turn| radius_at(turn));
        let radius = radius.min(of(NODE_POINTS - 1).unwrap_or(radius));
        // Of a turn either all points are in the sample or none.
        let radius = match of(self.leaf.capacity) {
            Some(least) if radius <= least => least * 1.0001,
            _ => radius,
        };
        let taken = |radius: f64| turns.partition_point(|&turn| radius_at(turn) >= radius);
        // Where the dense part is the larger one, a few points link to the cells below.
        let all = turns.len();
        let radius = if taken(radius) < all { radius } else { of(NODE_POINTS - 1)? };
        (0 < taken(radius) && taken(radius) < all).then_some(radius)
    }

    /// Opens the octants of a cell that have points left. Few points of an octant stay in the node.
    fn open_octants(
        &mut self,
        cell: &Cell,
        range: Range<usize>,
        number: usize,
        open: &mut Vec<(Range<usize>, Option<usize>)>,
    ) {
        let mut start = range.start;
        let mut octants = Vec::with_capacity(8);
        for octant in 0..8 {
            let of_octant = |&i: &usize| cell.octant(self.leaf.positions[i]) == octant;
            let end = start + (start..range.end).take_while(of_octant).count();
            octants.push(start..end);
            start = end;
        }
        for octant in octants.into_iter().rev() {
            let left: Vec<usize> = octant.clone().filter(|&i| self.home[i] == NONE).collect();
            if left.len() > FEW {
                open.push((octant, Some(number)));
            } else {
                left.into_iter().for_each(|i| self.home[i] = number as u32);
            }
        }
    }

    /// Widens points of sparse parts that lie beside dense ones: their nearest points are at the
    /// border, but their discs close the surface on the other side. Their spacing is that in the
    /// even sample that they belong to.
    fn widen_apart(&mut self, (index, place_of): &(KnnIndex, Vec<u32>), near: &[[f32; 2]]) {
        let mut local = vec![0.0; near.len()];
        place_of.iter().zip(&self.local).for_each(|(&place, &own)| local[place as usize] = own);
        let is_apart = index.map_placed(
            &QUERY,
            // Others have neighbours all around.
            |place| near[place][0] * 2.0 > near[place][1],
            |place, found| {
                let mut around: Vec<f32> =
                    found.places.iter().map(|&other| local[other as usize]).collect();
                Some(!around.is_empty() && near[place][0] > APART * median(&mut around))
            },
            false,
        );
        let mut samples: Vec<Vec<u32>> = vec![Vec::new(); self.nodes.len()];
        for (i, &home) in (0u32..).zip(&self.home) {
            if home == ABOVE {
                // It is part of all even samples around it.
                let mut around = (!self.nodes.is_empty()).then_some(0);
                while let Some(node) = around {
                    samples[node].push(i);
                    around = self.child_around(i as usize, node);
                }
            }
            let Some(node) = self.nodes.get(home as usize) else { continue };
            let is_inner = !node.children.is_empty();
            if is_inner {
                samples[home as usize].push(i);
            } else if is_apart[place_of[i as usize] as usize]
                && let Some(parent) = node.parent
            {
                samples[parent].push(i);
            }
        }
        for sample in samples {
            let is_wide = |&i: &u32| is_apart[place_of[i as usize] as usize];
            if !sample.iter().any(is_wide) {
                continue;
            }
            let positions = sample.iter().map(|&i| self.leaf.positions[i as usize]).collect();
            let part = Leaf { positions, ..*self.leaf };
            let (index, places) = part.index();
            let near = part.near(&(index, Vec::new()), |_| true);
            for (&i, &place) in sample.iter().zip(&places).filter(|(i, _)| is_wide(i)) {
                let spacing = near[place as usize][1] * SPACING_AT_BORDER;
                self.local[i as usize] = self.local[i as usize].max(spacing);
            }
        }
    }

    /// Node of the smallest cell around a point, from its own node downwards.
    fn finest(&self, i: usize, mut node: usize) -> usize {
        while let Some(below) = self.child_around(i, node) {
            node = below;
        }
        node
    }

    fn child_around(&self, i: usize, node: usize) -> Option<usize> {
        let contains = |&&child: &&usize| self.nodes[child].cell.contains(self.leaf.positions[i]);
        self.nodes[node].children.iter().find(contains).copied()
    }

    /// Moves sparse points out of nodes whose radii shrink with what is drawn below: into the first
    /// node beside whose spacing their radii are so wide that they stay, else into the finest.
    /// Returns them, ascending.
    fn refine(&mut self) -> Vec<u32> {
        let mut moved = Vec::new();
        let mut counts = vec![0usize; self.nodes.len()];
        let own = |home: u32| (home as usize) < self.nodes.len();
        self.home.iter().filter(|&&home| own(home)).for_each(|&home| counts[home as usize] += 1);
        for i in 0..self.home.len() {
            let mut node = self.home[i] as usize;
            if node >= self.nodes.len() {
                continue;
            }
            let local = f64::from(self.local[i]);
            let finest = self.finest(i, node);
            let stays = |node: usize| {
                node == finest
                    || local <= REFINED_MAX * self.nodes[finest].spacing
                    || local > RELATIVE_MAX * self.nodes[node].spacing
            };
            // A node without points could not link those above and below it.
            let from = node;
            while !stays(node) && counts[from] > 1 {
                let Some(below) = self.child_around(i, node) else { break };
                node = below;
            }
            counts[from] -= 1;
            counts[node] += 1;
            self.home[i] = node as u32;
            if node != from {
                moved.push(i as u32);
            }
        }
        moved
    }

    /// Bounds the radii of points that are far from others which are not as far from each other: a
    /// lone point must not become a blob.
    fn bound_strays(&mut self, index: &(KnnIndex, Vec<u32>)) {
        // A point beside a denser part belongs to the sample above that.
        let most = |i: usize| {
            let node = self.nodes.get(self.home[i] as usize)?;
            let node = node.parent.map_or(node, |parent| &self.nodes[parent]);
            Some((RELATIVE_MAX * node.spacing) as f32)
        };
        let is_wide: Vec<bool> = (0..self.local.len())
            .map(|i| most(i).is_some_and(|most| self.local[i] > most))
            .collect();
        if !is_wide.contains(&true) {
            return;
        }
        let is_alone = alone(index, &self.local, |i| is_wide[i]);
        for (i, _) in is_alone.into_iter().enumerate().filter(|(_, is_alone)| *is_alone) {
            if let Some(most) = most(i) {
                self.local[i] = most;
            }
        }
    }

    fn finish(mut self, mut withheld: Vec<u32>) -> Arrangement {
        let mut radii = Vec::with_capacity(self.local.len());
        let [least, most] = REFINED_RADII;
        for i in 0..self.local.len() {
            let local = f64::from(self.local[i]);
            let node = self.home[i] as usize;
            let Some(own) = self.nodes.get(node).map(|node| node.spacing) else {
                radii.push(0.0);
                continue;
            };
            let finest = self.finest(i, node);
            let is_relative = finest != node && local <= RELATIVE_MAX * own;
            let drawn = local / self.nodes[finest].spacing;
            let radius = if is_relative { drawn.clamp(least, most) * own } else { local };
            radii.push(radius as f32);
            self.nodes[node].points.push(i as u32);
        }
        let last = |node: &Arranged| {
            node.points.iter().copied().max_by_key(|&i| self.leaf.turns[i as usize])
        };
        withheld.extend(self.nodes.iter().filter_map(last));
        withheld.sort_unstable();
        withheld.dedup();
        Arrangement { nodes: self.nodes, radii, withheld }
    }
}

/// Whether each wanted point is far from others which are not as far from each other, by the local
/// spacings of all.
fn alone(
    (index, place_of): &(KnnIndex, Vec<u32>),
    local: &[f32],
    is_wanted: impl Fn(usize) -> bool,
) -> Vec<bool> {
    let places = place_of.last().map_or(0, |&last| last as usize + 1);
    let (mut wanted, mut of_place) = (vec![false; places], vec![0.0; places]);
    for (i, &place) in place_of.iter().enumerate() {
        wanted[place as usize] |= is_wanted(i);
        of_place[place as usize] = local[i];
    }
    let is_alone = index.map_placed(
        &QUERY,
        |place| wanted[place],
        |place, found| {
            let is_alike = |&&other: &&u32| of_place[other as usize] * UNEVEN >= of_place[place];
            Some(found.places.iter().filter(is_alike).count() * 2 < NEIGHBOURS)
        },
        false,
    );
    (0..local.len()).map(|i| is_wanted(i) && is_alone[place_of[i] as usize]).collect()
}

/// Local spacing above which are those of half of the area that points cover.
pub fn coarser_half(local: &mut [f32]) -> Option<f32> {
    local.sort_unstable_by(f32::total_cmp);
    let area = |local: &f32| f64::from(*local).powi(2);
    let mut half = local.iter().map(area).sum::<f64>() / 2.0;
    let coarse = local.iter().rev().find(|local| {
        half -= area(local);
        half <= 0.0
    });
    coarse.copied()
}

/// Root of the mean square of lengths; `none` if there are none.
fn rms(lengths: impl Iterator<Item = f64>, none: f64) -> f64 {
    let (count, sum) = lengths.fold((0u32, 0.0), |(n, sum), length| (n + 1, sum + length * length));
    if count > 0 { (sum / f64::from(count)).sqrt() } else { none }
}

#[cfg(test)]
mod tests;
