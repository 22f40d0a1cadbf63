// Means of the two halves of the samples of a picture. The shader that includes this declares
// `halves` (the sums of even samples, then those of odd ones) and `shares`.

// include common/usable.wgsl

struct Shares {
    pixels: u32,
    unused: u32,
    // One over the number of samples of each half.
    even: f32,
    odd: f32,
}

fn half_of(pixel: u32, is_odd: bool) -> vec3<f32> {
    if is_odd {
        return halves[shares.pixels + pixel].xyz * shares.odd;
    }
    return halves[pixel].xyz * shares.even;
}

// Whether a pixel was filtered, and both halves and the result are finite.
fn is_mixed(pixel: u32, light: vec4<f32>, filtered: vec4<f32>) -> bool {
    return light.w > 0.0
        && all_within(vec4<f32>(half_of(pixel, false), 0.0), VALUE_MAX)
        && all_within(vec4<f32>(half_of(pixel, true), 0.0), VALUE_MAX)
        && all_within(filtered, VALUE_MAX);
}
