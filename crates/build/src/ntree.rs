//! The adaptive n-tree of a node (kanzok2015, section 3.1): its points keyed along the axes of their
//! local shape, n = 2, 4 or 8 children a cell. Keys are quantised to integers once; every decision after
//! that is integer arithmetic.

use crate::row::Rows;
use crate::shape::Shape;
use crate::turn::LAST_TURN;
use esker_points::{Cell, morton};

/// One point in the n-tree.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Interleaved quantised coordinates.
    pub key: u64,
    /// Quantised coordinates along the n-tree's axes; the key has as many of them as the dimension.
    pub q: [u32; 3],
    /// Its row.
    pub row: u32,
    /// When its turn comes in thinning: see [`crate::sample`].
    pub turn: u16,
}

/// Points sorted along the n-tree's order.
pub struct NTree {
    /// Sorted by key, then row.
    pub entries: Vec<Entry>,
    /// Dimension: n = 2^dimension. 0 where all points coincide.
    pub dimension: u32,
    /// Edge of the whole, in the file's unit.
    edge: f64,
    bits: u32,
}

impl NTree {
    /// Keys the rows `points` of a node's cell by the shape of all points of the cell. `turns` is empty or
    /// has one for each of them.
    pub fn new(
        rows: &Rows<'_>,
        points: &[u32],
        turns: &[u16],
        cell: &Cell,
        shape: &Shape,
        scale: [f64; 3],
    ) -> Self {
        let dimension = shape.dimension;
        let bits = if dimension == 3 { 21 } else { 31 };
        let mut tree = Self { entries: Vec::new(), dimension, edge: 0.0, bits };
        let cubic = scale[0] == scale[1] && scale[1] == scale[2];
        if dimension == 3 && cubic {
            tree.key_along_cell(rows, points, cell, scale[0]);
        } else {
            tree.key_along_axes(rows, points, cell, shape, scale);
        }
        tree.entries.iter_mut().zip(turns).for_each(|(entry, turn)| entry.turn = *turn);
        tree.entries.sort_unstable_by_key(|e| (e.key, e.row));
        tree
    }

    /// In a volume the lattice's own axes serve: it has none of its own worth following, and differences
    /// of lattice coordinates need no rounding.
    fn key_along_cell(&mut self, rows: &Rows<'_>, points: &[u32], cell: &Cell, scale: f64) {
        let (corner, log2) = self.frame_along_cell(rows, points, cell);
        self.edge = (1u64 << log2) as f64 * scale;
        let place = |c: u32, corner: u32| {
            let within = c - corner;
            if log2 >= self.bits {
                within >> (log2 - self.bits)
            } else {
                within << (self.bits - log2)
            }
        };
        self.entries = points
            .iter()
            .map(|&row| {
                let p = rows.position(row);
                let q = [0, 1, 2].map(|i| place(p[i], corner[i]));
                Entry { key: morton::encode3_21(q), q, row, turn: LAST_TURN }
            })
            .collect();
    }

    /// Where keys begin, and the log2 of the edge that they divide: the cell's, or where keys would be coarser
    /// than the lattice, the points' own. Points on both sides of the lattice's middle have all of it for a
    /// cell, however near to one another they are.
    fn frame_along_cell(&self, rows: &Rows<'_>, points: &[u32], cell: &Cell) -> ([u32; 3], u32) {
        let log2 = u32::from(cell.log2);
        if log2 <= self.bits {
            return (cell.corner, log2);
        }
        let (mut low, mut high) = ([u32::MAX; 3], [0; 3]);
        for p in points.iter().map(|&row| rows.position(row)) {
            for i in 0..3 {
                low[i] = low[i].min(p[i]);
                high[i] = high[i].max(p[i]);
            }
        }
        let extent = (0..3).map(|i| high[i].saturating_sub(low[i])).fold(0, u32::max);
        let own_log2 = (u32::BITS - extent.leading_zeros()).max(1);
        if own_log2 < log2 { (low, own_log2) } else { (cell.corner, log2) }
    }

    /// Along a line or in a plane, keys have one or two coordinates, distances all three: ground that slopes
    /// away from its plane is farther than it looks from above.
    fn key_along_axes(
        &mut self,
        rows: &Rows<'_>,
        points: &[u32],
        cell: &Cell,
        shape: &Shape,
        scale: [f64; 3],
    ) {
        let along = |row: u32| {
            let p = rows.position(row);
            let local = [0, 1, 2].map(|i| f64::from(p[i] - cell.corner[i]) * scale[i]);
            shape.axes.map(|a| a[0] * local[0] + a[1] * local[1] + a[2] * local[2])
        };
        let d = self.dimension as usize;
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for &row in points {
            let t = along(row);
            for i in 0..3 {
                low[i] = low[i].min(t[i]);
                high[i] = high[i].max(t[i]);
            }
        }
        self.edge = (0..3).map(|i| high[i] - low[i]).fold(0.0, f64::max);
        let cells = f64::from(1u32 << self.bits);
        let per_unit = if self.edge > 0.0 { cells / self.edge } else { 0.0 };
        self.entries = points
            .iter()
            .map(|&row| {
                let t = along(row);
                let mut q = [0u32; 3];
                for i in 0..3 {
                    q[i] = ((t[i] - low[i]) * per_unit).min(cells - 1.0) as u32;
                }
                let key = match d {
                    3 => morton::encode3_21(q),
                    2 => morton::encode2([q[0], q[1]]),
                    _ => u64::from(q[0]),
                };
                Entry { key, q, row, turn: LAST_TURN }
            })
            .collect();
    }

    /// Number of levels below the whole: level [`NTree::depth`] is one cell a quantised position.
    pub fn depth(&self) -> u32 {
        if self.edge > 0.0 { self.bits } else { 0 }
    }

    /// Edge of a cell of a level, in the file's unit.
    pub fn cell_edge(&self, level: u32) -> f64 {
        self.edge / f64::from(1u32 << level)
    }

    /// The number of a point's cell at a level.
    pub fn cell_of(&self, entry: &Entry, level: u32) -> u64 {
        let shift = self.dimension * (self.bits - level);
        if shift >= 64 { 0 } else { entry.key >> shift }
    }

    /// Number of occupied cells at each level, 0 to [`NTree::depth`].
    pub fn occupied(&self) -> Vec<usize> {
        let depth = self.depth() as usize;
        let mut first_apart = vec![0usize; depth + 1];
        for pair in self.entries.windows(2) {
            let differing = pair[0].key ^ pair[1].key;
            if differing != 0 {
                let bit = 63 - differing.leading_zeros();
                first_apart[(self.bits - bit / self.dimension.max(1)) as usize] += 1;
            }
        }
        let mut cells = usize::from(!self.entries.is_empty());
        first_apart
            .iter()
            .map(|apart| {
                cells += apart;
                cells
            })
            .collect()
    }

    /// Runs of entries that share a cell at a level, within a range of entries.
    pub fn runs(
        &self,
        range: std::ops::Range<usize>,
        level: u32,
    ) -> impl Iterator<Item = std::ops::Range<usize>> + '_ {
        let mut start = range.start;
        std::iter::from_fn(move || {
            let cell = self.cell_of(self.entries[..range.end].get(start)?, level);
            let run = &self.entries[start..range.end];
            let len = run.iter().position(|e| self.cell_of(e, level) != cell).unwrap_or(run.len());
            start += len;
            Some(start - len..start)
        })
    }

    /// Cells of a level along an edge, in quantised steps: log2 of the edge of one.
    pub fn cell_log2(&self, level: u32) -> u32 {
        self.bits - level
    }

    /// The number of the cell at a level that holds quantised coordinates.
    pub fn cell_at(&self, q: [u32; 3], level: u32) -> u64 {
        self.cell_number(q.map(|c| c >> self.cell_log2(level)))
    }

    /// The number of a cell of its coordinates at its level.
    pub fn cell_number(&self, c: [u32; 3]) -> u64 {
        match self.dimension {
            3 => morton::encode3_21(c),
            2 => morton::encode2([c[0], c[1]]),
            _ => u64::from(c[0]),
        }
    }

    /// Quantised steps of a length in the file's unit.
    pub fn quantised(&self, length: f64) -> f64 {
        let steps = length / self.edge * f64::from(1u32 << self.bits);
        if steps.is_finite() { steps } else { 0.0 }
    }

    /// Typical distance of points, in the file's unit, where this many of the tree's points stand evenly
    /// in its `occupied` cells: the edge of cells with a few points each over the local dimension's root
    /// of how many. 0 where all points coincide.
    pub fn spacing(&self, occupied: &[usize], points: usize) -> f64 {
        let level = occupied.iter().rposition(|&cells| cells * 4 <= points.max(4)).unwrap_or(0);
        let growth = if level > 0 {
            (occupied[level] as f64 / occupied[level - 1] as f64).log2()
        } else {
            1.0
        };
        let local_dimension = growth.clamp(1.0, f64::from(self.dimension.max(1)));
        let each = (points as f64 / occupied[level] as f64).max(1.0);
        self.cell_edge(level as u32) / each.powf(1.0 / local_dimension)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::shape::Moments;

    /// Rows of bare positions.
    pub fn rows_of(points: &[[u32; 3]]) -> Vec<u8> {
        points.iter().flatten().flat_map(|c| c.to_le_bytes()).collect()
    }

    /// The n-tree of bare positions in the smallest cell that holds them.
    pub fn tree_of(points: &[[u32; 3]], bytes: &[u8], scale: [f64; 3]) -> NTree {
        let rows = Rows { bytes, stride: 12 };
        let (mut min, mut max) = ([u32::MAX; 3], [0; 3]);
        let mut moments = Moments::default();
        for &p in points {
            moments.add(p);
            for i in 0..3 {
                min[i] = min[i].min(p[i]);
                max[i] = max[i].max(p[i]);
            }
        }
        let all: Vec<u32> = (0..points.len() as u32).collect();
        NTree::new(
            &rows,
            &all,
            &[],
            &Cell::enclosing(min, max),
            &Shape::of(moments.covariance(scale)),
            scale,
        )
    }

    fn dimension_of(points: &[[u32; 3]]) -> u32 {
        tree_of(points, &rows_of(points), [0.01; 3]).dimension
    }

    #[test]
    fn a_line_a_plane_and_a_volume_get_two_four_and_eight_children() {
        let grid = |f: fn(u32, u32, u32) -> [u32; 3], n: [u32; 3]| {
            let mut points = Vec::new();
            for z in 0..n[2] {
                for y in 0..n[1] {
                    for x in 0..n[0] {
                        points.push(f(x, y, z));
                    }
                }
            }
            points
        };
        assert_eq!(dimension_of(&[[5; 3]; 9]), 0);
        assert_eq!(dimension_of(&grid(|x, _, _| [x * 7, x * 3 + 100, 50_000 - x], [500, 1, 1])), 1);
        assert_eq!(dimension_of(&grid(|x, y, _| [x * 100, y * 80, 7 * x + 3 * y], [40, 40, 1])), 2);
        assert_eq!(dimension_of(&grid(|x, y, z| [x * 10, y * 10, z * 10], [12, 12, 12])), 3);
    }

    #[test]
    fn cell_counts_are_those_of_counting_distinct_prefixes() {
        let points: Vec<_> =
            (0..500u32).map(|i| [i * i % 977 * 40, i * 31 % 811 * 40, i % 7]).collect();
        let bytes = rows_of(&points);
        let tree = tree_of(&points, &bytes, [0.01; 3]);
        for (level, &count) in tree.occupied().iter().enumerate() {
            let mut cells: Vec<_> =
                tree.entries.iter().map(|e| tree.cell_of(e, level as u32)).collect();
            cells.dedup();
            assert_eq!(cells.len(), count, "level {level}");
            assert_eq!(tree.runs(0..500, level as u32).count(), count);
        }
    }

    #[test]
    fn spacing_of_even_samples_is_their_distance() {
        let plane: Vec<_> = (0..128 * 128u32).map(|i| [i % 128 * 100, i / 128 * 100, 0]).collect();
        let volume: Vec<_> = (0..32 * 32 * 32u32)
            .map(|i| [i % 32 * 100, i / 32 % 32 * 100, i / 1024 * 100])
            .collect();
        let line: Vec<_> = (0..4096u32).map(|i| [i * 100, 0, 0]).collect();
        let around_middle = |p: &[u32; 3]| p.map(|c| (1 << 31) - 1600 + c);
        let middle: Vec<_> = volume.iter().map(around_middle).collect();
        let samples = [
            (plane, "plane"),
            (volume, "volume"),
            (middle, "volume around the lattice's middle"),
            (line, "line"),
        ];
        for (points, name) in samples {
            let bytes = rows_of(&points);
            let tree = tree_of(&points, &bytes, [0.01; 3]);
            let spacing = tree.spacing(&tree.occupied(), points.len());
            assert!((0.75..1.35).contains(&spacing), "{name}: {spacing}");
        }
    }
}
