// Sums of the albedo of samples that look a pixel up, packed into two words: 21 bits each of red,
// green and blue, so that they take half the memory of floats.

// Steps of an albedo of 1, and most samples of a pixel: their product has 21 bits.
const ALBEDO_STEPS: f32 = 2047.0;
const SAMPLES_MAX: u32 = 1024u;
// Bits of red, and of green in the first word.
const RED_BITS: u32 = 21u;
const GREEN_LOW_BITS: u32 = 11u;

// The sum with another albedo.
fn with_albedo(sum: vec2<u32>, albedo: vec3<f32>) -> vec2<u32> {
    let steps = vec3<u32>(clamp(albedo, vec3<f32>(0.0), vec3<f32>(1.0)) * ALBEDO_STEPS + 0.5);
    let low = steps.x | (steps.y << RED_BITS);
    let high = (steps.y >> GREEN_LOW_BITS) | (steps.z << (RED_BITS - GREEN_LOW_BITS));
    let added = sum.x + low;
    return vec2<u32>(added, sum.y + high + u32(added < low));
}

// Red, green and blue of a sum.
fn albedo_sum(sum: vec2<u32>) -> vec3<f32> {
    let red = sum.x & ((1u << RED_BITS) - 1u);
    let green_high = sum.y & ((1u << (RED_BITS - GREEN_LOW_BITS)) - 1u);
    let green = (sum.x >> RED_BITS) | (green_high << GREEN_LOW_BITS);
    let blue = sum.y >> (RED_BITS - GREEN_LOW_BITS);
    return vec3<f32>(vec3<u32>(red, green, blue)) / ALBEDO_STEPS;
}
