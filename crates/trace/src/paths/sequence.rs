//! Numbers for samples: pairs in [0, 1) by pixel, sample, dimension and seed. Independent ones are
//! hashed. Those along the picture's Z-order (`ahmed2020`) are points of one scrambled Sobol'
//! sequence, so that the errors of neighbouring pixels cancel under a filter.
//!
//! The order is shuffled, and points are scrambled, by nested random flips (Owen 1995), computed by
//! a hash in which bits depend on lower bits only (Laine and Karras 2011); the second coordinate of
//! a point is a product with Pascal's matrix. So no table is needed.

/// How samples of neighbouring pixels relate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Sequence {
    /// Stratified along the picture's Z-order.
    #[default]
    ZOrder,
    /// Independent of each other.
    Independent,
}

/// Most bits of the Z-order of pixels: pictures of up to 4096 pixels a side. Larger ones repeat it.
const PIXEL_BITS: u32 = 24;

/// Numbers of a batch of samples of a picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sampler {
    sequence: Sequence,
    seed: u32,
    /// Binary logarithm of the number of samples of a pixel in the batch.
    log2_samples: u32,
    /// Number of bits of the Z-order of the picture's pixels.
    pixel_bits: u32,
}

/// One sample of one pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    seed: u32,
    sequence: Sequence,
    index: u32,
    bits: u32,
}

impl Sampler {
    /// Numbers of batch `batch` of `2^log2_samples` samples of each pixel.
    pub(crate) fn new(
        sequence: Sequence,
        seed: u64,
        batch: u32,
        log2_samples: u32,
        size: [usize; 2],
    ) -> Self {
        let side = size[0].max(size[1]).max(1).next_power_of_two() as u64;
        let seed = mix(seed as u32 ^ mix((seed >> 32) as u32 ^ mix(batch)));
        Self {
            sequence,
            seed,
            log2_samples,
            pixel_bits: (side.trailing_zeros() * 2).min(PIXEL_BITS),
        }
    }

    /// Seed, binary logarithm of the samples of a pixel, bits of the Z-order, and whether samples
    /// are independent.
    pub(crate) fn parts(&self) -> [u32; 4] {
        let is_independent = u32::from(self.sequence == Sequence::Independent);
        [self.seed, self.log2_samples, self.pixel_bits, is_independent]
    }

    /// Most samples a pixel of a batch, as a binary logarithm: what fits into 32 bits with the
    /// pixels and with `2^parts_log2` parts of each sample.
    pub(crate) fn log2_samples_max(size: [usize; 2], parts_log2: u32) -> u32 {
        let sampler = Self::new(Sequence::ZOrder, 0, 0, 0, size);
        32 - sampler.pixel_bits - parts_log2.min(32 - PIXEL_BITS)
    }

    /// Sample `number` of the batch at a pixel.
    pub(crate) fn sample(&self, x: u32, y: u32, number: u32) -> Sample {
        let (code, seed) = match self.sequence {
            Sequence::ZOrder => {
                let mask = ((1u64 << self.pixel_bits) - 1) as u32;
                let half = PIXEL_BITS / 2;
                // Pictures that are too large are tiled, each tile with other numbers.
                let tile = mix((x >> half) | (y >> half) << 16);
                let seed = if (x | y) >> half == 0 { self.seed } else { self.seed ^ tile };
                ((morton(x, y) & mask) << self.log2_samples | number, seed)
            }
            Sequence::Independent => (mix(x ^ mix(y ^ mix(number))), self.seed),
        };
        Sample {
            seed,
            sequence: self.sequence,
            index: code,
            bits: self.pixel_bits + self.log2_samples,
        }
    }
}

impl Sample {
    /// Pair of numbers of a dimension.
    pub(crate) fn pair(&self, dimension: u32) -> [f32; 2] {
        let seed = mix(self.seed ^ dimension.wrapping_mul(0x9e37_79b9));
        match self.sequence {
            Sequence::ZOrder => z_order(self.index, self.bits, seed),
            Sequence::Independent => independent(self.index, seed),
        }
    }

    /// Pair number `part` of `2^log2` pairs of a dimension that are stratified together.
    pub(crate) fn part(&self, dimension: u32, part: u32, log2: u32) -> [f32; 2] {
        let index = match self.sequence {
            Sequence::ZOrder => self.index << log2 | part,
            Sequence::Independent => mix(self.index ^ mix(part.wrapping_add(0x51ed_270b))),
        };
        Self { index, bits: self.bits + log2, ..*self }.pair(dimension)
    }
}

fn independent(index: u32, seed: u32) -> [f32; 2] {
    let a = mix(index ^ seed);
    let b = mix(a ^ 0x68bc_21eb ^ seed.rotate_left(16));
    [unit(a), unit(b)]
}

fn z_order(index: u32, bits: u32, seed: u32) -> [f32; 2] {
    // In reversed bits the most significant bit of the index, which chooses the largest block of
    // pixels, is the lowest: blocks are flipped by what chooses the blocks around them.
    let shift = 32 - bits.clamp(1, 32);
    let shuffled = nested(index.reverse_bits() >> shift, seed).reverse_bits() >> shift;
    let x = nested(shuffled, seed ^ 0xb529_7a4d);
    let y = nested(pascal(shuffled), seed ^ 0x1b56_c4e9);
    [unit(x.reverse_bits()), unit(y.reverse_bits())]
}

/// Second coordinate of the Sobol' sequence with its first bit lowest: the product of Pascal's
/// matrix modulo 2 with the index, by the factors of a power of it.
fn pascal(index: u32) -> u32 {
    let mut v = index;
    v ^= (v >> 1) & 0x5555_5555;
    v ^= (v >> 2) & 0x3333_3333;
    v ^= (v >> 4) & 0x0f0f_0f0f;
    v ^= (v >> 8) & 0x00ff_00ff;
    v ^ ((v >> 16) & 0x0000_ffff)
}

/// Flips each bit by a hash of the lower bits: nested uniform scrambling of the reversed number.
/// The constants are those of Vegdahl (2021), who searched for little bias.
fn nested(x: u32, seed: u32) -> u32 {
    let mut v = x ^ x.wrapping_mul(0x3d20_adea);
    v = v.wrapping_add(seed);
    v = v.wrapping_mul((seed >> 16) | 1);
    v ^= v.wrapping_mul(0x0552_6c56);
    v ^ v.wrapping_mul(0x53a2_2864)
}

/// Hash of 32 bits with all bits mixed (`lowbias32` of Wellons).
pub(crate) fn mix(x: u32) -> u32 {
    let mut v = x ^ (x >> 16);
    v = v.wrapping_mul(0x7feb_352d);
    v ^= v >> 15;
    v = v.wrapping_mul(0x846c_a68b);
    v ^ (v >> 16)
}

/// The number of [0, 1) with the upper 24 bits.
fn unit(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Z-order of a pixel: the lower 16 bits of both coordinates in turn.
fn morton(x: u32, y: u32) -> u32 {
    let spread = |v: u32| {
        let mut v = v & 0xffff;
        v = (v | v << 8) & 0x00ff_00ff;
        v = (v | v << 4) & 0x0f0f_0f0f;
        v = (v | v << 2) & 0x3333_3333;
        (v | v << 1) & 0x5555_5555
    };
    spread(x) | spread(y) << 1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether `2^bits` points lie one each in all elementary boxes of area `2^-bits`.
    fn is_net(points: &[[f32; 2]]) -> bool {
        let bits = points.len().trailing_zeros();
        (0..=bits).all(|wide| {
            let mut seen = vec![false; points.len()];
            for point in points {
                let x = (point[0] * (1u32 << wide) as f32) as usize;
                let y = (point[1] * (1u32 << (bits - wide)) as f32) as usize;
                seen[y << wide | x] = true;
            }
            seen.iter().all(|&seen| seen)
        })
    }

    fn block(sampler: &Sampler, [x, y]: [u32; 2], side: u32, samples: u32) -> Vec<[f32; 2]> {
        let mut points = Vec::new();
        for j in y..y + side {
            for i in x..x + side {
                points.extend((0..samples).map(|s| sampler.sample(i, j, s).pair(5)));
            }
        }
        points
    }

    #[test]
    fn aligned_blocks_of_pixels_and_samples_are_nets() {
        for seed in 0..4 {
            let sampler = Sampler::new(Sequence::ZOrder, seed, 0, 2, [640, 480]);
            for (corner, side) in [([0, 0], 1), ([34, 6], 2), ([96, 128], 8), ([64, 32], 32)] {
                assert!(is_net(&block(&sampler, corner, side, 4)), "{corner:?} {side}");
            }
            assert!(is_net(&block(&sampler, [7, 9], 1, 2)), "half of the samples of a pixel");
            assert!(!is_net(&block(&sampler, [33, 6], 2, 4)), "unaligned");
        }
    }

    #[test]
    fn parts_of_a_sample_are_nets_and_so_are_those_of_a_block() {
        let sampler = Sampler::new(Sequence::ZOrder, 3, 1, 0, [64, 64]);
        let parts = |x, y| (0..4).map(move |k| sampler.sample(x, y, 0).part(9, k, 2));
        let one: Vec<_> = parts(5, 8).collect();
        assert!(is_net(&one));
        let four: Vec<_> =
            [(8, 8), (9, 8), (8, 9), (9, 9)].into_iter().flat_map(|(x, y)| parts(x, y)).collect();
        assert!(is_net(&four));
    }

    #[test]
    fn both_sequences_are_uniform_and_dimensions_are_unrelated() {
        for sequence in [Sequence::ZOrder, Sequence::Independent] {
            let sampler = Sampler::new(sequence, 1, 0, 0, [64, 64]);
            let count = 64.0 * 64.0;
            let (mut mean, mut product, mut across) = ([0.0f64; 2], 0.0f64, 0.0f64);
            for y in 0..64 {
                for x in 0..64 {
                    let sample = sampler.sample(x, y, 0);
                    let (a, b) = (sample.pair(0), sample.pair(1));
                    assert!(a.iter().chain(&b).all(|u| (0.0..1.0).contains(u)));
                    mean[0] += f64::from(a[0]) / count;
                    mean[1] += f64::from(a[1]) / count;
                    product += f64::from((a[0] - 0.5) * (a[1] - 0.5)) / count;
                    across += f64::from((a[0] - 0.5) * (b[0] - 0.5)) / count;
                }
            }
            // Five standard errors of independent numbers: 5 * sqrt(1/12) / 64, 5 / 12 / 64.
            assert!(mean.iter().all(|mean| (mean - 0.5).abs() < 0.0226), "{mean:?}");
            assert!(product.abs() < 0.0065, "{product}");
            assert!(across.abs() < 0.0065, "{across}");
        }
    }

    #[test]
    fn seeds_batches_and_tiles_of_large_pictures_differ() {
        let sampler = |seed, batch| Sampler::new(Sequence::ZOrder, seed, batch, 0, [9000, 20]);
        let first = sampler(1, 0).sample(3, 4, 0).pair(0);
        assert_eq!(first, sampler(1, 0).sample(3, 4, 0).pair(0));
        assert_ne!(first, sampler(2, 0).sample(3, 4, 0).pair(0));
        assert_ne!(first, sampler(1 << 32 | 1, 0).sample(3, 4, 0).pair(0));
        assert_ne!(first, sampler(1, 1).sample(3, 4, 0).pair(0));
        assert_ne!(first, sampler(1, 0).sample(4096 + 3, 4, 0).pair(0));
    }

    #[test]
    fn pascal_product_is_the_second_sobol_coordinate() {
        // First direction numbers of the second dimension (Joe and Kuo 2008), reversed.
        let numbers = [0x8000_0000u32, 0xc000_0000, 0xa000_0000, 0xf000_0000, 0x8800_0000];
        for (j, number) in numbers.into_iter().enumerate() {
            assert_eq!(pascal(1 << j).reverse_bits(), number);
        }
        for (a, b) in [(5, 9), (77, 1 << 31), (u32::MAX, 12345)] {
            assert_eq!(pascal(a ^ b), pascal(a) ^ pascal(b), "linear");
        }
    }
}
