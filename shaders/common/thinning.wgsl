// Thinning of points that are drawn alone: which points of a node the picture needs at a depth.
// Needs common/draws.wgsl and a variable `draws`. Twin: crates/render/src/inputs/thinning.rs, which
// explains it.

// Levels of a node at most, and strata of a level.
const LEVELS: u32 = 16u;
const STRATA: u32 = 16u;
// The golden ratio's fraction, times 2^32.
const GOLDEN: u32 = 0x9e3779b9u;
// Steps of a fraction of a stratum.
const PER_FRACTION: f32 = 0.000000059604644775390625;

// Share of the density that the ancestors of the node in a row and its points before point `index`
// have.
fn share_of(row: u32, index: u32) -> f32 {
    var start = 0u;
    var count = 1u;
    for (var level = 0u; level < LEVELS; level += 1u) {
        let end = draws[row].level_ends[level];
        if index < end {
            count = end - start;
            break;
        }
        start = end;
    }
    let at = index - start;
    let stratum = at * STRATA / count;
    let fraction = f32((at * GOLDEN) >> 8u) * PER_FRACTION;
    let before = (f32(stratum) + fraction) * (f32(count) / f32(STRATA));
    let share = draws[row].above + draws[row].per_point * (f32(start) + before);
    return select(share, share * share, draws[row].is_line == 1u);
}

// Whether a point is closer to others on the picture than asked.
fn is_left_out(row: u32, index: u32, depth: f32) -> bool {
    let far = depth * draws[row].per_reach;
    return share_of(row, index) * (far * far) > 1.0;
}
