// Mean radius over a sample of the pixels with a surface, in one workgroup. Twin: `mean_radius_px`
// in crates/render/src/passes/smooth_depth.rs.

// include common/frame.wgsl
// include common/smoothing.wgsl

// Step of the sample, pixels: a prime, so that the sample runs across columns.
const EVERY: u32 = 61u;
// Threads of the workgroup.
const LANES: u32 = 256u;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> depth: array<f32>;
@group(0) @binding(2) var<storage, read> tint: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> sources: array<u32>;
@group(0) @binding(4) var<storage, read_write> smoothing: Smoothing;

// include common/source.wgsl

// Sum and count of each thread.
var<workgroup> sums: array<vec2<f32>, 256>;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
    var sum = vec2<f32>(0.0);
    for (var i = lane * EVERY; i < frame.width * frame.height; i += LANES * EVERY) {
        if !is_infinite(depth[i]) {
            sum += vec2<f32>(min(tint[source_of(i)].w, f32(frame.width)), 1.0);
        }
    }
    sums[lane] = sum;
    for (var half = LANES / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if lane < half {
            sums[lane] += sums[lane + half];
        }
    }
    if lane == 0u {
        smoothing.radius_px = select(0.0, sums[0].x / sums[0].y, sums[0].y > 0.0);
    }
}
