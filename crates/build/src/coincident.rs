//! More coincident points than memory holds, in the order of their records: a quicksort that compares
//! against bounds instead of moving rows, so that it needs passes rather than space.

use crate::error::BuildError;
use esker_points::Task;

/// Rows sampled for a pivot.
const SAMPLE_ROWS: u64 = 1024;

/// Rows of one lattice point.
pub struct Coincident<'a> {
    /// The rows, in whole runs.
    pub runs: Vec<&'a [u8]>,
    /// Bytes of a row.
    pub stride: usize,
    /// Rows that may be held in memory.
    pub rows_max: u64,
    /// Asked whether to stop.
    pub task: &'a dyn Task,
}

/// Takes a row.
type Take<'t> = dyn FnMut(&[u8]) -> Result<(), BuildError> + 't;

impl<'a> Coincident<'a> {
    /// Hands over all rows in order.
    ///
    /// # Errors
    /// Those of `take`; on request.
    pub fn in_order(&self, take: &mut Take<'_>) -> Result<(), BuildError> {
        self.between(None, None, take)
    }

    /// Hands over the rows between two bounds, both exclusive.
    fn between(
        &self,
        low: Option<&'a [u8]>,
        high: Option<&'a [u8]>,
        take: &mut Take<'_>,
    ) -> Result<(), BuildError> {
        self.task.check()?;
        let within = || {
            let rows = self.runs.iter().flat_map(|run| run.chunks_exact(self.stride));
            rows.filter(|r| low.is_none_or(|l| *r > l) && high.is_none_or(|h| *r < h))
        };
        let count = within().count() as u64;
        if count <= self.rows_max {
            let mut rows: Vec<&[u8]> = within().collect();
            rows.sort_unstable();
            return rows.into_iter().try_for_each(take);
        }
        let step = (count / SAMPLE_ROWS).max(1) as usize;
        let mut sample: Vec<&[u8]> = within().step_by(step).collect();
        sample.sort_unstable();
        // Never out of bounds: there are more rows than fit, so at least one was sampled.
        let pivot = sample[sample.len() / 2];
        self.between(low, Some(pivot), take)?;
        for row in within().filter(|r| *r == pivot) {
            take(row)?;
        }
        self.between(Some(pivot), high, take)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esker_points::task::Silent;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rows_come_in_order_whatever_memory_holds(rows in prop::collection::vec([0u8..4, 0u8..4], 0..300), rows_max in 1u64..50) {
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
