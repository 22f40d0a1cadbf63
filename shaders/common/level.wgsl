// A level of the pyramid (crates/render/src/gpu/pyramid.rs has the same structure). Planes are flat, a value
// a pixel; `front` is the least depth, the greatest depth, and the displacement from the ellipse's centre to
// the pixel's; `tint` linear light and the radius. Lengths are in pixels of level 0.

// include common/infinite.wgsl

struct LevelShape {
    // Pixels in a row.
    width: u32,
    // Rows.
    height: u32,
    // Edge of its pixels.
    edge_px: f32,
    unused: u32,
}

// Whether a pixel with this `front` holds a surface.
fn is_valid(front: vec4<f32>) -> bool {
    return !is_infinite(front.x);
}

// `front` of an invalid pixel.
fn invalid() -> vec4<f32> {
    return vec4<f32>(infinity(), infinity(), 0.0, 0.0);
}
