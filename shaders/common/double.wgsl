// Arithmetic on the bits of doubles, high word first, because WGSL has no `f64`: conversions to a
// double, exact or rounded to nearest even as on a CPU, and bits that compare as unsigned numbers
// like the doubles. So the runs of a colour map, which the host computes in `f64`, are found
// exactly.

// The double of a whole number below 2^64.
fn double_of_u64(v: vec2<u32>) -> vec2<u32> {
    if v.x == 0u && v.y == 0u {
        return vec2<u32>(0u);
    }
    let zeros = select(countLeadingZeros(v.x), 32u + countLeadingZeros(v.y), v.x == 0u);
    let n = shifted(v, zeros);
    // 53 bits are kept, of which the first is not stored; the 11 below them decide rounding.
    let dropped = n.y & 0x7ffu;
    var low = (n.x << 21u) | (n.y >> 11u);
    var high = (n.x >> 11u) & 0xfffffu;
    let up = dropped > 0x400u || (dropped == 0x400u && (low & 1u) == 1u);
    low += u32(up);
    // A carry out of the mantissa increases the exponent.
    high += u32(up && low == 0u);
    return vec2<u32>(((1086u - zeros) << 20u) + high, low);
}

// The double of a signed whole number of 64 bits.
fn double_of_i64(v: vec2<u32>) -> vec2<u32> {
    if (v.x >> 31u) == 0u {
        return double_of_u64(v);
    }
    let low = ~v.y + 1u;
    let magnitude = vec2<u32>(~v.x + u32(low == 0u), low);
    return double_of_u64(magnitude) | vec2<u32>(0x80000000u, 0u);
}

// The double of the `f32` with these bits.
fn double_of_f32(bits: u32) -> vec2<u32> {
    let sign = bits & 0x80000000u;
    let exponent = (bits >> 23u) & 0xffu;
    let mantissa = bits & 0x7fffffu;
    if exponent == 255u {
        return vec2<u32>(sign | 0x7ff00000u | (mantissa >> 3u), mantissa << 29u);
    }
    if exponent > 0u {
        return vec2<u32>(sign | ((exponent + 896u) << 20u) | (mantissa >> 3u), mantissa << 29u);
    }
    if mantissa == 0u {
        return vec2<u32>(sign, 0u);
    }
    let top = 31u - countLeadingZeros(mantissa);
    let whole = (mantissa << (23u - top)) & 0x7fffffu;
    return vec2<u32>(sign | ((874u + top) << 20u) | (whole >> 3u), whole << 29u);
}

// `v` shifted up by `by` bits, at most 63.
fn shifted(v: vec2<u32>, by: u32) -> vec2<u32> {
    if by == 0u {
        return v;
    }
    if by >= 32u {
        return vec2<u32>(v.y << (by - 32u), 0u);
    }
    return vec2<u32>((v.x << by) | (v.y >> (32u - by)), v.y << by);
}

// Whether the bits are those of NaN.
fn is_no_number(bits: vec2<u32>) -> bool {
    let high = bits.x & 0x7fffffffu;
    return high > 0x7ff00000u || (high == 0x7ff00000u && bits.y != 0u);
}

// Bits that compare as unsigned numbers like the doubles.
fn ordered(bits: vec2<u32>) -> vec2<u32> {
    return select(vec2<u32>(bits.x ^ 0x80000000u, bits.y), ~bits, (bits.x >> 31u) == 1u);
}
