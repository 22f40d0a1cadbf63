// How far points crowd in a pixel: the last bits of the radius of its disc. Twin:
// crates/render/src/inputs/crowding.rs.

// Distances of points, pixels, from which and at which points crowd.
const CROWDED: vec2<f32> = vec2<f32>(1.0, 0.7);
// The code of points that crowd fully: the last six bits.
const CROWDING_MAX: u32 = 63u;

// The code of points at a distance on the picture.
fn crowding_code_at(spacing_px: f32) -> u32 {
    let crowding = clamp((spacing_px - CROWDED.x) / (CROWDED.y - CROWDED.x), 0.0, 1.0);
    return u32(crowding * f32(CROWDING_MAX) + 0.5);
}

// A radius with a code.
fn radius_with_crowding(radius_px: f32, code: u32) -> f32 {
    return bitcast<f32>((bitcast<u32>(radius_px) & ~CROWDING_MAX) | code);
}

// The code of a radius.
fn crowding_code(radius_px: f32) -> u32 {
    return bitcast<u32>(radius_px) & CROWDING_MAX;
}

// How far points crowd, 0 to 1, from a radius.
fn crowding_of(radius_px: f32) -> f32 {
    return f32(crowding_code(radius_px)) * (1.0 / f32(CROWDING_MAX));
}
