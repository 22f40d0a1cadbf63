// Waves run in turns of 16 over the tiles that they can reach: those with a pixel that has gone, and those around
// them. A turn after one in which nothing went has no tiles.

const TURNS: u32 = 16u;
// Pixels on a side of a tile: as many as a turn has waves.
const TILE: u32 = 16u;
// Tiles are dispatched in rows of so many, so that all tiles of a picture stay within what a side may be.
const ROW_TILES: u32 = 16u;

struct Turns {
    // Whether a pixel went in a turn.
    went: array<atomic<u32>, 16>,
    // How many tiles a turn has.
    tiles: array<atomic<u32>, 16>,
}

// Tiles in a row of the picture, and rows.
fn picture_tiles() -> vec2<u32> {
    return (vec2<u32>(frame.width, frame.height) + TILE - 1u) / TILE;
}
