// Counts the splats of each chunk of a batch, by one workgroup a chunk. Host:
// crates/render/src/gpu/splats.rs. Twin: crates/render/src/inputs/splats.rs.

// include common/frame.wgsl
// include common/draws.wgsl
// include common/place.wgsl
// include common/lookup.wgsl
// include common/splats.wgsl
// include common/kept.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(2) var<storage, read> draws: array<Draw>;
@group(0) @binding(3) var<storage, read> geometry: array<vec4<u32>>;
@group(0) @binding(4) var<storage, read> paint: array<vec4<u32>>;
@group(0) @binding(5) var<storage, read_write> counts: array<u32>;

// Threads of a workgroup.
const COUNTERS: u32 = 256u;

var<workgroup> total: atomic<u32>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    for (var first = 0u; first < CHUNK_POINTS; first += COUNTERS) {
        if point_of(group.x * CHUNK_POINTS + first + lane).is_kept {
            atomicAdd(&total, 1u);
        }
    }
    workgroupBarrier();
    if lane == 0u {
        counts[group.x] = atomicLoad(&total);
    }
}
