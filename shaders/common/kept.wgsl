// The points of a batch that are splats of a lit scene: those that no filter hides and whose place
// is finite. Needs common/frame.wgsl, common/draws.wgsl, common/place.wgsl, common/lookup.wgsl and
// common/splats.wgsl, and variables `frame`, `draws`, `geometry` and `paint`. Twin:
// crates/render/src/inputs/splats.rs.

// Whether points that a filter has marked are hidden.
override HIDES_POINTS: bool = false;

struct Point {
    is_kept: bool,
    // Row of its node.
    draw: u32,
    // Offset in its node's box, steps.
    offset: vec3<u32>,
    // Place relative to the origin, the file's unit.
    centre: vec3<f32>,
}

// Point `i` of the batch.
fn point_of(i: u32) -> Point {
    let row = paint[i].x;
    if row == NOTHING {
        return Point();
    }
    let words = geometry[i];
    let draw = row & ~HAS_COLOUR;
    let d = &draws[draw];
    let offset = offset_of(words, (*d).shift);
    let steps = steps_from_anchor((*d).base_high, (*d).base_low, (*d).bias_steps, offset);
    let centre = steps * frame.step;
    let is_hidden = HIDES_POINTS && (words.y >> 24u) != 0u;
    let is_finite = !(is_infinite(centre.x) || is_infinite(centre.y) || is_infinite(centre.z));
    return Point(is_finite && !is_hidden, draw, offset, centre);
}
