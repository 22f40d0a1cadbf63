// A level of the pyramid. Its planes are buffers of a value a pixel: `front` has the least depth,
// the greatest depth, and the displacement from the ellipse's centre to the pixel's; `tint` has
// linear light and the radius. Lengths are in pixels of level 0. Host:
// crates/render/src/gpu/memory/pyramid.rs.

// include common/infinite.wgsl

struct LevelShape {
    // Width, pixels.
    width: u32,
    // Height, pixels.
    height: u32,
    // Edge of a pixel.
    edge_px: f32,
    unused: u32,
}

// Whether a pixel with this `front` shows a surface.
fn is_valid(front: vec4<f32>) -> bool {
    return !is_infinite(front.x);
}

// The `front` of a pixel without a surface.
fn invalid() -> vec4<f32> {
    return vec4<f32>(infinity(), infinity(), 0.0, 0.0);
}
