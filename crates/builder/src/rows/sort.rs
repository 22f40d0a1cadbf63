//! Sorts the rows of each bucket along the Morton curve, ties by the bytes of the row. Buckets are
//! cells in Morton order, so together they are sorted too; each fits the cache of a core.

use crate::rows::row::{copy_row, position};
use esker_points::{Cell, morton};
use rayon::prelude::*;

/// Rows of several runs are copied together first if they have at most this many bytes: half of a
/// common second-level cache.
const STAGED_BYTES: usize = 512 << 10;
/// Buckets with more rows are sorted by several tasks.
const TASK_ROWS: usize = 1 << 16;

/// Buffers for sorting a bucket, reused for the next one.
#[derive(Default)]
struct Staging {
    rows: Vec<u8>,
    keys: Vec<u64>,
}

/// Sorts the rows of buckets in Morton order into `out`, which is overwritten. Each bucket is given
/// as its runs; fewer than 2^32 rows in all.
pub fn sort(buckets: &[Vec<&[u8]>], stride: usize, out: &mut Vec<u8>) {
    let bytes = |runs: &Vec<&[u8]>| runs.iter().map(|r| r.len()).sum::<usize>();
    out.resize(buckets.iter().map(bytes).sum(), 0);
    let mut rest = out.as_mut_slice();
    let mut parts = Vec::with_capacity(buckets.len());
    for runs in buckets {
        let (part, behind) = std::mem::take(&mut rest).split_at_mut(bytes(runs));
        rest = behind;
        parts.push((runs, part));
    }
    parts.into_par_iter().for_each_init(Staging::default, |staging, (runs, part)| {
        let Staging { rows, keys } = staging;
        if runs.len() > 1 && part.len() <= STAGED_BYTES {
            rows.clear();
            runs.iter().for_each(|run| rows.extend_from_slice(run));
            Runs::new(&[rows], stride).sort(keys, part);
        } else {
            Runs::new(runs, stride).sort(keys, part);
        }
    });
}

/// The rows of a bucket, as runs of whole rows.
struct Runs<'a> {
    runs: &'a [&'a [u8]],
    /// Rows before each run.
    before: Vec<u32>,
    stride: usize,
    rows: usize,
}

impl<'a> Runs<'a> {
    fn new(runs: &'a [&'a [u8]], stride: usize) -> Self {
        let mut rows = 0;
        let count = |run: &&[u8]| {
            rows += run.len() / stride;
            (rows - run.len() / stride) as u32
        };
        let before = runs.iter().map(count).collect();
        Self { runs, before, stride, rows }
    }

    fn row(&self, index: u32) -> &'a [u8] {
        let run = self.before.partition_point(|&b| b <= index) - 1;
        &self.runs[run][(index - self.before[run]) as usize * self.stride..][..self.stride]
    }

    /// The smallest cell that holds all rows.
    fn cell(&self) -> Cell {
        let (mut min, mut max) = ([u32::MAX; 3], [0; 3]);
        for p in self.runs.iter().flat_map(|r| r.chunks_exact(self.stride)).map(position) {
            for axis in 0..3 {
                min[axis] = min[axis].min(p[axis]);
                max[axis] = max[axis].max(p[axis]);
            }
        }
        Cell::enclosing(min, max)
    }

    /// Sorts the rows into `out`, which they fill. A key has the upper bits of the code within the
    /// rows' own cell, as many as 64 bits leave beside the index of the row; rows with equal bits
    /// are compared.
    fn sort(&self, keys: &mut Vec<u64>, out: &mut [u8]) {
        if self.rows == 0 {
            return;
        }
        let cell = self.cell();
        let index_bits = usize::BITS - (self.rows - 1).leading_zeros();
        let dropped_bits = (3 * u32::from(cell.log2)).saturating_sub(64 - index_bits);
        let [x0, y0, z0] = cell.corner;
        let code = |[x, y, z]: [u32; 3]| {
            let p = [x ^ x0, y ^ y0, z ^ z0];
            if cell.log2 <= 21 {
                morton::encode3_21(p) >> dropped_bits
            } else {
                (morton::encode3(p) >> dropped_bits) as u64
            }
        };
        let key = |index: usize, row| code(position(row)) << index_bits | index as u64;
        keys.clear();
        for (run, &before) in self.runs.iter().zip(&self.before) {
            let rows = run.chunks_exact(self.stride).enumerate();
            keys.extend(rows.map(|(i, row)| key(before as usize + i, row)));
        }
        if self.rows > TASK_ROWS {
            keys.par_sort_unstable()
        } else {
            keys.sort_unstable()
        }
        self.sort_ties(keys, index_bits, dropped_bits > 0);
        let mask = (1u64 << index_bits) - 1;
        out.par_chunks_exact_mut(self.stride)
            .zip(keys)
            .with_min_len(TASK_ROWS)
            .for_each(|(slot, key)| copy_row(slot, self.row((*key & mask) as u32)));
    }

    /// Sorts keys that differ only in their index by their rows; each row is looked up once, not
    /// for each comparison. `is_truncated` states that keys have only part of the code; if they
    /// have all of it, rows with equal keys coincide.
    fn sort_ties(&self, keys: &mut [u64], index_bits: u32, is_truncated: bool) {
        let mask = (1u64 << index_bits) - 1;
        let mut rows: Vec<(u128, &[u8], u64)> = Vec::new();
        for tied in keys.chunk_by_mut(|a, b| (a ^ b) <= mask) {
            if tied.len() < 2 {
                continue;
            }
            rows.clear();
            rows.extend(tied.iter().map(|&key| {
                let row = self.row((key & mask) as u32);
                let code = if is_truncated { morton::encode3(position(row)) } else { 0 };
                (code, row, key)
            }));
            if rows.len() > TASK_ROWS {
                rows.par_sort_unstable();
            } else {
                rows.sort_unstable();
            }
            tied.iter_mut().zip(&rows).for_each(|(key, row)| *key = row.2);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rows::row::Rows;
    use crate::sample::candidates::tests::rows_of;
    use proptest::prelude::*;

    fn sorted(runs: Vec<&[u8]>, stride: usize) -> Vec<u8> {
        let mut out = Vec::new();
        sort(&[runs], stride, &mut out);
        out
    }

    /// A coordinate near others, far from others, or anywhere.
    fn coordinate() -> impl Strategy<Value = u32> {
        prop_oneof![0u32..9, (u32::MAX - 9)..=u32::MAX, any::<u32>()]
    }

    proptest! {
        #[test]
        fn sorting_does_not_depend_on_the_order_of_arrival(points in prop::collection::vec([coordinate(), coordinate(), coordinate()], 1..200), copies in 1usize..4, cut in 0usize..200) {
            // Position and one more byte as the rest of the record.
            let points = points.repeat(copies);
            let bytes: Vec<u8> = rows_of(&points).chunks(12).enumerate().flat_map(|(i, p)| [p, &[(i % 5) as u8]].concat()).collect();
            let reversed: Vec<u8> = bytes.chunks(13).rev().flatten().copied().collect();
            let (a, b) = bytes.split_at(cut.min(points.len()) * 13);
            let one = sorted(vec![a, b], 13);
            prop_assert_eq!(&one, &sorted(vec![&reversed], 13));
            let rows = Rows { bytes: &one, stride: 13 };
            for i in 1..rows.len() as u32 {
                let key = |i: u32| (morton::encode3(rows.position(i)), rows.row(i));
                prop_assert!(key(i - 1) <= key(i));
            }
            let mut all: Vec<&[u8]> = bytes.chunks(13).collect();
            let mut back: Vec<&[u8]> = one.chunks(13).collect();
            all.sort_unstable();
            back.sort_unstable();
            prop_assert_eq!(all, back);
        }
    }

    #[test]
    fn runs_too_large_to_be_staged_are_sorted_equally() {
        let points: Vec<_> =
            (0..200_000u32).map(|i| [i.wrapping_mul(2_654_435_761), i % 3, 7]).collect();
        let bytes = rows_of(&points);
        let (a, b) = bytes.split_at(12 * 77_777);
        assert!(bytes.len() > STAGED_BYTES && points.len() > TASK_ROWS);
        let one = sorted(vec![a, b], 12);
        assert!(one.chunks(12).map(|r| morton::encode3(position(r))).is_sorted());
        assert!(one == sorted(vec![&bytes], 12));
    }
}
