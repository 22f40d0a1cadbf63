//! Sorts the rows of coincident points of which there are more than memory holds: a sample gives
//! pivots, and each pass over all rows sorts those between two pivots. Needs no scratch space.

use crate::error::BuildError;
use esker_points::Task;
use rayon::prelude::*;

/// Rows sampled for each pivot.
const SAMPLE_ROWS: u64 = 64;
/// Least number of rows that a thread reads.
const TASK_ROWS: usize = 1 << 14;
/// Parts of as many rows that are read together.
const GROUP_TASKS: usize = 32;
/// Rows that any bound of memory can hold references to at a time, beside what a build needs
/// anyway: 64 MiB of the least bound, 256 MiB.
pub const ROWS_MIN: u64 = 1 << 22;

/// Rows of one lattice point.
pub struct Coincident<'a> {
    /// The rows, as runs of whole rows.
    pub runs: Vec<&'a [u8]>,
    /// Bytes of a row.
    pub stride: usize,
    /// Most rows in memory.
    pub rows_max: u64,
    /// Says whether to stop.
    pub task: &'a dyn Task,
}

/// Called with each row.
type Take<'t> = dyn FnMut(&[u8]) -> Result<(), BuildError> + 't;

impl<'a> Coincident<'a> {
    /// Calls `take` with all rows in order.
    ///
    /// # Errors
    /// If `take` fails, or on request.
    pub fn in_order(&self, take: &mut Take<'_>) -> Result<(), BuildError> {
        let rows = self.runs.iter().map(|run| (run.len() / self.stride) as u64).sum();
        self.between([None; 2], rows, take)
    }

    /// Calls `take` with the `count` rows between two bounds, both exclusive.
    fn between(
        &self,
        bounds: [Option<&'a [u8]>; 2],
        count: u64,
        take: &mut Take<'_>,
    ) -> Result<(), BuildError> {
        self.task.check()?;
        if count == 0 {
            return Ok(());
        }
        if count <= self.rows_max {
            let mut rows = self.gathered(bounds, count);
            rows.par_sort_unstable();
            return rows.into_iter().try_for_each(take);
        }
        let pivots = self.pivots(bounds, count);
        let counts = self.counts(bounds, &pivots);
        let mut low = bounds[0];
        for (i, &count) in counts.iter().enumerate() {
            let pivot = pivots.get(i / 2).copied();
            match pivot {
                // All of these rows are equal.
                Some(pivot) if i % 2 == 1 => {
                    self.task.check()?;
                    (0..count).try_for_each(|_| take(pivot))?;
                    low = Some(pivot);
                }
                _ => self.between([low, pivot.or(bounds[1])], count, take)?,
            }
        }
        Ok(())
    }

    /// The `count` rows between two bounds. Group by group, so that no second list of all of them
    /// is needed.
    fn gathered(&self, bounds: [Option<&'a [u8]>; 2], count: u64) -> Vec<&'a [u8]> {
        let mut rows = Vec::with_capacity(count as usize);
        let tasks = |run: &&'a [u8]| run.chunks(TASK_ROWS * self.stride);
        let tasks: Vec<&[u8]> = self.runs.iter().flat_map(tasks).collect();
        for group in tasks.chunks(GROUP_TASKS) {
            let of_task = |run: &&'a [u8]| -> Vec<&'a [u8]> {
                run.chunks_exact(self.stride).filter(|row| is_within(row, bounds)).collect()
            };
            let found: Vec<_> = group.par_iter().map(of_task).collect();
            found.iter().for_each(|some| rows.extend_from_slice(some));
        }
        rows
    }

    /// The rows between two bounds.
    fn within(&self, bounds: [Option<&'a [u8]>; 2]) -> impl ParallelIterator<Item = &'a [u8]> {
        let rows = self
            .runs
            .par_iter()
            .flat_map(|run| run.par_chunks_exact(self.stride).with_min_len(TASK_ROWS));
        rows.filter(move |row| is_within(row, bounds))
    }

    /// Rows between two bounds, at least one of `count`, ascending. Mostly memory holds the rows
    /// between two neighbouring pivots.
    fn pivots(&self, bounds: [Option<&'a [u8]>; 2], count: u64) -> Vec<&'a [u8]> {
        let parts = count.div_ceil(self.rows_max).saturating_mul(2);
        let wanted = parts.saturating_mul(SAMPLE_ROWS);
        let sample = |step: usize| {
            let rows = self.runs.iter().flat_map(|run| run.chunks_exact(self.stride)).step_by(step);
            let within = rows.filter(|row| is_within(row, bounds));
            within.take(wanted.saturating_mul(2) as usize).collect::<Vec<_>>()
        };
        // An odd step: rows often alternate, as returns of pulses do.
        let mut rows = sample((count / wanted) as usize | 1);
        if rows.is_empty() {
            rows = sample(1);
        }
        rows.par_sort_unstable();
        let pivot = |part: u64| rows[(part * rows.len() as u64 / parts) as usize];
        let mut pivots: Vec<&[u8]> = (1..parts).map(pivot).collect();
        pivots.dedup();
        pivots
    }

    /// Counts the rows between two bounds that are before the first pivot, equal to it, between it
    /// and the next one, and so on.
    fn counts(&self, bounds: [Option<&'a [u8]>; 2], pivots: &[&[u8]]) -> Vec<u64> {
        let none = || vec![0; 2 * pivots.len() + 1];
        let count = |mut counts: Vec<u64>, row: &[u8]| {
            let index = pivots.binary_search(&row).map_or_else(|i| 2 * i, |i| 2 * i + 1);
            counts[index] += 1;
            counts
        };
        let add = |mut a: Vec<u64>, b: Vec<u64>| {
            a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
            a
        };
        self.within(bounds).fold(none, count).reduce(none, add)
    }
}

fn is_within(row: &[u8], [low, high]: [Option<&[u8]>; 2]) -> bool {
    low.is_none_or(|low| row > low) && high.is_none_or(|high| row < high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use esker_points::task::Silent;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rows_are_sorted_whatever_memory_holds(rows in prop::collection::vec([0u8..4, 0u8..4], 0..300), rows_max in 1u64..50) {
            let bytes: Vec<u8> = rows.iter().flatten().copied().collect();
            let runs = bytes.chunks(14).collect();
            let mut out = Vec::new();
            Coincident { runs, stride: 2, rows_max, task: &Silent }
                .in_order(&mut |row| { out.push([row[0], row[1]]); Ok(()) })
                .unwrap();
            let mut sorted = rows;
            sorted.sort_unstable();
            prop_assert_eq!(out, sorted);
        }
    }
}
