// Samples the radii of the discs of pixels with a surface, tile by tile. Twin: `samples` in
// crates/render/src/picture/radii.rs.

// include common/frame.wgsl
// include common/radii.wgsl

// Distance of samples along both axes, pixels.
const EVERY: u32 = 8u;
// Greatest radius of a sample, pixels.
const RADIUS_MAX_PX: f32 = 256.0;
// Samples along a side of a tile, which is a workgroup.
const SAMPLES: u32 = 8u;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> depth: array<f32>;
@group(0) @binding(2) var<storage, read> tint: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> sources: array<u32>;
// Sum and number of the samples of each tile.
@group(0) @binding(4) var<storage, read_write> tiles: array<vec2<f32>>;
// Bits of the greatest radius, which the next kernel raises.
@group(0) @binding(5) var<storage, read_write> most: u32;

// include common/source.wgsl

// Radius and number of each sample.
var<workgroup> samples: array<vec2<f32>, 64>;

@compute @workgroup_size(8, 8)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) tile: vec3<u32>,
) {
    let at = id.xy * EVERY;
    samples[lane] = vec2<f32>(0.0);
    if at.x < frame.width && at.y < frame.height {
        let pixel = at.y * frame.width + at.x;
        if !is_infinite(depth[pixel]) {
            samples[lane] = vec2<f32>(min(tint[source_of(pixel)].w, RADIUS_MAX_PX), 1.0);
        }
    }
    workgroupBarrier();
    if lane != 0u {
        return;
    }
    if tile.x == 0u && tile.y == 0u {
        most = 0u;
    }
    // One after another, in the order of the twin.
    var sum = vec2<f32>(0.0);
    for (var k = 0u; k < SAMPLES * SAMPLES; k++) {
        sum += samples[k];
    }
    tiles[tile.y * radii_size().x + tile.x] = sum;
}
