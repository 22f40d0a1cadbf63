// The neighbours of a pixel of the picture, and what is in front of what. Needs a variable `frame`.

// The k-th of the eight neighbours of a pixel that is not at the border.
fn beside(pixel: u32, k: u32) -> u32 {
    // Row by row, the middle left out.
    let i = select(k + 1u, k, k < 4u);
    return pixel + i / 3u * frame.width + i % 3u - frame.width - 1u;
}

// How far in front the neighbours of a gap have to be, over their radius, with normals and without; and in pixels, at least.
const BEFORE_NORMALS: f32 = 0.5;
const BEFORE_BARE: f32 = 1.0;
const BEFORE_MIN_PX: f32 = 1.0;

// Whether a surface at `depth` whose discs have this radius lies before `behind`.
fn is_in_front(depth: f32, radius_px: f32, behind: f32) -> bool {
    let reach = max(radius_px * select(BEFORE_BARE, BEFORE_NORMALS, NORMALS), BEFORE_MIN_PX);
    return depth * (1.0 + reach / frame.focal_px) < behind;
}
