// The compact octree of a cut, as crates/lod/src/octree.rs walks it. Needs a variable `octree`.

// A drawn cell.
struct OctreeCell {
    // Its least lattice point.
    corner: vec3<u32>,
    // Log2 of its edge.
    log2: u32,
    // Effective spacing, the file's unit.
    spacing: f32,
    // The cell below in each octant, which may be smaller than the octant.
    children: array<u32, 8>,
}

fn holds(cell: u32, p: vec3<u32>) -> bool {
    let bits = p ^ octree[cell].corner;
    let log2 = octree[cell].log2;
    return log2 >= 32u || ((bits.x | bits.y | bits.z) >> log2) == 0u;
}

// Effective spacing of the finest cell that holds `p`, from a cell downwards; the cell's own where it does not
// hold `p`.
fn spacing_from(cell: u32, p: vec3<u32>) -> f32 {
    var at = cell;
    if holds(at, p) {
        // Each step is to a smaller cell, and there are 33 sizes.
        for (var i = 0u; i < 33u; i += 1u) {
            let log2 = octree[at].log2;
            if log2 == 0u {
                break;
            }
            let bit = (p >> vec3<u32>((log2 - 1u) & 31u)) & vec3<u32>(1u);
            let child = octree[at].children[bit.x | (bit.y << 1u) | (bit.z << 2u)];
            if child >= lookup.cells || !holds(child, p) {
                break;
            }
            at = child;
        }
    }
    return octree[at].spacing;
}
