// Mix with the unfiltered mean, first step: planes of the square of the bias, its own square, the
// square of the noise, and 1 where a pixel counts. Twin: crates/trace/src/filter/converge.rs.

// include common/halves.wgsl

@group(0) @binding(0) var<uniform> shares: Shares;
@group(0) @binding(1) var<storage, read> halves: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> light: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> filtered: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> measures: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let pixel = id.x + id.y * groups.x * 256u;
    if pixel >= shares.pixels {
        return;
    }
    var all = vec4<f32>(0.0);
    if is_mixed(pixel, light[pixel], filtered[pixel]) {
        let a = half_of(pixel, false);
        let b = half_of(pixel, true);
        let bias = dot(a - filtered[pixel].xyz, b - filtered[pixel].xyz);
        all = vec4<f32>(bias, bias * bias, 0.25 * dot(a - b, a - b), 1.0);
    }
    for (var i = 0u; i < 4u; i++) {
        measures[i * shares.pixels + pixel] = all[i];
    }
}
