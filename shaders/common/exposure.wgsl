// The bilateral grid of exposure: cells of 32 x 32 pixels and a slice of depth. A cell has a slot
// for all scans and slots for single ones, of four words each: sums of red, green and blue in
// steps, and the number of pixels. Needs a variable `frame`. Twin:
// crates/render/src/passes/exposure.rs, which explains the constants.

const CELL_PX: u32 = 32u;
const SLICE_BITS: u32 = 20u;
const SLICES: u32 = 32u;
const SLOTS: u32 = 16u;
const STEPS: f32 = 16383.0;

// Cells across the picture.
fn cells_across() -> u32 {
    return (frame.width + CELL_PX - 1u) / CELL_PX;
}

// Cells down the picture.
fn cells_down() -> u32 {
    return (frame.height + CELL_PX - 1u) / CELL_PX;
}

// First word of the slots of a cell.
fn slots_at(cell: vec2<u32>, slice: u32) -> u32 {
    return ((cell.y * cells_across() + cell.x) * SLICES + slice % SLICES) * SLOTS * 4u;
}
