// Radii of points. Needs common/lookup.wgsl, common/octree.wgsl, and variables `lookup` and
// `draws`. Twin: `Lookup` in crates/render/src/passes/gather.rs.

// Greatest radius.
const RADIUS_MAX: f32 = 1e30;

// A radius clamped to at most RADIUS_MAX; 0 for NaN and negative values.
fn radius_within(radius: f32) -> f32 {
    let bits = bitcast<u32>(radius);
    if bits > INFINITE_BITS {
        return 0.0;
    }
    return min(radius, RADIUS_MAX);
}

// Greatest radius code that is scaled with what is drawn.
const SCALED_CODE_MAX: u32 = 176u;

// Spacing by which a radius of this code is scaled, of the lattice point `p` of a node: the
// effective one of the finest drawn cell that contains it, or that of its node.
fn spacing_of(draw: u32, p: vec3<u32>, code: u32) -> f32 {
    let stored = draws[draw].spacing;
    let entry = draws[draw].entry;
    if entry >= lookup.cells || code > SCALED_CODE_MAX {
        return stored;
    }
    let drawn = spacing_from(entry, p);
    return select(stored, drawn, drawn > 0.0);
}
