// Tables of a frame by which points are looked up, and the words of each pixel's point that the
// pass `gather/fetch` writes. Host: crates/render/src/gpu/memory/lookup.rs.

struct Lookup {
    // First values of the runs of colours, two a vector, as ordered doubles; unused runs begin
    // above all values.
    starts: array<vec4<u32>, 128>,
    // Colours of the runs, linear light.
    colours: array<vec4<f32>, 256>,
    // Linear light of each sRGB byte.
    linear: array<vec4<f32>, 64>,
    // Radius of each radius code, in units of the node's spacing.
    radius_factors: array<vec4<f32>, 64>,
    // Colour of points without colours.
    plain: vec4<f32>,
    // Colour of NaN.
    no_number: vec4<f32>,
    // Number of cells of the compact octree; 0 without one.
    cells: u32,
    unused_a: u32,
    unused_b: u32,
    unused_c: u32,
}

// include common/hits.wgsl

// Words of `geometry`: x and y are the hot position, z and w the residual bits, 16 bits an axis.
// Words of `paint`: x is the row of the node, with HAS_COLOUR if there is a colour; y and z are the
// value of the colour plane, w is the code of the normal.
const HAS_COLOUR: u32 = 0x80000000u;

// Offset of a point in its node's box, steps.
fn offset_of(geometry: vec4<u32>, shift: u32) -> vec3<u32> {
    return (hot_of(geometry.xy) << vec3<u32>(shift)) | hot_of(geometry.zw);
}
