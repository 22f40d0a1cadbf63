// Nested windows: what smaller windows add to the filtered picture, or the light that the filtered
// picture leaves. Twin: crates/trace/src/filter/nested.rs.

// include common/usable.wgsl

// Whether of the light, else of the picture that is in `difference`.
override OF_LIGHT: bool;

@group(0) @binding(0) var<storage, read> guides: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> light: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> filtered: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> difference: array<vec4<f32>>;

@compute @workgroup_size(256)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let pixel = id.x + id.y * groups.x * 256u;
    if pixel >= arrayLength(&light) {
        return;
    }
    let here = light[pixel];
    if !is_usable(here, guides[pixel]) {
        difference[pixel] = vec4<f32>(0.0);
    } else if OF_LIGHT {
        difference[pixel] = vec4<f32>(here.xyz - filtered[pixel].xyz, 0.0);
    } else {
        difference[pixel] -= filtered[pixel];
    }
}
