// Infinite depth: where there is nothing. WGSL has no literal for it, and compilers may take it that nothing is
// infinite: it is told by its bits.

const INFINITE_BITS: u32 = 0x7f800000u;

// Whether a value is infinite or no number.
fn is_infinite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) >= INFINITE_BITS;
}

// Compilers may also take it that everything is a number.
fn is_number(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) <= INFINITE_BITS;
}

fn infinity() -> f32 {
    // In a variable: what is constant is refused.
    var bits = INFINITE_BITS;
    return bitcast<f32>(bits);
}
