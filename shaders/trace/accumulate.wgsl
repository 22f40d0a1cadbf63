// What the filter takes: the mean of the samples of incident indirect light, and the guides of each
// pixel. Twin: crates/trace/src/paths/frame.rs.

// include common/places.wgsl
// include common/history.wgsl

struct Means {
    // Pixels of the picture.
    pixels: u32,
    // Samples of each pixel.
    samples: u32,
    // Constant of the scene that depth is divided by.
    diagonal: f32,
    // Pixels of the part, the first of them, and the first whose place is in memory.
    part_pixels: u32,
    first: u32,
    first_place: u32,
    // Whether light of the last picture is used.
    has_past: u32,
    // Depth from which depths guide.
    guides_from: f32,
}

@group(0) @binding(0) var<uniform> means: Means;
@group(0) @binding(1) var<storage, read> places: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> halves: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> light: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> guides: array<vec4<f32>>;
// Light of the last picture, and the number of samples that it stands for.
@group(0) @binding(5) var<storage, read> past: array<vec4<f32>>;

@compute @workgroup_size(256)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let at = id.x + id.y * groups.x * 256u;
    if at >= means.part_pixels {
        return;
    }
    let pixel = at + means.first;
    let place = place_of(pixel - means.first_place);
    if !receives(place) {
        light[pixel] = vec4<f32>(0.0);
        guides[pixel] = vec4<f32>(0.0);
        return;
    }
    var sum = halves[pixel].xyz + halves[means.pixels + pixel].xyz;
    var samples = f32(means.samples);
    if means.has_past == 1u {
        let left = samples_left(past[pixel].w, samples);
        sum += past[pixel].xyz * left;
        samples += left;
    }
    light[pixel] = vec4<f32>(sum / select(1.0, samples, samples > 0.0), 1.0);
    let depth = (place.depth - means.guides_from) / means.diagonal;
    guides[pixel] = vec4<f32>(place.normal * 0.5 + 0.5, depth);
}
