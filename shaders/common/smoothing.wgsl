// The radii by which a depth image is smoothed, and which depths are of one surface. Needs
// common/radii.wgsl, and variables `frame` and `radii`, the mean radii at corners of tiles. Twin:
// crates/render/src/passes/smooth_depth.rs.

struct Smoothing {
    // Greatest of the mean radii of the discs that the surface was filled from, pixels.
    most_px: f32,
}

// Steepest slope (depth over width) within a surface.
const SLOPE_MAX: f32 = 6.0;

// Mean radius of the discs around a pixel, interpolated between the corners of its tile.
fn radius_around(at: vec2<u32>) -> f32 {
    let tile = at / RADII_TILE;
    let columns = radii_size().x + 1u;
    let corner = tile.y * columns + tile.x;
    let share = (vec2<f32>(at - tile * RADII_TILE) + 0.5) / f32(RADII_TILE);
    let left = mix(radii[corner], radii[corner + columns], share.y);
    let right = mix(radii[corner + 1u], radii[corner + columns + 1u], share.y);
    return mix(left, right, share.x);
}

// Greatest relative change of depth within a surface over a distance of `pixels`. Where two discs
// meet, depth changes at once by as much as over the distance of their centres.
fn near_share(pixels: f32, radius_px: f32) -> f32 {
    return SLOPE_MAX * max(pixels, radius_px * 0.5) / frame.focal_px;
}
