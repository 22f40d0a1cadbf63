// Bounding boxes of the runs that were written to since their last box was computed; a workgroup a
// run. Host: crates/render/src/gpu/passes/bounds.rs.

// include common/place.wgsl
// include common/runs.wgsl

// Threads of a workgroup.
const THREADS: u32 = 64u;

// Numbers of the stale runs of the bound page.
@group(0) @binding(0) var<storage, read> stale: array<u32>;
@group(0) @binding(1) var<storage, read> positions: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read_write> boxes: array<vec4<u32>>;

// Maxima of 65535 minus the coordinates, and of the coordinates, which both start at zero.
var<workgroup> lack: array<atomic<u32>, 3>;
var<workgroup> high: array<atomic<u32>, 3>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let item = group.x + group.y * groups.x;
    if item >= arrayLength(&stale) {
        return;
    }
    let run = stale[item];
    // The last run of a page may be shorter.
    let last = arrayLength(&positions) - 1u;
    var to_low = vec3<u32>(0u);
    var to_high = vec3<u32>(0u);
    for (var i = thread; i < RUN_POINTS; i += THREADS) {
        let q = hot_of(positions[min(run * RUN_POINTS + i, last)]);
        to_low = max(to_low, vec3<u32>(0xffffu) - q);
        to_high = max(to_high, q);
    }
    for (var axis = 0u; axis < 3u; axis++) {
        atomicMax(&lack[axis], to_low[axis]);
        atomicMax(&high[axis], to_high[axis]);
    }
    workgroupBarrier();
    if thread == 0u {
        let lacks = vec3<u32>(atomicLoad(&lack[0]), atomicLoad(&lack[1]), atomicLoad(&lack[2]));
        let highs = vec3<u32>(atomicLoad(&high[0]), atomicLoad(&high[1]), atomicLoad(&high[2]));
        boxes[run] = pack_box(RunBox(vec3<u32>(0xffffu) - lacks, highs));
    }
}
