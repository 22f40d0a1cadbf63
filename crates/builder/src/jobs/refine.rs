//! Refines cells that are too large for a part although some takes have split them: rows of takes
//! that have not are read and sorted into the smaller cells, and written once more, with the cut.

use crate::error::BuildError;
use crate::jobs::cut_file::TakenObjects;
use crate::jobs::parts::{TakenCells, TakenRows, end_of_cell};
use crate::jobs::place::Place;
use crate::jobs::step::Output;
use crate::rows::row::position;
use crate::rows::sort::sort;
use esker_points::{Cell, Task};

/// Refines cells.
pub struct Refinement<'a, 'o> {
    /// The place, for messages.
    pub place: &'a dyn Place,
    /// Objects of the takes.
    pub objects: &'a TakenObjects,
    /// Object of the cut, which comes behind the takes.
    pub output: &'a mut Output<'o>,
    /// Bytes of a row.
    pub stride: usize,
    /// Rows of a part.
    pub rows_max: u64,
    /// Most bytes of rows in memory. Cells with more that are not split stay.
    pub bytes_max: u64,
    /// Says whether to stop.
    pub task: &'a dyn Task,
    /// The refined cells.
    pub refined: Vec<(Cell, TakenRows)>,
}

impl Refinement<'_, '_> {
    /// Refines the cells of all takes.
    ///
    /// # Errors
    /// If rows cannot be read, or the place is full.
    pub fn run(mut self, cells: TakenCells) -> Result<TakenCells, BuildError> {
        let all = cells.along_the_curve();
        let mut start = 0;
        while start < all.len() {
            self.task.check()?;
            let end = end_of_cell(&all, start);
            self.refine(all[start].0, &all[start..end], &[])?;
            start = end;
        }
        Ok(self.refined.into())
    }

    /// Refines a cell with those in it, which are along the curve, and `carried` rows of larger
    /// ones, sorted.
    fn refine(
        &mut self,
        cell: Cell,
        within: &[(Cell, TakenRows)],
        carried: &[u8],
    ) -> Result<(), BuildError> {
        let (own, smaller) = within.split_at(within.partition_point(|(other, _)| *other == cell));
        let rows_of = |cells: &[(Cell, TakenRows)]| cells.iter().map(|c| c.1.rows).sum::<u64>();
        let stride = self.stride as u64;
        let own_bytes = rows_of(own).saturating_mul(stride).saturating_add(carried.len() as u64);
        let is_small = rows_of(within) + carried.len() as u64 / stride <= self.rows_max;
        if smaller.is_empty() || is_small || own_bytes > self.bytes_max {
            self.refined.extend_from_slice(within);
            return self.write(cell, carried);
        }
        let mut sorted = Vec::new();
        let carried = if own.is_empty() {
            carried
        } else {
            let mut read = Vec::with_capacity(own_bytes as usize);
            for (_, rows) in own {
                self.objects.append(self.place, rows, self.stride, &mut read)?;
            }
            sort(&[vec![&read, carried]], self.stride, &mut sorted);
            &sorted
        };
        let (mut rows, mut cells) = (carried, smaller);
        for octant in 0..8u8 {
            let of = |p| cell.octant(p) <= octant;
            let count = partition_rows(rows, self.stride, of);
            let (own_rows, rest_rows) = rows.split_at(count * self.stride);
            let (own, rest) = cells.split_at(cells.partition_point(|(c, _)| of(c.corner)));
            (rows, cells) = (rest_rows, rest);
            let first =
                own.first().map(|(c, _)| c.corner).or(own_rows.first().map(|_| position(own_rows)));
            if let Some(first) = first {
                self.refine(Cell::containing(first, cell.log2 - 1), own, own_rows)?;
            }
        }
        Ok(())
    }

    /// Writes rows of a cell with the cut.
    fn write(&mut self, cell: Cell, rows: &[u8]) -> Result<(), BuildError> {
        if rows.is_empty() {
            return Ok(());
        }
        let rows_at = TakenRows {
            take: self.objects.len(),
            crc: crc32fast::hash(rows),
            offset: self.output.bytes(),
            rows: (rows.len() / self.stride) as u64,
        };
        self.output.write(rows)?;
        self.refined.push((cell, rows_at));
        Ok(())
    }
}

/// Number of rows at the beginning of sorted ones whose positions fulfil a condition.
fn partition_rows(rows: &[u8], stride: usize, is_before: impl Fn([u32; 3]) -> bool) -> usize {
    let (mut low, mut high) = (0, rows.len() / stride);
    while low < high {
        let middle = low.midpoint(high);
        if is_before(position(&rows[middle * stride..])) { low = middle + 1 } else { high = middle }
    }
    low
}
