// White noise that goes through the filters beside the light, so that it shows how much noise they
// leave. Twin: crates/trace/src/filter/nested.rs.

// Variance one: a random sign, by the hash `lowbias32` (Wellons) of the pixel.
fn white(pixel: u32) -> f32 {
    var hash = pixel;
    hash = (hash ^ hash >> 16u) * 0x7feb352du;
    hash = (hash ^ hash >> 15u) * 0x846ca68bu;
    return select(-1.0, 1.0, ((hash ^ hash >> 16u) & 1u) == 0u);
}
