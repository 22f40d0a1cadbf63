// The source of a pixel: the pixel whose attributes it shows, which is another one if silhouette
// has removed it. Needs a variable `sources` with words of two parts: the source plus one, or 0 if
// the pixel is its own source; and above PIXEL_BITS the outward direction, plus one, of the line
// that it was removed from. Twin: crates/render/src/passes/silhouette/mod.rs.

const PIXEL_BITS: u32 = 28u;
const PIXEL_MASK: u32 = 0xfffffffu;

// The source of a pixel.
fn source_of(pixel: u32) -> u32 {
    let source = sources[pixel];
    return select((source & PIXEL_MASK) - 1u, pixel, source == 0u);
}
