// What all passes know of a frame (crates/render/src/gpu/frame.rs has the same structure).

// include common/infinite.wgsl

struct Frame {
    // Rows of the rotation from the world's axes to the view's.
    right: vec3<f32>,
    // Pixels that a unit of length takes at unit depth.
    focal_px: f32,
    up: vec3<f32>,
    // What is nearer is not drawn.
    near: f32,
    back: vec3<f32>,
    // Pixels in a row, of the picture with its margin.
    width: u32,
    // Length of a lattice step, an axis.
    step: vec3<f32>,
    // Rows, of the same.
    height: u32,
    // sRGB with straight alpha, of the top row and the bottom row.
    background_top: vec4<f32>,
    background_bottom: vec4<f32>,
    // The picture's middle.
    centre_px: vec2<f32>,
    // Whether points whose normal looks away are dropped.
    cull_back_faces: u32,
    // What is drawn beyond the picture on each side, pixels; it is not shown.
    margin_px: u32,
}
