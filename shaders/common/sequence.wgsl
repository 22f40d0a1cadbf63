// Numbers for samples: pairs in [0, 1) by pixel, sample, dimension and seed, independent or along
// the picture's Z-order (`ahmed2020`). Twin, which explains it: crates/trace/src/paths/sequence.rs.
// The results are the same bits.

struct Sequence {
    seed: u32,
    // Binary logarithm of the number of samples of a pixel in the batch.
    log2_samples: u32,
    // Bits of the Z-order of the picture's pixels.
    pixel_bits: u32,
    // Whether samples are independent, not along the Z-order.
    is_independent: u32,
}

struct Sample {
    seed: u32,
    index: u32,
    bits: u32,
    is_independent: u32,
}

// Most bits of the Z-order of pixels.
const PIXEL_BITS: u32 = 24u;

fn mix_bits(x: u32) -> u32 {
    var v = x ^ (x >> 16u);
    v *= 0x7feb352du;
    v ^= v >> 15u;
    v *= 0x846ca68bu;
    return v ^ (v >> 16u);
}

fn unit(bits: u32) -> f32 {
    return f32(bits >> 8u) * (1.0 / 16777216.0);
}

fn spread(x: u32) -> u32 {
    var v = x & 0xffffu;
    v = (v | (v << 8u)) & 0x00ff00ffu;
    v = (v | (v << 4u)) & 0x0f0f0f0fu;
    v = (v | (v << 2u)) & 0x33333333u;
    return (v | (v << 1u)) & 0x55555555u;
}

fn sample_of(sequence: Sequence, x: u32, y: u32, number: u32) -> Sample {
    let bits = sequence.pixel_bits + sequence.log2_samples;
    if sequence.is_independent == 1u {
        let index = mix_bits(x ^ mix_bits(y ^ mix_bits(number)));
        return Sample(sequence.seed, index, bits, 1u);
    }
    let half_bits = PIXEL_BITS / 2u;
    let mask = (1u << sequence.pixel_bits) - 1u;
    let tile = mix_bits((x >> half_bits) | ((y >> half_bits) << 16u));
    let seed = select(sequence.seed ^ tile, sequence.seed, ((x | y) >> half_bits) == 0u);
    let order = (spread(x) | (spread(y) << 1u)) & mask;
    return Sample(seed, (order << sequence.log2_samples) | number, bits, 0u);
}

fn pascal(index: u32) -> u32 {
    var v = index;
    v ^= (v >> 1u) & 0x55555555u;
    v ^= (v >> 2u) & 0x33333333u;
    v ^= (v >> 4u) & 0x0f0f0f0fu;
    v ^= (v >> 8u) & 0x00ff00ffu;
    return v ^ ((v >> 16u) & 0x0000ffffu);
}

fn nested(x: u32, seed: u32) -> u32 {
    var v = x ^ (x * 0x3d20adeau);
    v += seed;
    v *= (seed >> 16u) | 1u;
    v ^= v * 0x05526c56u;
    return v ^ (v * 0x53a22864u);
}

// Pair of numbers of a dimension.
fn pair(sample: Sample, dimension: u32) -> vec2<f32> {
    let seed = mix_bits(sample.seed ^ (dimension * 0x9e3779b9u));
    if sample.is_independent == 1u {
        let a = mix_bits(sample.index ^ seed);
        let turned = (seed << 16u) | (seed >> 16u);
        return vec2<f32>(unit(a), unit(mix_bits(a ^ 0x68bc21ebu ^ turned)));
    }
    let shift = 32u - clamp(sample.bits, 1u, 32u);
    let shuffled = reverseBits(nested(reverseBits(sample.index) >> shift, seed)) >> shift;
    let x = nested(shuffled, seed ^ 0xb5297a4du);
    let y = nested(pascal(shuffled), seed ^ 0x1b56c4e9u);
    return vec2<f32>(unit(reverseBits(x)), unit(reverseBits(y)));
}

// Pair number `part` of `2^log2` pairs of a dimension that are stratified together.
fn part(sample: Sample, dimension: u32, number: u32, log2: u32) -> vec2<f32> {
    var one = sample;
    if sample.is_independent == 1u {
        one.index = mix_bits(sample.index ^ mix_bits(number + 0x51ed270bu));
    } else {
        one.index = (sample.index << log2) | number;
    }
    one.bits = sample.bits + log2;
    return pair(one, dimension);
}
