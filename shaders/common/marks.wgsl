// Marks of pixels at outlines, a bit each, which fill_holes sets. Twin:
// crates/render/src/picture/marks.rs.

// The pixel is beside a step of depth.
const EDGE: u32 = 1u;
// The pixel is a gap, which this round of fill_holes closes.
const GAP: u32 = 2u;
