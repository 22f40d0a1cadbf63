// Whose attributes a pixel shows: a trimmed one those of a pixel behind. Needs a variable `sources`: that pixel
// plus one, and above PIXEL_BITS the direction outwards of the line that it went from, plus one; 0 where a pixel shows
// its own.

const PIXEL_BITS: u32 = 28u;
const PIXEL_MASK: u32 = 0xfffffffu;

fn shown(pixel: u32) -> u32 {
    let source = sources[pixel];
    return select((source & PIXEL_MASK) - 1u, pixel, source == 0u);
}
