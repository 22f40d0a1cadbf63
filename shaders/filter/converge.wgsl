// Mix with the unfiltered mean, last step: the picture goes to the mean of its samples where the
// bias of the filter is certain and larger than the noise. Twin:
// crates/trace/src/filter/converge.rs.

// include common/halves.wgsl

@group(0) @binding(0) var<uniform> shares: Shares;
@group(0) @binding(1) var<storage, read> halves: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> light: array<vec4<f32>>;
// Planes of measures.wgsl, summed over windows.
@group(0) @binding(3) var<storage, read> measures: array<f32>;
@group(0) @binding(4) var<storage, read_write> filtered: array<vec4<f32>>;

// Standard errors that are subtracted from the square of the bias.
const STANDARD_ERRORS: f32 = 3.0;

@compute @workgroup_size(256)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let pixel = id.x + id.y * groups.x * 256u;
    if pixel >= shares.pixels || !is_mixed(pixel, light[pixel], filtered[pixel]) {
        return;
    }
    let count = max(measures[3u * shares.pixels + pixel], 1.0);
    let bias = measures[pixel] / count;
    let square = measures[shares.pixels + pixel] / count;
    let noise = measures[2u * shares.pixels + pixel] / count;
    let certain = bias - STANDARD_ERRORS * sqrt(square / count);
    if !(certain > 0.0) {
        return;
    }
    let mean = 0.5 * (half_of(pixel, false) + half_of(pixel, true));
    let own = filtered[pixel];
    let mixed = mix(own.xyz, mean, certain / (certain + noise));
    filtered[pixel] = vec4<f32>(mixed, own.w);
}
