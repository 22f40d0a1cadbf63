// Radix sort, last step of a digit: moves pairs to their places. Pairs of the same digit keep their
// order.

// include common/sort_shape.wgsl

@group(0) @binding(0) var<uniform> sort: Sort;
@group(0) @binding(1) var<storage, read> pairs: array<vec2<u32>>;
// Place of the first pair of each digit and group.
@group(0) @binding(2) var<storage, read> places: array<u32>;
@group(0) @binding(3) var<storage, read_write> moved: array<vec2<u32>>;

// Number of pairs of each digit and thread, then the number before it in the group.
var<workgroup> before: array<u32, 1024>;

@compute @workgroup_size(64)
fn main(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let first = first_of(group.x, thread);
    let end = min(first + PAIRS, sort.count);
    for (var i = first; i < end; i++) {
        before[digit_of(pairs[i].x) * THREADS + thread]++;
    }
    workgroupBarrier();
    if thread < DIGITS {
        var sum = places[thread * sort.groups + group.x];
        for (var i = 0u; i < THREADS; i++) {
            let own = before[thread * THREADS + i];
            before[thread * THREADS + i] = sum;
            sum += own;
        }
    }
    workgroupBarrier();
    for (var i = first; i < end; i++) {
        let pair = pairs[i];
        let at = digit_of(pair.x) * THREADS + thread;
        moved[before[at]] = pair;
        before[at]++;
    }
}
