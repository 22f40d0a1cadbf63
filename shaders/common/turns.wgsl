// Turns of silhouette: waves run in turns of 16 over the tiles that they can reach, which are those
// with a removed pixel and their neighbours. A turn that follows one without removals has no tiles.
// Host: crates/render/src/gpu/target.rs.

const TURNS: u32 = 16u;
// Side of a tile, pixels: as many as a turn has waves.
const TILE: u32 = 16u;
// Tiles are dispatched in rows of this length, so that the number of rows stays within the limit of
// a dispatch.
const ROW_TILES: u32 = 16u;

struct Turns {
    // Whether a pixel was removed in a turn.
    went: array<atomic<u32>, 16>,
    // Number of tiles of a turn.
    tiles: array<atomic<u32>, 16>,
}

// Tiles across and down the picture.
fn picture_tiles() -> vec2<u32> {
    return (vec2<u32>(frame.width, frame.height) + TILE - 1u) / TILE;
}
