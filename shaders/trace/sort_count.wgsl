// Radix sort, first step of a digit: counts the digits of each group's pairs.

// include common/sort_shape.wgsl

@group(0) @binding(0) var<uniform> sort: Sort;
@group(0) @binding(1) var<storage, read> pairs: array<vec2<u32>>;
// Counts of all groups for the first digit, then for the next.
@group(0) @binding(2) var<storage, read_write> counts: array<u32>;

var<workgroup> total: array<atomic<u32>, 16>;

@compute @workgroup_size(64)
fn main(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let first = first_of(group.x, thread);
    for (var i = first; i < min(first + PAIRS, sort.count); i++) {
        atomicAdd(&total[digit_of(pairs[i].x)], 1u);
    }
    workgroupBarrier();
    if thread < DIGITS {
        counts[thread * sort.groups + group.x] = atomicLoad(&total[thread]);
    }
}
