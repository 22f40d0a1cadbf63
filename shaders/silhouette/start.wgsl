// Sets back what the turns of the last frame have left.

// include common/frame.wgsl
// include common/turns.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read_write> turns: Turns;
// Groups of a turn, as they are dispatched, in the first three.
@group(0) @binding(2) var<storage, read_write> groups: array<vec4<u32>, 16>;
// Whether a pixel has gone in a tile.
@group(0) @binding(3) var<storage, read_write> gone: array<u32>;
@group(0) @binding(4) var<storage, read_write> sources_after: array<u32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    // Tiles that no turn has reached are left out, whichever way sources go.
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
