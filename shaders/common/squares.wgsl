// Squares of pixels for fit_planes, row by row. Needs a variable `frame`. Twin:
// crates/render/src/passes/fit_planes.rs.

// Side of a square, and the greatest radius of discs that planes are fitted to, pixels.
const SQUARE_PX: u32 = 4u;

// Squares across and down the picture.
fn squares() -> vec2<u32> {
    return (vec2<u32>(frame.width, frame.height) + SQUARE_PX - 1u) / SQUARE_PX;
}
