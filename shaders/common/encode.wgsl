// From linear light to sRGB bytes, by the table of crates/render/src/inputs/colour.rs. Needs a variable
// `encode_table`.

// Steps of the table from 0 to 1.
const ENCODE_STEPS: u32 = 8192u;

// Its bytes, four in a word.
struct EncodeTable {
    words: array<vec4<u32>, 513>,
}

// The byte of a share of light, clamped.
fn encoded(light: f32) -> u32 {
    let i = u32(clamp(light, 0.0, 1.0) * f32(ENCODE_STEPS) + 0.5);
    let word = encode_table.words[i / 16u][(i / 4u) % 4u];
    return (word >> (i % 4u * 8u)) & 0xffu;
}
