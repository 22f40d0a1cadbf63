// Infinite depth, which means that there is no surface, and tests of floats by their bits: WGSL has
// no literal for infinity, and compilers may assume that no value is infinite or NaN.

const INFINITE_BITS: u32 = 0x7f800000u;

// Whether a value is infinite or NaN.
fn is_infinite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) >= INFINITE_BITS;
}

// Whether a value is not NaN.
fn is_number(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) <= INFINITE_BITS;
}

// Positive infinity.
fn infinity() -> f32 {
    // A variable, because WGSL refuses a constant expression that is infinite.
    var bits = INFINITE_BITS;
    return bitcast<f32>(bits);
}
