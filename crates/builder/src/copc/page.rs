//! Makes the pages of the nodes of a chunk: places its points on the lattice, thins them to an
//! order of which every prefix is an even sample, and measures contour and spacing. The file's own
//! integers are kept beside the pages.

use crate::copc::table::{cell_of, hot_shift_of, part_sizes};
use crate::rows::row::{Incoming, Rows};
use crate::sample::cell::Context;
use crate::sample::contour;
use crate::sample::order::parts;
use crate::sample::shape::Shape;
use bytemuck::Zeroable;
use esker_format::{Histograms, NodeStatistics, PageLayout, PagePoints, encode_raw_page};
use esker_points::node::Sides;
use esker_points::{Batch, Cell, Grid, Lattice, Node, Schema, morton, quant};
use esker_scan::las::copc::ChunkPoints;
use esker_scan::write::las::copc::VoxelKey;
use std::sync::Arc;

/// Share of the density of points on a surface that those of the levels above have, where each
/// level has four times the points of the one above.
const SHARE_ABOVE: f64 = 0.25;
/// How far a point may lie outside of its voxel, in steps of the file's coordinates: writers place
/// points before they round them.
const OUTSIDE_STEPS_MAX: f64 = 1.0;

/// A node of a chunk.
pub struct MadeNode {
    /// Its page, all planes raw.
    pub page: Vec<u8>,
    /// The file's integers of its points, in the page's order.
    pub own: Vec<[i32; 3]>,
    /// Record with spacing, contour, shape and levels.
    pub record: Node,
    /// Sides of its contour.
    pub sides: Sides,
    /// Statistics of its points.
    pub statistics: NodeStatistics,
    /// Its points.
    pub points: PagePoints,
}

impl MadeNode {
    /// Counts the values of its points.
    pub fn count(&self, layout: &PageLayout, histograms: &mut Histograms) {
        histograms.add(layout, &self.points);
    }
}

/// How chunks become pages.
pub struct Pages {
    /// Layout of rows and pages.
    pub context: Context,
    /// Attributes.
    pub schema: Arc<Schema>,
    /// The file's attribute for each of the reader's.
    pub to_file: Vec<usize>,
    /// Grid of the file's integers.
    pub grid: Grid,
    /// Lattice of the cube.
    pub lattice: Lattice,
}

impl Pages {
    /// Makes the pages of a chunk; `above` is the spacing of the level above, if there is one.
    ///
    /// # Errors
    /// If a point lies outside of its voxel.
    pub fn make(
        &self,
        key: VoxelKey,
        points: ChunkPoints,
        above: Option<f64>,
    ) -> Result<Vec<MadeNode>, String> {
        let cell = cell_of(key);
        let ChunkPoints { positions: own, columns, .. } = points;
        let positions = self.placed(&own, &cell, key)?;
        let mut order: Vec<u32> = (0..own.len() as u32).collect();
        order.sort_by_cached_key(|&i| morton::encode3(positions[i as usize]));
        let own: Vec<[i32; 3]> = order.iter().map(|&i| own[i as usize]).collect();
        let batch = Batch { schema: self.schema.clone(), positions, columns, outside: Vec::new() };
        let bytes = self.sorted_rows(&batch, &order);
        drop(batch);
        let rows = Rows { bytes: &bytes, stride: self.context.rows.bytes() };

        let mut leaf = self.context.leaf(&rows, 0..own.len() as u32, cell);
        let shape = Shape::of(leaf.moments.covariance(self.context.scale));
        let dimension = self.context.assign_turns(&rows, &mut leaf, &[], None, &shape);
        let step = self.context.scale.iter().fold(f64::INFINITY, |a, &b| a.min(b)).max(1e-30);
        let total = own.len();
        let together = (1.0 - SHARE_ABOVE).sqrt();
        let spacing = |drawn: usize| {
            let own = leaf.turn_counts().spacing(drawn, total, dimension) * together;
            // Few points say little of their distances.
            let few = total < 8 || !own.is_finite();
            let most = above.unwrap_or(f64::INFINITY);
            (if few && above.is_some() { most } else { own.min(most) }).clamp(step, 1e30)
        };
        let full = spacing(total);
        let sizes = part_sizes(total);
        let part_of = match sizes.len() {
            1 => vec![0; total],
            count => parts(&leaf.turns, count),
        };
        let mut drawn = 0;
        let mut made = Vec::with_capacity(sizes.len());
        for part in 0..sizes.len() as u32 {
            let of_part = (0u32..).zip(&part_of).filter(|(_, p)| **p == part);
            let points: Vec<u32> = of_part.map(|(i, _)| i).collect();
            drawn += points.len();
            let spacing = spacing(drawn);
            let widths = ([spacing, full], quant::RADIUS_MAX);
            let (rows_of, codes, levels) = self.context.ordered(&leaf, &points, widths);
            made.push(self.node(&rows, &own, (rows_of, codes, levels), (cell, dimension, spacing)));
        }
        Ok(made)
    }

    fn node(
        &self,
        rows: &Rows<'_>,
        own: &[[i32; 3]],
        (rows_of, codes, levels): (Vec<u32>, Vec<u8>, Vec<usize>),
        (cell, dimension, spacing): (Cell, u32, f64),
    ) -> MadeNode {
        let (points, _) = self.context.page_points(rows, &rows_of, codes);
        let mut record = Node::zeroed();
        (record.corner, record.cell_log2) = (cell.corner, cell.log2);
        (record.box_min, record.hot_shift) = (cell.corner, hot_shift_of(&cell));
        record.shape = dimension as u8;
        record.spacing = spacing as f32;
        record.set_levels(&levels);
        let scale = self.context.scale;
        let step = scale.iter().fold(0.0f64, |a, &b| a.max(b));
        let reach = step * f64::from(1u32 << record.hot_shift);
        let sides = contour::enclose(&mut record, &points.positions, scale, reach);
        let layout = &self.context.pages;
        MadeNode {
            page: encode_raw_page(layout, record.box_min, record.hot_shift, &points),
            own: rows_of.iter().map(|&i| own[i as usize]).collect(),
            record,
            sides,
            statistics: NodeStatistics::of(layout, &points).with_sides(sides),
            points,
        }
    }

    /// Lattice coordinates of the file's integers, of points of a voxel. Those on its upper faces,
    /// or outside of it by rounding, come to the nearest step in it.
    fn placed(
        &self,
        own: &[[i32; 3]],
        cell: &Cell,
        key: VoxelKey,
    ) -> Result<Vec<[u32; 3]>, String> {
        let (first, last) = (cell.first(), cell.last());
        let axes = [0, 1, 2].map(|axis| {
            let step = self.lattice.scale[axis];
            let ratio = self.grid.scale[axis] / step;
            // The lattice's least coordinate is the lower face of the cube.
            let zero = self.lattice.world([0; 3])[axis];
            (ratio, (self.grid.offset[axis] - zero) / step)
        });
        let mut off = 0.0f64;
        let place = |p: &[i32; 3]| {
            let mut placed = [0; 3];
            for axis in 0..3 {
                let (ratio, delta) = axes[axis];
                let at = (f64::from(p[axis]) * ratio + delta).round_ties_even();
                let [low, high] = [first[axis], last[axis]].map(f64::from);
                let inside = at.clamp(low, high);
                // The upper face itself belongs to the voxel beside, but for the cube's.
                off = off.max(((at - inside).abs() - 1.0) / ratio);
                placed[axis] = inside as u32;
            }
            placed
        };
        let placed = own.iter().map(place).collect();
        if off > OUTSIDE_STEPS_MAX {
            let VoxelKey { level, place: [x, y, z] } = key;
            return Err(format!(
                "points of the voxel {level}-{x}-{y}-{z} lie outside of it, by up to {off:.1} steps: \
                 its octree is damaged; build it instead"
            ));
        }
        Ok(placed)
    }

    /// The rows of a batch in an order.
    fn sorted_rows(&self, batch: &Batch, order: &[u32]) -> Vec<u8> {
        let stride = self.context.rows.bytes();
        let mut plain = Vec::with_capacity(order.len() * stride);
        let incoming = Incoming { batch, class: 0, to_file: &self.to_file, towards: &[] };
        self.context.rows.for_each_rows(&incoming, &mut |rows| plain.extend_from_slice(rows));
        let mut sorted = Vec::with_capacity(plain.len());
        let row = |&i: &u32| &plain[i as usize * stride..][..stride];
        order.iter().for_each(|i| sorted.extend_from_slice(row(i)));
        sorted
    }
}
