// What the passes at outlines know of a pixel, a bit each.

// Beside a step of depth.
const EDGE: u32 = 1u;
// A gap, to be closed in this round of mend.
const GAP: u32 = 2u;
