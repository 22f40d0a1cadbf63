//! Search for the point of a file that a place on a picture shows, in the points of all levels.
//! Cells are visited by their distance from the place in space, nearest first, until no other can
//! hold a nearer point (`hjaltason1999`); then the points about as deep as the shown
//! surface are compared on the picture. Few nodes are read, one at a time, and each of the two
//! passes ends behind [`POINTS_MAX`] points.

use anyhow::Result;
use esker_format::{Forest, ForestFilter, PlaneKind, Planes};
use esker_lod::{OrientedBox, View};
use esker_points::Lattice;
use esker_points::quant::{HIDDEN_AT, HOT_POSITION_BYTES, exact, read_residual};
use glam::{DVec2, DVec3};
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Greatest distance between the shown place and a point that is picked, in widths of a pixel.
pub const REACH_PX: f64 = 12.0;
/// The same in distances of neighbouring points, where these are farther apart: on a closed
/// surface that is seen from nearby there is a point in reach of every pixel.
const REACH_SPACINGS: f64 = 2.0;
/// Depths from that of the shown surface within which points are compared on the picture, in
/// distances of the shown place from its nearest point.
const DEPTHS: f64 = 1.0;
/// Distance from the shown place within which these points are looked for, in the same unit: it
/// holds those that are nearer on the picture than the nearest point. So no point is taken from
/// behind a surface that is thicker than twice the distance of the place from a point of it. Where
/// the nearest point is beside the picture, points are looked for as far as they are picked.
const RADII: f64 = 2.0;
/// Share of the distance of the eye from the origin, and of the depth, that rounding may change.
const ROUNDING: f64 = 16.0 * f64::EPSILON;
/// Number of points behind which a pass ends. Only points at one place are as many.
const POINTS_MAX: usize = 1 << 22;
/// Share of a box's radius by which single-precision bounds may be too narrow.
const BOX_ROUNDING: f64 = 1e-6;

/// A place on a picture, and the place in space that it shows.
#[derive(Clone, Copy, Debug)]
pub struct Aim {
    view: View,
    at: DVec2,
    depth: f64,
    place: DVec3,
    pixel: f64,
}

/// Place of a point on the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Distance from the place that was aimed at, pixels.
    pub offset_px: f64,
    /// Eye depth minus that of the shown surface.
    pub depth_offset: f64,
}

/// A point that was found.
#[derive(Clone, Copy, Debug)]
pub struct Found {
    /// Node in the table of the forest.
    pub node: u32,
    /// Index of the point in its node.
    pub point: usize,
    /// Position on the metric lattice.
    pub position: DVec3,
    /// Place on the picture.
    pub seen: Seen,
}

impl Aim {
    /// Aims at `at` (pixels from the top left corner of the shown picture, without its margin),
    /// where the picture has the eye depth `depth`; `None` if that is not on the picture or not a
    /// depth.
    pub fn new(view: &View, at: DVec2, depth: f64) -> Option<Self> {
        let shown = view.with_margin(0);
        // Surfaces nearer than the near plane have no depth. A parallel view begins at its own.
        let near = if shown.parallel_at.is_some() { shown.near } else { f64::MIN_POSITIVE };
        let view = View { near, window: None, ..shown };
        let size = DVec2::new(f64::from(view.width), f64::from(view.height));
        let is_sound = depth.is_finite() && depth > 0.0 && view.is_on_picture(at.extend(0.0));
        let pixel = view.parallel_at.unwrap_or(depth) / view.focal_px();
        let beside = (at - size * 0.5) * pixel;
        let place = view.eye + view.world_from_view * DVec3::new(beside.x, -beside.y, -depth);
        (is_sound && place.is_finite()).then_some(Self { view, at, depth, place, pixel })
    }

    /// Place of a point; `None` if it is not on the picture.
    pub fn seen(&self, position: DVec3) -> Option<Seen> {
        let on = self.view.project(position).filter(|on| self.view.is_on_picture(*on))?;
        let offset_px = on.truncate().distance(self.at);
        Some(Seen { offset_px, depth_offset: on.z - self.depth })
    }

    /// Position on the metric lattice that is shown.
    pub fn place(&self) -> DVec3 {
        self.place
    }

    /// Greatest distance in space from the shown place to a point that is picked.
    pub fn reach(&self, forest: &Forest) -> f64 {
        self.reach_lacking(forest, &mut Vec::new())
    }

    /// [`Aim::reach`]; adds nodes to `lacking` whose children would change it.
    fn reach_lacking(&self, forest: &Forest, lacking: &mut Vec<u32>) -> f64 {
        let reach = REACH_PX * self.pixel;
        reach.max(REACH_SPACINGS * spacing_at(forest, self.place, reach, lacking))
    }
}

/// Finds the point that is meant by `aim`, among those that `shown` accepts: of the points that
/// are about as deep as the shown surface, the one nearest to it on the picture. `None` if no
/// point is in reach. Adds nodes to `lacking` whose children are not in the table
/// ([`esker_points::Node::lacks_children`]) and would be searched.
///
/// # Errors
/// If a node cannot be read or is damaged.
pub fn find(
    forest: &Forest,
    aim: &Aim,
    shown: &ForestFilter,
    lacking: &mut Vec<u32>,
) -> Result<Option<Found>> {
    let reach = aim.reach_lacking(forest, lacking);
    let mut search = Search { forest, aim, shown, lattice: forest.metric(), lacking };
    let Some((nearest, is_on_picture)) = search.nearest(reach)? else { return Ok(None) };
    // If the place is a point, its distance from it is an error of rounding.
    let nearest = nearest.max(ROUNDING * (aim.view.eye.length() + aim.depth));
    let radius = if is_on_picture { RADII * nearest } else { reach };
    search.nearest_on_picture(radius, DEPTHS * nearest)
}

/// Distance of neighbouring points at a place: that of the smallest cell at most `reach` away, on
/// the way from the root to the nearest cells, of the tree where it is greatest; 0 if there is
/// none.
fn spacing_at(forest: &Forest, place: DVec3, reach: f64, lacking: &mut Vec<u32>) -> f64 {
    let (table, lattice) = (forest.table(), forest.metric());
    let near = |index: u32| {
        let node = table.nodes.get(index as usize)?;
        let distance = OrientedBox::of_cell(&node.cell(), lattice).distance(place);
        (distance <= reach).then_some((distance, index, node))
    };
    let of_tree = |root: u32| {
        let (_, mut index, mut node) = near(root)?;
        // Children come behind their parents, so this ends.
        while let Some((_, child, below)) = node
            .children()
            .filter(|&child| child > index)
            .filter_map(near)
            .min_by(|a, b| a.0.total_cmp(&b.0))
        {
            (index, node) = (child, below);
        }
        if node.lacks_children() {
            lacking.push(index);
        }
        Some(f64::from(node.spacing)).filter(|spacing| spacing.is_finite())
    };
    table.roots().filter_map(of_tree).fold(0.0, f64::max)
}

/// A node that waits to be visited: the nearest first, of equally near ones the first in the table.
#[derive(PartialEq)]
struct Waiting {
    distance: f64,
    node: u32,
    /// Its index in the file.
    index: u32,
}

impl Eq for Waiting {}

impl Ord for Waiting {
    fn cmp(&self, other: &Self) -> Ordering {
        // The heap gives the greatest first.
        other.distance.total_cmp(&self.distance).then(other.index.cmp(&self.index))
    }
}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// What a search reads, and where it looks.
struct Search<'a> {
    forest: &'a Forest,
    aim: &'a Aim,
    shown: &'a ForestFilter,
    lattice: &'a Lattice,
    lacking: &'a mut Vec<u32>,
}

impl Search<'_> {
    /// Distance from the shown place to the nearest point that is drawn, at most `reach` away, and
    /// whether that point is on the picture.
    fn nearest(&mut self, reach: f64) -> Result<Option<(f64, bool)>> {
        let mut best = None;
        let mut limit = reach;
        self.visit(reach, |found, distance| {
            let is_nearer = distance < limit || (best.is_none() && distance <= limit);
            if is_nearer && let Some(on) = self.aim.view.project(found.position) {
                best = Some((distance, self.aim.view.is_on_picture(on)));
                limit = distance;
            }
            limit
        })?;
        Ok(best)
    }

    /// The point nearest to the aim on the picture, of those at most `radius` from the shown place
    /// in space, and `depths` in depth.
    fn nearest_on_picture(&mut self, radius: f64, depths: f64) -> Result<Option<Found>> {
        let mut best: Option<Found> = None;
        self.visit(radius, |found, distance| {
            if distance <= radius
                && let Some(seen) = self.aim.seen(found.position)
                && seen.depth_offset.abs() <= depths
                && best.is_none_or(|best| order(seen, best.seen) == Ordering::Less)
            {
                best = Some(Found { seen, ..found });
            }
            radius
        })?;
        Ok(best)
    }

    /// Calls `see` with the accepted points of all nodes, and their distances from the shown
    /// place; nodes farther away than it returned last are passed over. Begins with those within
    /// `radius`.
    fn visit(&mut self, radius: f64, mut see: impl FnMut(Found, f64) -> f64) -> Result<()> {
        let table = self.forest.table();
        let nodes = &table.nodes;
        let (mut limit, mut read) = (radius, 0);
        let mut waiting = BinaryHeap::new();
        let (shown, lattice, place) = (self.shown, self.lattice, self.aim.place);
        let push = |waiting: &mut BinaryHeap<Waiting>, node: u32, limit: f64| {
            let Some(record) = nodes.get(node as usize) else { return };
            let cell = OrientedBox::of_cell(&record.cell(), lattice);
            let distance = distance_to(&cell, place);
            if distance <= limit && !shown.rejects_subtree(node) {
                waiting.push(Waiting { distance, node, index: table.index_in_file(node) });
            }
        };
        table.roots().for_each(|root| push(&mut waiting, root, limit));
        while let Some(Waiting { distance, node, .. }) = waiting.pop() {
            if distance > limit || read > POINTS_MAX {
                break;
            }
            let record = &nodes[node as usize];
            let contour = OrientedBox::of_contour(record, self.lattice);
            let points = self.shown.points_max(node).min(record.points());
            if points > 0 && distance_to(&contour, place) <= limit {
                read += points;
                limit = self.see_node(node, points, &mut see)?.unwrap_or(limit);
            }
            if record.lacks_children() {
                self.lacking.push(node);
            }
            // Children come behind their parents, so this ends.
            for child in record.children().filter(|&child| child > node) {
                push(&mut waiting, child, limit);
            }
        }
        Ok(())
    }

    /// Calls `see` with the first `points` points of a node that are accepted; returns what it
    /// returned last.
    fn see_node(
        &self,
        node: u32,
        points: usize,
        see: &mut impl FnMut(Found, f64) -> f64,
    ) -> Result<Option<f64>> {
        let planes: Planes =
            self.shown.read(self.forest, node, &[PlaneKind::Position, PlaneKind::Residual])?;
        let record = self.forest.record(node);
        let residual = planes.get(PlaneKind::Residual).unwrap_or_default();
        let positions = planes.get(PlaneKind::Position).unwrap_or_default();
        let positions = positions.as_chunks::<HOT_POSITION_BYTES>().0.iter().take(points);
        let mut last = None;
        for (point, hot) in positions.enumerate().filter(|(_, hot)| hot[HIDDEN_AT] == 0) {
            let low = read_residual(residual, point, record.hot_shift);
            let lattice = [0, 1, 2].map(|axis| {
                let hot = u16::from_le_bytes([hot[axis * 2], hot[axis * 2 + 1]]);
                exact(hot, low[axis], record.box_min[axis], record.hot_shift)
            });
            let position = DVec3::from_array(self.lattice.world(lattice));
            let seen = Seen { offset_px: f64::INFINITY, depth_offset: f64::INFINITY };
            let distance = position.distance(self.aim.place);
            last = Some(see(Found { node, point, position, seen }, distance));
        }
        Ok(last)
    }
}

/// Least distance of the points of a box from a place. A box that is not a number is read rather
/// than lost.
fn distance_to(b: &OrientedBox, place: DVec3) -> f64 {
    let distance = b.distance(place) - BOX_ROUNDING * b.radius();
    if distance.is_nan() { 0.0 } else { distance.max(0.0) }
}

/// Order by the distance on the picture, then by the depth from the shown surface.
fn order(a: Seen, b: Seen) -> Ordering {
    let by_depth = || a.depth_offset.abs().total_cmp(&b.depth_offset.abs());
    a.offset_px.total_cmp(&b.offset_px).then_with(by_depth)
}
