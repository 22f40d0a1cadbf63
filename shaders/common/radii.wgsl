// The grid of mean radii of discs. Needs a variable `frame`. Twin:
// crates/render/src/picture/radii.rs.

// Side of a tile, pixels.
const RADII_TILE: u32 = 64u;

// Tiles of the picture across and down.
fn radii_size() -> vec2<u32> {
    return (vec2<u32>(frame.width, frame.height) + (RADII_TILE - 1u)) / RADII_TILE;
}
