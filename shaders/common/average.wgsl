// Layout of the sums that average keeps for each pixel, in words. First the plane of the winning
// point: the scale `focal_px / depth` at the pixel's centre, its change a pixel right and down (the
// slope), and the decrease of the scale to the far end of the depth interval (the reach). Then the
// number of points and the sums of colours, and of normals or, without normals, of depths. Needs a
// constant `NORMALS`. Twin: crates/render/src/passes/average.rs.

// Terms of the sums are whole numbers from 0 to this.
const STEPS: f32 = 16383.0;
// Points whose sums fit in 32 bits; a pixel with more keeps the attributes of its winning point.
const POINTS_MAX: f32 = 262144.0;
// Offsets in the words of a pixel.
const AT_SCALE: u32 = 0u;
const AT_SLOPE: u32 = 1u;
const AT_REACH: u32 = 3u;
const AT_COUNT: u32 = 4u;
const AT_COLOUR: u32 = 5u;
const AT_NORMAL: u32 = 8u;
const AT_DEPTH: u32 = 8u;

// Words of a pixel.
fn words() -> u32 {
    return select(9u, 12u, NORMALS);
}
