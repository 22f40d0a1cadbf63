// Squares of pixels for fit_planes, level by level, each level row by row. Needs a variable
// `frame`. Twin: crates/render/src/passes/fit_planes.rs.

// Side of a square of the finest level, and the greatest radius of discs that planes are fitted to,
// pixels.
const SQUARE_PX: u32 = 4u;
// Levels, each of squares of twice the width; pixels need the finest one only.
const LEVELS: u32 = 6u;

struct Square {
    // Its index in the buffers.
    index: u32,
    level: u32,
    // Column and row in its level.
    place: vec2<u32>,
}

// Squares across and down the picture.
fn squares() -> vec2<u32> {
    return squares_in(0u);
}

// Squares of a level.
fn squares_in(level: u32) -> vec2<u32> {
    let side = SQUARE_PX << level;
    return (vec2<u32>(frame.width, frame.height) + side - 1u) / side;
}

// Square `index` of the buffers; behind the last one its level is LEVELS.
fn square_of(index: u32) -> Square {
    var rest = index;
    for (var level = 0u; level < LEVELS; level += 1u) {
        let count = squares_in(level);
        if rest < count.x * count.y {
            return Square(index, level, vec2<u32>(rest % count.x, rest / count.x));
        }
        rest -= count.x * count.y;
    }
    return Square(index, LEVELS, vec2<u32>(0u));
}
