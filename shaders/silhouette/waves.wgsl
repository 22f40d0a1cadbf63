// Half a turn of waves inwards from the rims. A workgroup keeps a tile in its memory, with as many
// pixels around it as there are waves, so that nothing from beyond reaches the tile. A wave is for
// the pixels of one colour of a chessboard, which read only those of the other. Twin:
// `Waves::inwards` in crates/render/src/passes/silhouette/mod.rs.

// include common/frame.wgsl
// include common/limit.wgsl
// include common/overhang.wgsl
// include common/turns.wgsl

// Width of the halo around a tile, pixels: as many as half a turn has waves. Side of tile and halo,
// pixels.
const HALO: u32 = 8u;
const SIDE: u32 = 32u;
// Threads on a side of a workgroup.
const LANES: u32 = 8u;

struct Half {
    // Number of the turn, and number of waves before this half of it.
    turn: u32,
    waves: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> half: Half;
@group(0) @binding(2) var<storage, read> depth: array<f32>;
@group(0) @binding(3) var<storage, read> front: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> tint: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> sources: array<u32>;
@group(0) @binding(6) var<storage, read_write> sources_after: array<u32>;
@group(0) @binding(7) var<storage, read_write> turns: Turns;
// Whether a pixel of a tile was removed.
@group(0) @binding(8) var<storage, read_write> gone: array<atomic<u32>>;
// The tiles of this turn.
@group(0) @binding(9) var<storage, read> tiles: array<u32>;

// include common/source.wgsl

// Whether the workgroup has a tile, and later whether the last waves removed a pixel.
var<workgroup> is_needed: u32;
var<workgroup> has_gone: atomic<u32>;
// Sources and their depths, of the tile and its halo.
var<workgroup> tile_sources: array<u32, 1024>;
var<workgroup> tile_depths: array<f32, 1024>;

// The farther of `found` and `beside`, if the latter was removed; `found` and the result are slots
// plus one, or zero for none.
fn farther(found: u32, beside: u32) -> u32 {
    if tile_sources[beside] == 0u {
        return found;
    }
    let is_farther = found == 0u || tile_depths[beside] > tile_depths[max(found, 1u) - 1u];
    return select(found, beside + 1u, is_farther);
}

// The removed neighbour with the farthest source, whose source a pixel would take; of equals the
// first of left, right, above, below. A slot plus one; zero if no neighbour was removed.
fn after(slot: u32) -> u32 {
    let x = slot % SIDE;
    let y = slot / SIDE;
    var found = 0u;
    if x > 0u {
        found = farther(found, slot - 1u);
    }
    if x + 1u < SIDE {
        found = farther(found, slot + 1u);
    }
    if y > 0u {
        found = farther(found, slot - SIDE);
    }
    if y + 1u < SIDE {
        found = farther(found, slot + SIDE);
    }
    return found;
}

// Removes a pixel in a wave if it sticks out in front of its neighbour's source.
fn go(pixel: u32, slot: u32, wave: u32) {
    let next = after(slot);
    if next == 0u || tile_depths[next - 1u] <= tile_depths[slot] {
        return;
    }
    let own = tile_sources[slot];
    let seen = select((own & PIXEL_MASK) - 1u, pixel, own == 0u);
    let is_behind = tile_depths[next - 1u] > limit(tile_depths[slot], seen);
    let line = tile_sources[next - 1u] >> PIXEL_BITS;
    if is_behind && f32(wave) <= tint[seen].w && sticks_out(seen, line) {
        tile_sources[slot] = tile_sources[next - 1u];
        tile_depths[slot] = tile_depths[next - 1u];
        atomicStore(&has_gone, 1u);
    }
}

// A wave over the pixels of its colour, in the tile and its halo.
fn run(wave: u32, corner: vec2<u32>, local: vec2<u32>) {
    for (var i = 0u; i < 8u; i++) {
        let row = local.y + (i >> 1u) * LANES;
        // The corner has even coordinates.
        let near = vec2<u32>((local.x + (i & 1u) * LANES) * 2u + ((row + wave) & 1u), row);
        let at = corner + near;
        if at.x < frame.width && at.y < frame.height {
            go(at.y * frame.width + at.x, near.y * SIDE + near.x, wave);
        }
    }
}

@compute @workgroup_size(8, 8)
fn main(
    @builtin(local_invocation_id) local: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let place = group.y * ROW_TILES + group.x;
    if lane == 0u {
        is_needed = select(0u, 1u, place < atomicLoad(&turns.tiles[half.turn]));
        atomicStore(&has_gone, 0u);
    }
    if workgroupUniformLoad(&is_needed) == 0u {
        return;
    }
    let tile = tiles[place];
    let row_tiles = picture_tiles().x;
    let first = vec2<u32>(tile % row_tiles, tile / row_tiles) * TILE;
    // Coordinates left of the picture or above it wrap to large numbers, which are outside.
    let corner = first - HALO;
    for (var k = 0u; k < 16u; k++) {
        let near = local.xy + vec2<u32>(k & 3u, k >> 2u) * LANES;
        let at = corner + near;
        let slot = near.y * SIDE + near.x;
        var source = 0u;
        var seen = 0.0;
        if at.x < frame.width && at.y < frame.height {
            let pixel = at.y * frame.width + at.x;
            source = sources[pixel];
            seen = depth[source_of(pixel)];
        }
        tile_sources[slot] = source;
        tile_depths[slot] = seen;
        if source != 0u {
            atomicStore(&has_gone, 1u);
        }
    }
    for (var k = 1u; k <= HALO; k += 2u) {
        workgroupBarrier();
        if lane == 0u {
            is_needed = atomicExchange(&has_gone, 0u);
        }
        // If no pixel of either colour was removed, none will be.
        if workgroupUniformLoad(&is_needed) == 0u {
            break;
        }
        run(half.waves + k, corner, local.xy);
        workgroupBarrier();
        run(half.waves + k + 1u, corner, local.xy);
    }
    workgroupBarrier();
    for (var k = 0u; k < 4u; k++) {
        let inner = local.xy + vec2<u32>(k & 1u, k >> 1u) * LANES;
        let at = first + inner;
        if at.x >= frame.width || at.y >= frame.height {
            continue;
        }
        let pixel = at.y * frame.width + at.x;
        let source = tile_sources[(inner.y + HALO) * SIDE + inner.x + HALO];
        if source != sources[pixel] {
            atomicStore(&turns.went[half.turn], 1u);
            atomicStore(&gone[tile], 1u);
        }
        sources_after[pixel] = source;
    }
}
