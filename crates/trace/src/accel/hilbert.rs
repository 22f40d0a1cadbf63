//! Order of primitives along a Hilbert curve through their centres (`skilling2004`), by a parallel
//! radix sort. Runs of the order are compact in space, so that they make good leaves and nodes.

use crate::accel::bounds::Bounds;
use fearless_simd::{Level, dispatch};
use glam::Vec3;
use rayon::prelude::*;

/// Bits of a key for each axis: 2048 cells along a building of 40 m are as fine as its points.
const AXIS_BITS: u32 = 11;
/// Bits of the index below the key.
const INDEX_BITS: u32 = 31;
/// Bits that the sort takes at once: three passes over the key, whose counters fit the L1 cache.
const DIGIT_BITS: u32 = 11;
const DIGITS: usize = 1 << DIGIT_BITS;
/// Centres whose keys are computed together.
const LANES: usize = 8;
/// Centres of a task that computes keys.
const TASK: usize = 1 << 14;

/// Indices of `count` centres in the order of the curve that fills `bounds`. Centres of the same
/// cell keep their order, so the result does not depend on the number of threads.
pub fn order(count: usize, bounds: &Bounds, centre: impl Fn(usize) -> Vec3 + Sync) -> Vec<u32> {
    assert!(count <= 1 << INDEX_BITS, "too many primitives for one tree");
    let mut keys = vec![0u64; count];
    // One scale for all axes: cells are cubes.
    let size = (bounds.max - bounds.min).max_element();
    let cells = (1u32 << AXIS_BITS) as f32;
    let scale = if size > 0.0 { cells / size } else { 0.0 };
    keys.par_chunks_mut(TASK).enumerate().for_each(|(task, keys)| {
        dispatch!(Level::new(), _ => {
            for (i, keys) in keys.chunks_mut(LANES).enumerate() {
                let first = task * TASK + i * LANES;
                let mut cells = [[0u32; LANES]; 3];
                for k in 0..keys.len() {
                    let at = (centre(first + k) - bounds.min) * scale;
                    for axis in 0..3 {
                        cells[axis][k] = (at[axis] as u32).min((1 << AXIS_BITS) - 1);
                    }
                }
                transpose(&mut cells);
                for (k, key) in keys.iter_mut().enumerate() {
                    let [x, y, z] = [0, 1, 2].map(|axis| spread(cells[axis][k]));
                    *key = (x << 2 | y << 1 | z) << INDEX_BITS | (first + k) as u64;
                }
            }
        });
    });
    sort(&mut keys);
    keys.into_par_iter().map(|key| (key & ((1 << INDEX_BITS) - 1)) as u32).collect()
}

/// Turns cells into the transposed index of the curve: bit `b` of the three values are three
/// successive bits of the index.
#[inline(always)]
fn transpose(cells: &mut [[u32; LANES]; 3]) {
    let [x, y, z] = cells;
    for k in 0..LANES {
        let mut v = [x[k], y[k], z[k]];
        for b in (1..AXIS_BITS).rev() {
            let low = (1 << b) - 1;
            for i in 0..3 {
                let is_set = 0u32.wrapping_sub(v[i] >> b & 1);
                let swap = (v[0] ^ v[i]) & low & !is_set;
                v[0] ^= low & is_set;
                v[0] ^= swap;
                // For the first axis nothing is swapped.
                v[i] ^= swap;
            }
        }
        v[1] ^= v[0];
        v[2] ^= v[1];
        let mut flip = 0;
        for b in (1..AXIS_BITS).rev() {
            flip ^= ((1 << b) - 1) & 0u32.wrapping_sub(v[2] >> b & 1);
        }
        [x[k], y[k], z[k]] = v.map(|v| v ^ flip);
    }
}

/// Spreads the bits of a value to every third bit.
#[inline(always)]
fn spread(value: u32) -> u64 {
    let mut v = u64::from(value);
    v = (v | v << 16) & 0x00ff_0000_ff00_00ff;
    v = (v | v << 8) & 0x0_f00f_00f0_0f00_f00f;
    v = (v | v << 4) & 0x30c3_0c30_c30c_30c3;
    (v | v << 2) & 0x9249_2492_4924_9249
}

/// Sorts by the bits above the index.
fn sort(keys: &mut Vec<u64>) {
    let mut other = vec![0u64; keys.len()];
    for pass in 0..(3 * AXIS_BITS).div_ceil(DIGIT_BITS) {
        scatter(keys, &mut other, INDEX_BITS + pass * DIGIT_BITS);
        std::mem::swap(keys, &mut other);
    }
}

/// One stable pass of the sort: each thread writes its part of the keys to places of its own.
fn scatter(from: &[u64], to: &mut [u64], shift: u32) {
    let digit = |key: u64| (key >> shift) as usize % DIGITS;
    let size = from.len().div_ceil(rayon::current_num_threads()).max(1);
    let counts: Vec<Vec<u32>> = from
        .par_chunks(size)
        .map(|keys| {
            let mut counts = vec![0; DIGITS];
            keys.iter().for_each(|&key| counts[digit(key)] += 1);
            counts
        })
        .collect();
    let mut places: Vec<Vec<&mut [u64]>> =
        counts.iter().map(|_| Vec::with_capacity(DIGITS)).collect();
    let mut rest = to;
    for d in 0..DIGITS {
        for (counts, places) in counts.iter().zip(&mut places) {
            let (own, others) = rest.split_at_mut(counts[d] as usize);
            places.push(own);
            rest = others;
        }
    }
    from.par_chunks(size).zip(places).for_each(|(keys, mut places)| {
        for &key in keys {
            let place = &mut places[digit(key)];
            if let Some((first, others)) = std::mem::take(place).split_first_mut() {
                *first = key;
                *place = others;
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit() -> Bounds {
        Bounds { min: Vec3::ZERO, max: Vec3::ONE }
    }

    #[test]
    fn successive_cells_of_the_curve_are_neighbours() {
        let side = 16;
        let cell = |i: usize| [i % side, i / side % side, i / side / side];
        let centre = |i: usize| Vec3::from_array(cell(i).map(|c| (c as f32 + 0.5) / side as f32));
        let order = order(side * side * side, &unit(), centre);
        for pair in order.windows(2) {
            let [a, b] = [cell(pair[0] as usize), cell(pair[1] as usize)];
            let steps: usize = (0..3).map(|k| a[k].abs_diff(b[k])).sum();
            assert_eq!(steps, 1, "{a:?} {b:?}");
        }
    }

    #[test]
    fn the_order_is_a_permutation_for_any_number_of_threads() {
        let centre = |i: usize| {
            let h = (i as u32).wrapping_mul(2_654_435_761);
            Vec3::new((h & 1023) as f32, (h >> 10 & 1023) as f32, (h >> 22) as f32) / 1024.0
        };
        let of = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| order(40_000, &unit(), centre))
        };
        let one = of(1);
        assert_eq!(one, of(3));
        let mut sorted = one;
        sorted.sort_unstable();
        assert!(sorted.iter().enumerate().all(|(i, &s)| i == s as usize));
    }

    #[test]
    fn coincident_centres_keep_their_order() {
        let flat = Bounds { min: Vec3::ONE, max: Vec3::ONE };
        assert_eq!(order(1000, &flat, |_| Vec3::ONE), (0..1000).collect::<Vec<u32>>());
        assert!(order(0, &Bounds::EMPTY, |_| Vec3::ONE).is_empty());
    }
}
