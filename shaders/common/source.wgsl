// Whose attributes a pixel shows: a trimmed one those of a pixel behind. Needs a variable `sources`: that pixel
// plus one; 0 where a pixel shows its own.

fn shown(pixel: u32) -> u32 {
    let source = sources[pixel];
    return select(source - 1u, pixel, source == 0u);
}
