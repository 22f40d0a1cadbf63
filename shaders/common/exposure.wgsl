// Cells of the picture and of depth in which exposures are told (crates/render/src/passes/exposure.rs says why). A cell has slots of
// four words: red, green, blue in steps, and the number of pixels. Needs a variable `frame`.

const CELL_PX: u32 = 32u;
const SLICE_BITS: u32 = 20u;
const SLICES: u32 = 32u;
const SLOTS: u32 = 16u;
const STEPS: f32 = 16383.0;

// Cells in a row.
fn cells_across() -> u32 {
    return (frame.width + CELL_PX - 1u) / CELL_PX;
}

fn cells_down() -> u32 {
    return (frame.height + CELL_PX - 1u) / CELL_PX;
}

// Where a cell's slots begin, in words.
fn slots_at(cell: vec2<u32>, slice: u32) -> u32 {
    return ((cell.y * cells_across() + cell.x) * SLICES + slice % SLICES) * SLOTS * 4u;
}
