// Nested windows, last step: scales each channel to its mean before the filter, from which the
// additions take it by some thousandths. Twin: crates/trace/src/filter/nested.rs.

// include common/usable.wgsl

@group(0) @binding(0) var<storage, read> guides: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> light: array<vec4<f32>>;
// Sums of totals.wgsl.
@group(0) @binding(2) var<storage, read> totals: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> filtered: array<vec4<f32>>;

// Greatest change of the mean that is taken back.
const MEAN_CHANGE_MAX: f32 = 0.02;

@compute @workgroup_size(256)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let pixel = id.x + id.y * groups.x * 256u;
    if pixel >= arrayLength(&light) || !is_usable(light[pixel], guides[pixel]) {
        return;
    }
    var before = vec3<f32>(0.0);
    var after = vec3<f32>(0.0);
    for (var i = 0u; i < arrayLength(&totals) / 2u; i++) {
        before += totals[2u * i].xyz;
        after += totals[2u * i + 1u].xyz;
    }
    let factor = before / after;
    let is_bias = abs(factor - 1.0) < vec3<f32>(MEAN_CHANGE_MAX);
    let own = filtered[pixel];
    filtered[pixel] = vec4<f32>(own.xyz * select(vec3<f32>(1.0), factor, is_bias), own.w);
}
