//! Parts of a divided build: the cells of all takes are joined, and divided as
//! [`crate::tree::levels`] divides buckets among chunks, by octants until a part has no more rows
//! than it may. Parts are a division of work only; what is built does not depend on them.

use crate::jobs::summary::CellRows;
use crate::rows::journal_record::{Kind, Record, RecordReader, unsealed};
use crate::tree::levels::PartStep;
use esker_points::{Cell, morton};
use rayon::prelude::*;
use std::cmp::Reverse;
use std::ops::Range;

/// Rows of a cell in the object of a take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TakenRows {
    /// The take.
    pub take: u32,
    /// CRC-32 of the rows.
    pub crc: u32,
    /// Offset of the rows, in bytes.
    pub offset: u64,
    /// Number of rows.
    pub rows: u64,
}

/// A cell, and where its rows are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PartCell {
    /// The cell.
    pub cell: Cell,
    /// Its rows, in the order of takes.
    pub rows: Vec<TakenRows>,
}

/// A part: cells that are built together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    /// The cells, along the Morton curve.
    pub cells: Vec<PartCell>,
    /// Cells of other parts that attributes computed in this one depend on, along the curve.
    pub halo: Vec<PartCell>,
}

/// Cells of all takes, divided into parts.
pub struct Division {
    /// Rows of the joined cells.
    rows: Vec<(Cell, TakenRows)>,
    /// The joined cells along the Morton curve, which do not overlap: number of rows, and their
    /// places in `rows`.
    cells: Vec<(Cell, u64, Range<usize>)>,
    /// Steps of the tree above parts.
    pub steps: Vec<PartStep>,
    /// Places of the cells of each part in `cells`.
    parts: Vec<Range<usize>>,
}

/// Cells of the takes that were read so far.
#[derive(Default)]
pub struct TakenCells(Vec<(Cell, TakenRows)>);

impl TakenCells {
    /// Adds the cells of a take.
    pub fn add(&mut self, take: u32, cells: &[CellRows]) {
        let rows = |&CellRows { cell, offset, rows, crc }: &CellRows| {
            (cell, TakenRows { take, crc, offset, rows })
        };
        self.0.extend(cells.iter().map(rows));
    }

    /// The cells of takes along the Morton curve; a cell comes before those in it.
    pub fn along_the_curve(self) -> Vec<(Cell, TakenRows)> {
        let mut rows = self.0;
        rows.par_sort_unstable_by_key(|(cell, rows)| {
            (morton::encode3(cell.corner), Reverse(cell.log2), rows.take)
        });
        rows
    }
}

impl From<Vec<(Cell, TakenRows)>> for TakenCells {
    fn from(cells: Vec<(Cell, TakenRows)>) -> Self {
        Self(cells)
    }
}

/// The end of the cells from `start` on that are in the first of them, in cells along the curve.
pub fn end_of_cell(rows: &[(Cell, TakenRows)], start: usize) -> usize {
    let (first, _) = rows[start];
    start + rows[start..].partition_point(|(cell, _)| first.contains_cell(cell))
}

impl Division {
    /// Joins cells, and divides them into parts of at most `rows_max` rows; a single cell may have
    /// more.
    pub fn of(cells: TakenCells, rows_max: u64) -> Self {
        let rows = cells.along_the_curve();
        let mut cells: Vec<(Cell, u64, Range<usize>)> = Vec::new();
        let mut start = 0;
        while start < rows.len() {
            // Takes coarsen and split their cells independently.
            let end = end_of_cell(&rows, start);
            let sum = rows[start..end].iter().map(|(_, own)| own.rows).sum();
            cells.push((rows[start].0, sum, start..end));
            start = end;
        }
        let mut division = Self { rows, cells, steps: Vec::new(), parts: Vec::new() };
        if !division.cells.is_empty() {
            division.divide(0..division.cells.len(), rows_max);
        }
        division
    }

    /// Adds the steps that build a range of the cells.
    fn divide(&mut self, range: Range<usize>, rows_max: u64) {
        let cells = &self.cells[range.clone()];
        let rows: u64 = cells.iter().map(|(_, rows, _)| rows).sum();
        if rows <= rows_max || cells.len() == 1 {
            self.steps.push(PartStep::Part(self.parts.len() as u32));
            return self.parts.push(range);
        }
        let cell = enclosing(cells);
        let ends = (1..=8).map(|octant| {
            range.start + cells.partition_point(|(own, ..)| cell.octant(own.corner) < octant)
        });
        let ends: Vec<usize> = ends.collect();
        let (mut start, mut children) = (range.start, 0);
        for end in ends {
            if end > start {
                self.divide(start..end, rows_max);
                children += 1;
            }
            start = end;
        }
        self.steps.push(PartStep::Combine(cell, children));
    }

    /// Number of parts.
    pub fn len(&self) -> usize {
        self.parts.len()
    }

    /// Number of rows.
    pub fn rows(&self) -> u64 {
        self.cells.iter().map(|(_, rows, _)| rows).sum()
    }

    /// Smallest cell and number of rows of a part.
    pub fn extent(&self, part: usize) -> (Cell, u64) {
        let cells = &self.cells[self.parts[part].clone()];
        (enclosing(cells), cells.iter().map(|(_, rows, _)| rows).sum())
    }

    /// The cells of a part, and those of others that meet the box `around` it, if any do.
    pub fn part(&self, part: usize, around: Option<[[u32; 3]; 2]>) -> Part {
        let own = self.parts[part].clone();
        let listed = |i: usize| {
            let (cell, _, rows) = &self.cells[i];
            PartCell { cell: *cell, rows: self.rows[rows.clone()].iter().map(|r| r.1).collect() }
        };
        let others = (0..own.start).chain(own.end..self.cells.len());
        let meets = |i: &usize| {
            let (cell, ..) = &self.cells[*i];
            around.is_some_and(|[low, high]| {
                (0..3).all(|axis| cell.corner[axis] <= high[axis] && low[axis] <= cell.last()[axis])
            })
        };
        Part {
            cells: own.clone().map(listed).collect(),
            halo: others.filter(meets).map(listed).collect(),
        }
    }

    /// Divides the parts among `count` jobs: consecutive ones for each, of about as many rows. A
    /// job may have none, so that a scheduler knows the number of jobs beforehand.
    pub fn jobs(&self, count: u32) -> Vec<Range<u32>> {
        let total = u128::from(self.rows()).max(1);
        let mut starts = vec![0u32; count as usize];
        let mut before = 0u128;
        for part in 0..self.parts.len() {
            let rows = u128::from(self.extent(part).1);
            // The job in whose share the middle of the part lies.
            let job = ((2 * before + rows) * u128::from(count) / (2 * total)) as usize;
            starts.iter_mut().skip(job + 1).for_each(|start| *start = part as u32 + 1);
            before += rows;
        }
        let ends = starts.iter().skip(1).copied().chain([self.parts.len() as u32]);
        starts.iter().copied().zip(ends).map(|(start, end)| start..end).collect()
    }
}

/// Smallest cell of cells along the Morton curve, at least one.
fn enclosing(cells: &[(Cell, u64, Range<usize>)]) -> Cell {
    Cell::enclosing(cells[0].0.corner, cells[cells.len() - 1].0.last())
}

impl Part {
    /// Bytes of the part in the object of the cut.
    pub fn seal(&self) -> Vec<u8> {
        let mut record = Record::new(Kind::Part);
        for cells in [&self.cells, &self.halo] {
            record.put(cells.len() as u64);
            for PartCell { cell, rows } in cells {
                record.put(cell.corner);
                record.put(cell.log2);
                record.put(rows.len() as u64);
                for TakenRows { take, crc, offset, rows } in rows {
                    record.put([*take, *crc]);
                    record.put([*offset, *rows]);
                }
            }
        }
        record.seal()
    }

    /// Reads a part; `None` if it is damaged.
    pub fn unsealed(bytes: &[u8]) -> Option<Self> {
        let mut from = unsealed(bytes, Kind::Part)?;
        Some(Self { cells: part_cells(&mut from)?, halo: part_cells(&mut from)? })
    }
}

fn part_cells(from: &mut RecordReader<'_>) -> Option<Vec<PartCell>> {
    let mut cells = Vec::new();
    for _ in 0..from.get::<u64>()? {
        let cell = Cell { corner: from.get()?, log2: from.get()? };
        let count = from.get::<u64>()?;
        let rows = |_| {
            let ([take, crc], [offset, rows]) = (from.get()?, from.get()?);
            Some(TakenRows { take, crc, offset, rows })
        };
        let rows = (0..count).map(rows).collect::<Option<_>>()?;
        cells.push(PartCell { cell, rows });
    }
    cells.iter().all(|own| own.cell.is_valid()).then_some(cells)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn taken(points: &[([u32; 3], u8, u32)]) -> TakenCells {
        let mut cells = TakenCells::default();
        for &(p, log2, take) in points {
            let cell = Cell::containing(p, log2);
            cells.add(take, &[CellRows { cell, offset: 0, rows: 1, crc: 0 }]);
        }
        cells
    }

    proptest! {
        #[test]
        fn parts_hold_all_rows_once_and_their_steps_make_one_tree(points in prop::collection::vec(([0u32..64, 0u32..64, 0u32..64], 0u8..4, 0u32..5), 1..200), rows_max in 1u64..50) {
            let division = Division::of(taken(&points), rows_max);
            let parts: Vec<Part> = (0..division.len()).map(|i| division.part(i, None)).collect();
            let cells: Vec<&PartCell> = parts.iter().flat_map(|part| &part.cells).collect();
            let rows: usize = cells.iter().map(|cell| cell.rows.len()).sum();
            prop_assert_eq!((rows, division.rows()), (points.len(), points.len() as u64));
            for (i, a) in cells.iter().enumerate() {
                for b in &cells[i + 1..] {
                    prop_assert!(!a.cell.contains_cell(&b.cell) && !b.cell.contains_cell(&a.cell));
                }
            }
            for (i, part) in parts.iter().enumerate() {
                let (cell, rows) = division.extent(i);
                prop_assert!(rows <= rows_max || part.cells.len() == 1);
                prop_assert!(part.cells.iter().all(|own| cell.contains_cell(&own.cell)));
                prop_assert_eq!(Part::unsealed(&part.seal()), Some(part.clone()));
            }
            // The steps in post-order leave one tree.
            let (mut open, mut next) = (Vec::new(), 0);
            for step in &division.steps {
                match *step {
                    PartStep::Part(part) => {
                        prop_assert_eq!(part, next);
                        next += 1;
                        open.push(division.extent(part as usize).0);
                    }
                    PartStep::Combine(cell, children) => {
                        let below = open.split_off(open.len() - children as usize);
                        prop_assert!(children > 1 && below.iter().all(|c| cell.contains_cell(c)));
                        open.push(cell);
                    }
                }
            }
            prop_assert_eq!((open.len(), next as usize), (1, parts.len()));
            for count in [1, 2, 7] {
                let jobs = division.jobs(count);
                let listed: Vec<u32> = jobs.iter().flat_map(Clone::clone).collect();
                prop_assert_eq!(jobs.len(), count as usize);
                prop_assert_eq!(listed, (0..next).collect::<Vec<_>>());
                // No job has much more than its share.
                let rows = |parts: &Range<u32>| {
                    parts.clone().map(|part| division.extent(part as usize).1).sum::<u64>()
                };
                let largest = (0..division.len()).map(|i| division.extent(i).1).max();
                let share = division.rows() / u64::from(count) + largest.unwrap_or(0) + 1;
                prop_assert!(jobs.iter().all(|job| rows(job) <= share));
            }
        }

        #[test]
        fn halos_are_the_cells_of_other_parts_that_meet_the_box(points in prop::collection::vec(([0u32..64, 0u32..64, 0u32..64], 0u8..4, 0u32..5), 1..100), low in [0u32..64, 0u32..64, 0u32..64], size in 0u32..32) {
            let division = Division::of(taken(&points), 9);
            let high = low.map(|c| c + size);
            let all: Vec<Cell> = (0..division.len())
                .flat_map(|i| division.part(i, None).cells).map(|own| own.cell).collect();
            for i in 0..division.len() {
                let part = division.part(i, Some([low, high]));
                let own: Vec<Cell> = part.cells.iter().map(|own| own.cell).collect();
                let halo: Vec<Cell> = part.halo.iter().map(|own| own.cell).collect();
                for cell in &all {
                    let is_near = (0..3).all(|a| cell.corner[a] <= high[a] && low[a] <= cell.last()[a]);
                    prop_assert_eq!(halo.contains(cell), is_near && !own.contains(cell));
                }
            }
        }
    }
}
