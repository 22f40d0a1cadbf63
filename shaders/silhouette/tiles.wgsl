// Lists the tiles of a turn, in any order, and sets the number of its workgroups. Host:
// crates/render/src/gpu/passes/silhouette.rs.

// include common/frame.wgsl
// include common/turns.wgsl

struct Half {
    // Number of the turn, and number of waves before this half of it.
    turn: u32,
    waves: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> half: Half;
@group(0) @binding(2) var<storage, read_write> turns: Turns;
// Workgroups of each turn, four words; the second is the number down.
@group(0) @binding(3) var<storage, read_write> groups: array<atomic<u32>, 64>;
@group(0) @binding(4) var<storage, read> gone: array<u32>;
@group(0) @binding(5) var<storage, read_write> tiles: array<u32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let count = picture_tiles();
    if any(id.xy >= count) {
        return;
    }
    if half.turn > 0u && atomicLoad(&turns.went[half.turn - 1u]) == 0u {
        return;
    }
    let low = max(id.xy, vec2<u32>(1u)) - 1u;
    let high = min(id.xy + 1u, count - 1u);
    var is_reached = false;
    for (var y = low.y; y <= high.y; y++) {
        for (var x = low.x; x <= high.x; x++) {
            is_reached = is_reached || gone[y * count.x + x] != 0u;
        }
    }
    if is_reached {
        let place = atomicAdd(&turns.tiles[half.turn], 1u);
        tiles[place] = id.y * count.x + id.x;
        atomicMax(&groups[half.turn * 4u + 1u], place / ROW_TILES + 1u);
    }
}
