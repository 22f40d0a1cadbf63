// Nested windows: adds the share of an addition that is light and not noise (James and Stein's
// estimator). Twin: crates/trace/src/filter/nested.rs.

// include common/usable.wgsl

@group(0) @binding(0) var<storage, read> guides: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> light: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> addition: array<vec4<f32>>;
// Planes of energies.wgsl, summed over windows.
@group(0) @binding(3) var<storage, read> energies: array<f32>;
@group(0) @binding(4) var<storage, read_write> filtered: array<vec4<f32>>;

// Times that the expected energy of the noise is subtracted.
const CAUTION: f32 = 1.1;

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
    let here = light[pixel];
    if !is_usable(here, guides[pixel]) {
        filtered[pixel] = unfiltered(here);
        return;
    }
    let part = 1.0 / max(energies[4u * pixels + pixel], 1.0);
    let mean = energies[pixel] * part;
    let variance = max(energies[pixels + pixel] * part - mean * mean, 0.0);
    let noise = CAUTION * variance * energies[2u * pixels + pixel] * part;
    let energy = energies[3u * pixels + pixel] * part;
    var share = 0.0;
    if energy > noise {
        share = 1.0 - noise / energy;
    }
    filtered[pixel] = vec4<f32>(filtered[pixel].xyz + share * addition[pixel].xyz, here.w);
}
