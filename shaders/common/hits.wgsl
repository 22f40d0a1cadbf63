// The frame buffer: for each pixel the number of its winning point in x and the bits of its depth
// in y. Host: crates/render/src/gpu/memory/hits.rs.

// Word y of a pixel without a point.
const NO_HIT: u32 = 0xffffffffu;
