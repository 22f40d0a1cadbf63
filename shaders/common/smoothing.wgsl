// What the shape of a depth image is told with. Needs a variable `frame`. Twin: crates/render/src/passes/smooth_depth.rs.

struct Smoothing {
    // Typical radius of the discs that the surface was filled from, pixels.
    radius_px: f32,
}

// Steepest slope (depth over width) that still counts as one surface.
const SLOPE_MAX: f32 = 6.0;

// The greatest relative change of depth over so many pixels within a surface. Between neighbouring discs depth
// changes at once by what their distance makes.
fn near_share(pixels: f32, radius_px: f32) -> f32 {
    return SLOPE_MAX * max(pixels, radius_px * 0.5) / frame.focal_px;
}
