// The radius by which a depth image is smoothed, and which depths are of one surface. Needs a
// variable `frame`. Twin: crates/render/src/passes/smooth_depth.rs.

struct Smoothing {
    // Mean radius of the discs that the surface was filled from, pixels.
    radius_px: f32,
}

// Steepest slope (depth over width) within a surface.
const SLOPE_MAX: f32 = 6.0;

// Greatest relative change of depth within a surface over a distance of `pixels`. Where two discs
// meet, depth changes at once by as much as over the distance of their centres.
fn near_share(pixels: f32, radius_px: f32) -> f32 {
    return SLOPE_MAX * max(pixels, radius_px * 0.5) / frame.focal_px;
}
