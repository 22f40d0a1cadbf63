// Squares of pixels that keep their nearest point, row by row; twin: crates/render/src/passes/fit_planes.rs. Needs a variable `frame`.

// Pixels on a side, and the widest radius of discs that something is told of.
const SQUARE_PX: u32 = 4u;

// Squares in a row, rows of them.
fn squares() -> vec2<u32> {
    return (vec2<u32>(frame.width, frame.height) + SQUARE_PX - 1u) / SQUARE_PX;
}
