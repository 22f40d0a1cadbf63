// Resets the state of the turns of the last frame. Host:
// crates/render/src/gpu/passes/silhouette.rs.

// include common/frame.wgsl
// include common/turns.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read_write> turns: Turns;
// Workgroups of the indirect dispatch of each turn, in the first three words.
@group(0) @binding(2) var<storage, read_write> groups: array<vec4<u32>, 16>;
// Whether a pixel of a tile was removed.
@group(0) @binding(3) var<storage, read_write> gone: array<u32>;
@group(0) @binding(4) var<storage, read_write> sources_after: array<u32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    // Turns do not write to tiles that they do not reach, so both buffers of sources must be clear.
    sources_after[pixel] = 0u;
    if all(id.xy % TILE == vec2<u32>(0u)) {
        gone[id.y / TILE * picture_tiles().x + id.x / TILE] = 0u;
    }
    if pixel == 0u {
        for (var i = 0u; i < TURNS; i++) {
            atomicStore(&turns.went[i], 0u);
            atomicStore(&turns.tiles[i], 0u);
            groups[i] = vec4<u32>(ROW_TILES, 0u, 1u, 0u);
        }
    }
}
