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
    let side = (1u32 << AXIS_BITS) as f32;
    let scale = if size > 0.0 { side / size } else { 0.0 };
    keys.par_chunks_mut(TASK).enumerate().for_each(|(task, keys)| {
        dispatch!(Level::new(), _ => {
            for (i, keys) in keys.chunks_mut(LANES).enumerate() {
                let first = task * TASK + i * LANES;
                let mut places = [[0.0f32; LANES]; 3];
                let [x, y, z] = &mut places;
                let lanes = x.iter_mut().zip(y).zip(z).take(keys.len());
                for (k, ((x, y), z)) in lanes.enumerate() {
                    let at = centre(first + k);
                    (*x, *y, *z) = (at.x, at.y, at.z);
                }
                let mut cells = cells(&places, bounds.min, scale);
                transpose(&mut cells);
                let [x, y, z] = &cells;
                for (k, key) in keys.iter_mut().enumerate() {
                    let curve = spread(x[k]) << 2 | spread(y[k]) << 1 | spread(z[k]);
                    *key = curve << INDEX_BITS | (first + k) as u64;
                }
            }
        });
    });
    sort(&mut keys);
    keys.into_par_iter().map(|key| (key & ((1 << INDEX_BITS) - 1)) as u32).collect()
}

/// Cells that places lie in.
#[inline(always)]
fn cells(places: &[[f32; LANES]; 3], min: Vec3, scale: f32) -> [[u32; LANES]; 3] {
    let greatest = ((1 << AXIS_BITS) - 1) as f32;
    let mut cells = [[0; LANES]; 3];
    for axis in 0..3 {
        for k in 0..LANES {
            let at = (places[axis][k] - min[axis]) * scale;
            cells[axis][k] = at.max(0.0).min(greatest) as i32 as u32;
        }
    }
    cells
}

/// Turns cells into the transposed index of the curve: bit `b` of the three values are three
/// successive bits of the index. Loops run over lanes innermost, so that they become wide.
#[inline(always)]
fn transpose(cells: &mut [[u32; LANES]; 3]) {
    let [x, y, z] = cells;
    for b in (1..AXIS_BITS).rev() {
        for k in 0..LANES {
            let low = (1 << b) - 1;
            let is_set = |v: u32| 0u32.wrapping_sub(v >> b & 1);
            let mut v = x[k];
            v ^= low & is_set(v);
            let (invert, swap) = (low & is_set(y[k]), (v ^ y[k]) & low & !is_set(y[k]));
            (v, y[k]) = (v ^ invert ^ swap, y[k] ^ swap);
            let (invert, swap) = (low & is_set(z[k]), (v ^ z[k]) & low & !is_set(z[k]));
            (x[k], z[k]) = (v ^ invert ^ swap, z[k] ^ swap);
        }
    }
    let mut flip = [0; LANES];
    for k in 0..LANES {
        y[k] ^= x[k];
        z[k] ^= y[k];
    }
    for b in (1..AXIS_BITS).rev() {
        for k in 0..LANES {
            flip[k] ^= ((1 << b) - 1) & 0u32.wrapping_sub(z[k] >> b & 1);
        }
    }
    for k in 0..LANES {
        x[k] ^= flip[k];
        y[k] ^= flip[k];
        z[k] ^= flip[k];
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
