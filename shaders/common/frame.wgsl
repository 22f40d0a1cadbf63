// The uniform of a frame, which all passes read. Host: crates/render/src/gpu/memory/frame.rs.

// include common/infinite.wgsl

struct Frame {
    // `right`, `up` and `back` are the rows of the rotation from world to view space.
    right: vec3<f32>,
    // Size in pixels of a unit of length at unit depth.
    focal_px: f32,
    up: vec3<f32>,
    // Depth of the near plane.
    near: f32,
    back: vec3<f32>,
    // Width of the picture with its margin, pixels.
    width: u32,
    // Length of a lattice step along each axis.
    step: vec3<f32>,
    // Height of the picture with its margin, pixels.
    height: u32,
    // Colours of the top and the bottom row, sRGB with straight alpha.
    background_top: vec4<f32>,
    background_bottom: vec4<f32>,
    // Centre of the picture, pixels; of the whole picture where a window of it is drawn.
    centre_px: vec2<f32>,
    // 1 if points whose normal faces away from the eye are culled.
    cull_back_faces: u32,
    // Width of the margin on each side, which is cropped afterwards, pixels.
    margin_px: u32,
    // Greatest radius of points that are drawn alone, pixels.
    point_radius: f32,
    // Strength of eye-dome lighting.
    eye_dome: f32,
    // 1 if normals tell the front of a surface from its back.
    has_fronts: u32,
    // Depth of the anchor of positions.
    anchor_depth: f32,
    // How crowded the view is, 0 to 1: the share of averages.
    crowding: f32,
    // Share of fitted planes in tilts and depth intervals, 0 to 1.
    fitting: f32,
    // 1 if the view is parallel: `anchor_depth` is then the depth at which lengths have their size.
    is_parallel: u32,
    // What is added to a row to get that of the background.
    backdrop_from: i32,
    // First column and row of the window in the whole picture, pixels.
    origin_px: vec2<f32>,
    // Rows of the background.
    backdrop_rows: u32,
    // Distance to which points that are drawn alone are thinned, pixels; 0 if they are not.
    thinned_px: f32,
}

// Place on the picture from that on the whole picture relative to its centre, pixels. It is rounded
// on the whole picture, alike in all of its windows.
fn placed(from_centre: vec2<f32>) -> vec2<f32> {
    return from_centre + (frame.centre_px + frame.origin_px) - frame.origin_px;
}

// Row of the background that row `y` of the picture shows. Margins show the outermost rows.
fn backdrop_row(y: u32) -> u32 {
    return u32(clamp(i32(y) + frame.backdrop_from, 0, i32(frame.backdrop_rows) - 1));
}
