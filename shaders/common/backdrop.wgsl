// The background behind all surfaces. Needs common/frame.wgsl. Twin:
// crates/render/src/passes/resolve.rs.

// The background in row `y` of `height`, between the colours of the top and the bottom row; sRGB
// bytes in one word, red lowest.
fn backdrop(top: vec4<f32>, bottom: vec4<f32>, y: u32, height: u32) -> u32 {
    let share = (f32(y) + 0.5) / f32(height);
    let a = round(top * 255.0);
    let b = round(bottom * 255.0);
    return packed_bytes(vec4<u32>(a + (b - a) * share + 0.5));
}

// Four bytes in one word, the first lowest.
fn packed_bytes(bytes: vec4<u32>) -> u32 {
    return bytes.x | (bytes.y << 8u) | (bytes.z << 16u) | (bytes.w << 24u);
}
