// Lists the points of a batch as if each had won a pixel, so that gather/fetch.wgsl fetches their
// words; and clears the counts of the tiles. Host: crates/render/src/gpu/passes/ewa.rs.

// include common/infinite.wgsl
// include common/draws.wgsl
// include common/place.wgsl
// include common/lookup.wgsl
// include common/splats.wgsl

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<storage, read> chunks: array<Chunk>;
@group(0) @binding(2) var<storage, read_write> hits: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read_write> paint: array<vec4<u32>>;
// Number of splats of each tile.
@group(0) @binding(4) var<storage, read_write> cursors: array<u32>;

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = id.x + id.y * groups.x * 256u;
    if i < arrayLength(&cursors) {
        cursors[i] = 0u;
    }
    if i >= batch.points {
        return;
    }
    let chunk = batch.first_chunk + i / CHUNK_POINTS;
    var is_point = false;
    if chunk < batch.chunks {
        is_point = i % CHUNK_POINTS < chunks[chunk].points;
    }
    if is_point {
        hits[i] = vec2<u32>(batch.first_chunk * CHUNK_POINTS + i, 0u);
    } else {
        hits[i] = vec2<u32>(0u, NO_HIT);
        paint[i] = vec4<u32>(NOTHING, 0u, 0u, 0u);
    }
}
