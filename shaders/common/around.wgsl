// The neighbours of a pixel, and which surface is in front of which, for fill_holes. Needs a
// variable `frame` and a constant `NORMALS`. Twin: crates/render/src/passes/fill_holes.rs.

// The neighbour `k` (0 to 7) of a pixel that is not at the border of the picture.
fn beside(pixel: u32, k: u32) -> u32 {
    // Row by row, without the middle.
    let i = select(k + 1u, k, k < 4u);
    return pixel + i / 3u * frame.width + i % 3u - frame.width - 1u;
}

// Distance by which the neighbours of a gap must be in front of it, in radii, with normals and
// without (bare); and in pixels at least.
const BEFORE_NORMALS: f32 = 0.5;
const BEFORE_BARE: f32 = 1.0;
const BEFORE_MIN_PX: f32 = 1.0;

// Whether a surface at `depth`, of discs of radius `radius_px`, is in front of depth `behind`.
fn is_in_front(depth: f32, radius_px: f32, behind: f32) -> bool {
    let reach = max(radius_px * select(BEFORE_BARE, BEFORE_NORMALS, NORMALS), BEFORE_MIN_PX);
    return depth * (1.0 + reach / frame.focal_px) < behind;
}
