// The compact octree of a cut, and the effective spacing at a point. Needs variables `octree` and
// `lookup`. Twin: crates/lod/src/octree.rs.

// The cell of a drawn node.
struct OctreeCell {
    // Least lattice coordinates.
    corner: vec3<u32>,
    // Log2 of the edge, steps.
    log2: u32,
    // Effective spacing, in the file's unit.
    spacing: f32,
    // The next cell in each octant, which may be smaller than the octant.
    children: array<u32, 8>,
}

// Whether a cell contains the lattice point `p`.
fn holds(cell: u32, p: vec3<u32>) -> bool {
    // Steps from the corner; outside they wrap around and are too many.
    let bits = p - octree[cell].corner;
    let log2 = octree[cell].log2;
    return log2 >= 32u || ((bits.x | bits.y | bits.z) >> log2) == 0u;
}

// Effective spacing of the finest cell below `cell` that contains `p`; that of `cell` if it does
// not contain `p` itself.
fn spacing_from(cell: u32, p: vec3<u32>) -> f32 {
    var at = cell;
    if holds(at, p) {
        // Each step goes to a smaller cell, and there are 33 sizes.
        for (var i = 0u; i < 33u; i += 1u) {
            let log2 = octree[at].log2;
            if log2 == 0u {
                break;
            }
            let steps = p - octree[at].corner;
            let bit = (steps >> vec3<u32>((log2 - 1u) & 31u)) & vec3<u32>(1u);
            let child = octree[at].children[bit.x | (bit.y << 1u) | (bit.z << 2u)];
            if child >= lookup.cells || !holds(child, p) {
                break;
            }
            at = child;
        }
    }
    return octree[at].spacing;
}
