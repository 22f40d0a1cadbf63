// What is added up for a pixel, in words: the winner's plane, then sums (crates/render/src/passes/average.rs says why). The
// plane is `focal_px / depth` at the pixel's centre, what that changes by a pixel right and down, and how much less
// it is where the depth interval ends. Needs a constant NORMALS; without normals depth is summed in their place.

// What is summed lies between 0 and so many steps.
const STEPS: f32 = 16383.0;
// Points of a pixel whose sums fit into 32 bits; of more one wins it.
const POINTS_MAX: f32 = 262144.0;
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
