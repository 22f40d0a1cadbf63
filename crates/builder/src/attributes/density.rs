//! Density of points, counted by cell, in the finest cells of which there are not too many. The
//! result depends only on the points, not on how they are split or what headers claim.

use crate::rows::corners::{CornerMap, corner, key};
use crate::rows::journal_record::{Record, RecordReader};

/// Largest number of cells; beyond it, their edges double.
const CELLS_MAX: usize = 1 << 14;

/// Points of a cell from which a density is estimated.
const POINTS_MIN: u64 = 8;

/// Points of a cubic cell of steps, typically, over which no reach extends: a chunk has many more.
const REACHED_POINTS: u64 = 8192;

/// What the reach of computed attributes follows from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distances {
    /// Typical distance of points, in steps of the axis that has the longest.
    pub spacing: f64,
    /// Most steps that a reach may have on any axis. Infinite where steps are about as long on all
    /// axes. Where they are not, the cells of chunks are no cubes, and many chunks would lie within
    /// a longer reach.
    pub steps_max: f64,
}

impl Distances {
    /// Longest reach that [`Distances::steps_max`] allows, in the unit of `scale`, if it leaves
    /// points without the neighbours that a plane takes.
    pub fn limit(&self, scale: [f64; 3]) -> Option<f64> {
        /// Least reach, in spacings, with which hardly any point is left without neighbours.
        const SPACINGS_LEAST: f64 = 4.0;
        let shortest = scale.into_iter().fold(f64::INFINITY, f64::min);
        let longest = scale.into_iter().fold(0.0, f64::max);
        let limit = self.steps_max * shortest;
        (limit < self.spacing * longest * SPACINGS_LEAST).then_some(limit)
    }
}

/// Log2 of the longest step over that of each axis, rounded down: positions shifted by it have
/// steps that differ by at most two.
pub fn excess_bits(scale: [f64; 3]) -> [u32; 3] {
    let longest = scale.into_iter().fold(0.0, f64::max);
    scale.map(|step| ((longest / step).log2() as u32).min(31))
}

/// Densities from which [`Distances`] follow; those of parts of the points add up.
#[derive(Default)]
pub struct Densities {
    /// Counts by cells that are about cubes: excess bits of the coordinates are left out.
    pub cubic: Density,
    /// Counts by cells of steps, where these differ.
    pub by_steps: Option<Density>,
}

impl Densities {
    /// The distances of the counted points.
    pub fn distances(mut self) -> Distances {
        let edge = |mut density: Density| density.edge_with(REACHED_POINTS);
        let steps_max = self.by_steps.map_or(f64::INFINITY, edge);
        Distances { spacing: self.cubic.spacing(), steps_max }
    }

    /// Sums both counts.
    pub fn merged(self, other: Self) -> Self {
        let by_steps = [self.by_steps, other.by_steps].into_iter().flatten();
        Self { cubic: self.cubic.merged(other.cubic), by_steps: by_steps.reduce(Density::merged) }
    }

    /// Adds the counts to a record.
    pub fn put(&self, record: &mut Record) {
        self.cubic.put(record);
        record.put(u8::from(self.by_steps.is_some()));
        self.by_steps.iter().for_each(|density| density.put(record));
    }

    /// Reads counts from a record; `None` if it is damaged.
    pub fn get(from: &mut RecordReader<'_>) -> Option<Self> {
        let cubic = Density::get(from)?;
        let by_steps = if from.get::<u8>()? > 0 { Some(Density::get(from)?) } else { None };
        Some(Self { cubic, by_steps })
    }
}

/// Number of points by cell.
#[derive(Default)]
pub struct Density {
    /// Log2 of the cells' edge.
    log2: u8,
    cells: CornerMap<u64>,
}

impl Density {
    /// Counts points by cell, in cells of at least `2^log2` steps.
    pub fn of(points: impl Iterator<Item = [u32; 3]>, log2: u8) -> Self {
        let mut density = Self { log2, ..Self::default() };
        let (mut last, mut count) = ([0; 3], 0);
        for p in points {
            // Neighbours in a file mostly share a cell. Cells double only when one is added.
            if density.cell_of(p) != last {
                density.add(last, count);
                (last, count) = (density.cell_of(p), 0);
            }
            count += 1;
        }
        density.add(last, count);
        density
    }

    /// Sums both counts.
    pub fn merged(mut self, mut other: Self) -> Self {
        while self.log2 < other.log2 {
            self.coarsen();
        }
        while other.log2 < self.log2 {
            other.coarsen();
        }
        other.cells.into_iter().for_each(|(cell, count)| self.add_cell(corner(cell), count));
        while self.cells.len() > CELLS_MAX {
            self.coarsen();
        }
        self
    }

    /// Adds the counts to a record.
    pub fn put(&self, record: &mut Record) {
        let mut cells: Vec<_> = self.cells.iter().map(|(&cell, &count)| (cell, count)).collect();
        cells.sort_unstable();
        record.put(self.log2);
        record.put(cells.len() as u64);
        for (cell, count) in cells {
            record.put(corner(cell));
            record.put(count);
        }
    }

    /// Reads counts from a record; `None` if it is damaged.
    pub fn get(from: &mut RecordReader<'_>) -> Option<Self> {
        let log2 = from.get::<u8>().filter(|&log2| log2 <= 32)?;
        let count = from.get::<u64>()?;
        let cell = |_| Some((key(from.get()?), from.get()?));
        let cells: Option<CornerMap<u64>> = (0..count).map(cell).collect();
        Some(Self { log2, cells: cells? })
    }

    /// Whether finer cells than of `2^log2` steps would be too many: then it is the same to have
    /// counted in cells of at least these.
    pub fn is_above(&self, log2: u8) -> bool {
        self.log2 > log2
    }

    /// Typical distance of points, in steps: that of the median cell, as if each cell held a square
    /// of a surface. Stacks and strays have little weight.
    pub fn spacing(&mut self) -> f64 {
        let middle = self.double_until(POINTS_MIN);
        (1u64 << self.log2) as f64 / (middle as f64).sqrt()
    }

    /// Edge of the cells, in steps, whose median has at least so many points.
    pub fn edge_with(&mut self, points: u64) -> f64 {
        self.double_until(points);
        (1u64 << self.log2) as f64
    }

    /// Doubles cells until the median has at least so many points; returns its points.
    fn double_until(&mut self, points: u64) -> u64 {
        loop {
            let mut counts: Vec<u64> = self.cells.values().copied().collect();
            counts.sort_unstable();
            let middle = counts.get(counts.len() / 2).copied().unwrap_or(1);
            if middle >= points || self.log2 == 32 {
                return middle;
            }
            self.coarsen();
        }
    }

    fn cell_of(&self, p: [u32; 3]) -> [u32; 3] {
        p.map(|c| (u64::from(c) >> self.log2) as u32)
    }

    fn add(&mut self, cell: [u32; 3], count: u64) {
        self.add_cell(cell, count);
        while self.cells.len() > CELLS_MAX {
            self.coarsen();
        }
    }

    fn add_cell(&mut self, cell: [u32; 3], count: u64) {
        if count > 0 {
            *self.cells.entry(key(cell)).or_default() += count;
        }
    }

    fn coarsen(&mut self) {
        self.log2 += 1;
        for (cell, count) in std::mem::take(&mut self.cells) {
            self.add_cell(corner(cell).map(|c| c >> 1), count);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn density_does_not_depend_on_how_points_are_split(points in prop::collection::vec(any::<[u32; 3]>(), 0..300), shift in 0u32..28, cut in 0usize..300) {
            let points: Vec<_> = points.into_iter().map(|p| p.map(|c| c >> shift)).collect();
            let mut whole = Density::of(points.iter().copied(), 0);
            let (a, b) = points.split_at(cut.min(points.len()));
            let mut parts = Density::of(b.iter().rev().copied(), 0).merged(Density::of(a.iter().copied(), 0));
            prop_assert_eq!(whole.spacing(), parts.spacing());
        }
    }

    #[test]
    fn a_square_grid_has_its_spacing_wherever_it_lies() {
        for corner in [0, (1 << 31) - 1000, u32::MAX - 6000] {
            let points =
                (0..90_000).map(|i| [corner + i % 300 * 20, corner + i / 300 * 20, 1 << 31]);
            let mut density = Density::of(points.clone(), 0);
            let (log2, spacing) = (density.log2, density.spacing());
            assert!((14.0..=28.0).contains(&spacing), "{spacing}");
            for least in 1..log2 {
                let mut coarse = Density::of(points.clone(), least);
                assert!(coarse.is_above(least));
                assert_eq!(coarse.spacing(), spacing);
            }
            assert!(!Density::of(points, log2).is_above(log2));
            assert!((450.0..=1200.0).contains(&density.edge_with(512)));
        }
    }

    #[test]
    fn stacks_and_strays_and_few_points_do_not_matter() {
        let grid = (0..900u32).map(|i| [i % 30 * 20, i / 30 * 20, 0]);
        let all = grid.chain(vec![[40, 40, 0]; 5000]).chain((1..40).map(|i| [i << 24, 0, 0]));
        let spacing = Density::of(all, 0).spacing();
        assert!((14.0..=28.0).contains(&spacing), "{spacing}");
        assert_eq!(Density::of(std::iter::once([7; 3]), 0).spacing(), 2f64.powi(32));
        assert!(Density::default().spacing() > 0.0);
    }
}
