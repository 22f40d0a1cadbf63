// Nested windows: planes whose means decide which share of an addition is light: luminance of what
// the addition was filtered from, its square, the square of filtered white noise or of the gain,
// squared luminance of the addition, and 1 where the pixel counts. Twin:
// crates/trace/src/filter/nested.rs.

// include common/usable.wgsl

@group(0) @binding(0) var<storage, read> guides: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> light: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> noisy: array<vec4<f32>>;
// Light, and white noise that went through the same filter, or the gain.
@group(0) @binding(3) var<storage, read> addition: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> energies: array<f32>;

fn luminance(light: vec3<f32>) -> f32 {
    return dot(light, vec3<f32>(0.2126, 0.7152, 0.0722));
}

@compute @workgroup_size(256)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let pixel = id.x + id.y * groups.x * 256u;
    let pixels = arrayLength(&light);
    if pixel >= pixels {
        return;
    }
    var value = 0.0;
    var added = vec2<f32>(0.0);
    var share = 0.0;
    if is_usable(light[pixel], guides[pixel]) {
        value = luminance(noisy[pixel].xyz);
        added = vec2<f32>(luminance(addition[pixel].xyz), addition[pixel].w);
        share = 1.0;
    }
    energies[pixel] = value;
    energies[pixels + pixel] = value * value;
    energies[2u * pixels + pixel] = added.y * added.y;
    energies[3u * pixels + pixel] = added.x * added.x;
    energies[4u * pixels + pixel] = share;
}
