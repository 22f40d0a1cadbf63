// Colours of the points of pixels, from their fetched words. Needs common/colour.wgsl,
// common/place.wgsl, and variables `geometry` and `paint`. Twin: `Lookup::colour_of` in
// crates/render/src/inputs/lookup.rs.

// The colour of a pixel's point, linear light.
fn point_colour(pixel: u32, depth_bits: u32) -> vec3<f32> {
    let words = paint[pixel];
    var coordinate = vec2<u32>(0u);
    if is_by_coordinate() {
        let draw = words.x & ~HAS_COLOUR;
        let offset = offset_of(geometry[pixel], draws[draw].shift);
        coordinate = coordinate_of(draws[draw].box_min + offset, offset);
    }
    return colour_of(words, coordinate, depth_bits);
}
