// Resolve: writes the colours and depths of the winning points to the picture. Twin:
// crates/render/src/passes/resolve.rs.

// include common/frame.wgsl
// include common/draws.wgsl
// include common/place.wgsl
// include common/lookup.wgsl
// include common/colour.wgsl
// include common/point_colour.wgsl
// include common/backdrop.wgsl
// include common/encode.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> lookup: Lookup;
@group(0) @binding(2) var<uniform> encode_table: EncodeTable;
@group(0) @binding(3) var<storage, read> hits: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> draws: array<Draw>;
@group(0) @binding(5) var<storage, read> geometry: array<vec4<u32>>;
@group(0) @binding(6) var<storage, read> paint: array<vec4<u32>>;
@group(0) @binding(7) var<storage, read_write> rgba: array<u32>;
@group(0) @binding(8) var<storage, read_write> depths: array<u32>;
// Number of pixels with a winning point, and of pixels that show a surface: here the same.
@group(0) @binding(9) var<storage, read_write> counts: array<atomic<u32>>;

var<workgroup> won: atomic<u32>;

@compute @workgroup_size(256)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let pixel = id.x + id.y * groups.x * 256u;
    var has_point = false;
    if pixel < frame.width * frame.height {
        let hit = hits[pixel];
        has_point = hit.y != NO_HIT;
        if has_point {
            rgba[pixel] = encoded_bytes(point_colour(pixel, hit.y));
            depths[pixel] = hit.y;
        } else {
            let row = backdrop_row(pixel / frame.width);
            let top = frame.background_top;
            rgba[pixel] = backdrop(top, frame.background_bottom, row, frame.backdrop_rows);
            depths[pixel] = INFINITE_BITS;
        }
    }
    if has_point {
        atomicAdd(&won, 1u);
    }
    workgroupBarrier();
    if local == 0u {
        let count = atomicLoad(&won);
        atomicAdd(&counts[0], count);
        atomicAdd(&counts[1], count);
    }
}
