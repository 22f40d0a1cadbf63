// Sorts the splats of a batch into tiles by counting: `begin` computes the starts of the tiles from
// their counts, in one workgroup; then `fill` writes the entries. If the capacity is too small for
// all entries, tiles test all splats of the batch instead (ewa/blend.wgsl): slower, but the same
// picture. Host: crates/render/src/gpu/passes/ewa.rs.

// include common/infinite.wgsl
// include common/splats.wgsl

@group(0) @binding(0) var<uniform> batch: Batch;
// The count of each tile, then its next free entry.
@group(0) @binding(1) var<storage, read_write> cursors: array<atomic<u32>>;
// First entry of each tile, and one past the last entry.
@group(0) @binding(2) var<storage, read_write> starts: array<u32>;
@group(0) @binding(3) var<storage, read> boxes: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read_write> entries: array<u32>;
// Two counts of pixels, then the splats drawn and the splats that cannot be drawn.
@group(0) @binding(5) var<storage, read_write> counts: array<atomic<u32>, 4>;

// Threads of a workgroup.
const THREADS: u32 = 256u;
var<workgroup> sums: array<u32, 256>;

@compute @workgroup_size(256)
fn begin(@builtin(local_invocation_index) thread: u32) {
    // Each thread has a run of tiles: it sums their counts, then the sums of the threads before it,
    // then assigns the starts. Sums are capped just above the capacity, so that they do not wrap.
    let most = batch.entries + 1u;
    let tiles = batch.tiles.x * batch.tiles.y;
    let run = (tiles + THREADS - 1u) / THREADS;
    let first = min(thread * run, tiles);
    let last = min(first + run, tiles);
    var sum = 0u;
    for (var i = first; i < last; i += 1u) {
        sum = min(sum + atomicLoad(&cursors[i]), most);
    }
    sums[thread] = sum;
    workgroupBarrier();
    var start = 0u;
    for (var i = 0u; i < thread; i += 1u) {
        start = min(start + sums[i], most);
    }
    for (var i = first; i < last; i += 1u) {
        let count = atomicLoad(&cursors[i]);
        starts[i] = start;
        atomicStore(&cursors[i], start);
        start = min(start + count, most);
    }
    if thread == THREADS - 1u {
        starts[tiles] = start;
    }
}

var<workgroup> drawn: atomic<u32>;
var<workgroup> dropped: atomic<u32>;

@compute @workgroup_size(256)
fn fill(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let i = id.x + id.y * groups.x * 256u;
    if i < batch.points {
        enter(i);
    }
    workgroupBarrier();
    if thread == 0u {
        atomicAdd(&counts[2], atomicLoad(&drawn));
        atomicAdd(&counts[3], atomicLoad(&dropped));
    }
}

// Adds a splat to the entries of the tiles that it touches.
fn enter(i: u32) {
    let low = boxes[i] & vec2<u32>(0xffffu);
    let past = boxes[i] >> vec2<u32>(16u);
    if any(low >= past) {
        if boxes[i].x == DROPPED {
            atomicAdd(&dropped, 1u);
        }
        return;
    }
    atomicAdd(&drawn, 1u);
    let last = min((past - 1u) / TILE, batch.tiles - 1u);
    for (var y = low.y / TILE; y <= last.y; y += 1u) {
        for (var x = low.x / TILE; x <= last.x; x += 1u) {
            let at = atomicAdd(&cursors[y * batch.tiles.x + x], 1u);
            if at < batch.entries {
                entries[at] = i;
            }
        }
    }
}
