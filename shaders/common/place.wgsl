// Positions of points against the anchor of the view (the eye, or the middle of the scan if the
// view is parallel), and hot positions. Needs common/draws.wgsl. Twin:
// crates/render/src/inputs/camera.rs.

// Position of a point against the anchor, steps, from its offset in the node's box. The parts above
// and below 2^16 are exact in f32, so that their sum rounds once.
fn steps_from_anchor(
    base_high: vec3<i32>,
    base_low: vec3<i32>,
    bias_steps: vec3<f32>,
    offset: vec3<u32>,
) -> vec3<f32> {
    let high = base_high + vec3<i32>(offset >> vec3<u32>(16u));
    let low = base_low + vec3<i32>(offset & vec3<u32>(0xffffu));
    return vec3<f32>(high) * 65536.0 + vec3<f32>(low) + bias_steps;
}

// Hot coordinates in the two words of a position.
fn hot_of(words: vec2<u32>) -> vec3<u32> {
    return vec3<u32>(words.x & 0xffffu, words.x >> 16u, words.y & 0xffffu);
}

// Radius code in the two words of a position.
fn radius_code_of(words: vec2<u32>) -> u32 {
    return (words.y >> 16u) & 0xffu;
}
