// What is made once a frame to look points up (crates/render/src/gpu/lookup.rs has the same structure), and what
// the pass `gather/fetch` leaves for each pixel.

struct Lookup {
    // Where runs of values begin, two a vector, as ordered doubles; those not used are above all values.
    starts: array<vec4<u32>, 128>,
    // Colours of the runs, linear light.
    colours: array<vec4<f32>, 256>,
    // Linear light of sRGB bytes.
    linear: array<vec4<f32>, 64>,
    // Radii that codes stand for, in units of the node's spacing.
    radius_factors: array<vec4<f32>, 64>,
    // Colour of points that have none.
    plain: vec4<f32>,
    // Colour of values that are no number.
    no_number: vec4<f32>,
    // Cells of the compact octree; 0 without one.
    cells: u32,
    unused_a: u32,
    unused_b: u32,
    unused_c: u32,
}

// include common/hits.wgsl

// Of `geometry`: x and y are the position's words, z and w the dropped bits, x y and z in 16 bits each.
// Of `paint`: x is the draw and HAS_COLOUR, y and z the colour plane's value, w the normal's code.
const HAS_COLOUR: u32 = 0x80000000u;

// Offset of a point in its node's box.
fn offset_of(geometry: vec4<u32>, shift: u32) -> vec3<u32> {
    return (hot_of(geometry.xy) << vec3<u32>(shift)) | hot_of(geometry.zw);
}
