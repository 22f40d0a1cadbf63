// Nearest and farthest depth of each tile of the picture, by which the LOD thread finds nodes that
// are hidden in the next views. A workgroup a tile. Bits of positive floats have the order of the
// floats, so that whole numbers are compared. Twin: `tiles_of` in crates/lod/src/feedback.rs.

// include common/frame.wgsl

// Tiles on a side of the picture.
override TILES: u32 = 128u;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> depths: array<u32>;
// Bits of the nearest and of the farthest depth.
@group(0) @binding(2) var<storage, read_write> tiles: array<vec2<u32>>;

var<workgroup> nearest: atomic<u32>;
var<workgroup> farthest: atomic<u32>;

@compute @workgroup_size(8, 8)
fn main(
    @builtin(workgroup_id) tile: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    if lane == 0u {
        atomicStore(&nearest, INFINITE_BITS);
    }
    workgroupBarrier();
    // The pixels that the tile touches.
    let size = vec2<u32>(frame.width, frame.height);
    let first = tile.xy * size / TILES;
    let end = ((tile.xy + 1u) * size + TILES - 1u) / TILES;
    var least = INFINITE_BITS;
    var greatest = 0u;
    for (var y = first.y + local.y; y < end.y; y += 8u) {
        for (var x = first.x + local.x; x < end.x; x += 8u) {
            let bits = depths[y * frame.width + x];
            // Values that are no finite depth count as infinite.
            let depth = select(INFINITE_BITS, bits, bits - 1u < INFINITE_BITS);
            least = min(least, depth);
            greatest = max(greatest, depth);
        }
    }
    atomicMin(&nearest, least);
    atomicMax(&farthest, greatest);
    workgroupBarrier();
    if lane == 0u {
        tiles[tile.y * TILES + tile.x] = vec2<u32>(atomicLoad(&nearest), atomicLoad(&farthest));
    }
}
