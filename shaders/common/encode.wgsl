// Conversion of linear light to sRGB bytes by a table. Needs a variable `encode_table`. Twin:
// `Encoder` in crates/render/src/inputs/colour.rs.

// Steps of the table between 0 and 1.
const ENCODE_STEPS: u32 = 8192u;

// Bytes of the table, four in a word.
struct EncodeTable {
    words: array<vec4<u32>, 513>,
}

// The byte of an amount of light, clamped to 0 to 1.
fn encoded(light: f32) -> u32 {
    let i = u32(clamp(light, 0.0, 1.0) * f32(ENCODE_STEPS) + 0.5);
    let word = encode_table.words[i / 16u][(i / 4u) % 4u];
    return (word >> (i % 4u * 8u)) & 0xffu;
}

// sRGB bytes of an opaque colour, linear light.
fn encoded_bytes(colour: vec3<f32>) -> u32 {
    return pack4xU8(vec4<u32>(encoded(colour.x), encoded(colour.y), encoded(colour.z), 255u));
}
