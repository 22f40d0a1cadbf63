// Radix sort, second step of a digit: replaces each count by the sum of those before it, by one
// group that goes over all of them.

// include common/sort_shape.wgsl

@group(0) @binding(0) var<uniform> sort: Sort;
@group(0) @binding(1) var<storage, read_write> counts: array<u32>;

// Threads of the group, which scan as many counts at a time.
const LANES: u32 = 256u;

var<workgroup> sums: array<u32, 256>;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
    let all = sort.groups * DIGITS;
    var before = 0u;
    for (var start = 0u; start < all; start += LANES) {
        let at = start + lane;
        var own = 0u;
        if at < all {
            own = counts[at];
        }
        sums[lane] = own;
        workgroupBarrier();
        for (var step = 1u; step < LANES; step <<= 1u) {
            var below = 0u;
            if lane >= step {
                below = sums[lane - step];
            }
            workgroupBarrier();
            sums[lane] += below;
            workgroupBarrier();
        }
        if at < all {
            counts[at] = before + sums[lane] - own;
        }
        before += sums[LANES - 1u];
        workgroupBarrier();
    }
}
