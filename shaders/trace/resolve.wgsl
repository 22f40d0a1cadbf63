// Combines a picture: filtered indirect light, looked up by all samples and multiplied by their
// albedo, and direct light (`bauszat2011`, figure 1). Twin: crates/trace/src/paths/resolve.rs.

// include common/links.wgsl
// include common/places.wgsl

struct Size {
    width: u32,
    height: u32,
    // Samples of each pixel.
    samples: u32,
    // First row of the part, number of its rows, and first row whose places are in memory.
    first: u32,
    rows: u32,
    first_place: u32,
    unused: u32,
    unused_2: u32,
}

@group(0) @binding(0) var<uniform> size: Size;
@group(0) @binding(1) var<storage, read> places: array<vec4<f32>>;
// As in direct.wgsl.
@group(0) @binding(2) var<storage, read> sums: array<vec4<u32>>;
// Filtered incident indirect light.
@group(0) @binding(3) var<storage, read> light: array<vec4<f32>>;
// For all pixels direct light and the share of samples that hit a surface, then indirect light and
// depth.
@group(0) @binding(4) var<storage, read_write> picture: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= size.width || id.y >= size.rows {
        return;
    }
    let pixel = (id.y + size.first) * size.width + id.x;
    let pixels = size.width * size.height;
    let seen = place_of(pixel - size.first_place * size.width);
    // Index of the pixel, and number of pixels, of the part.
    let own = id.y * size.width + id.x;
    let part = size.width * size.rows;
    let share = 1.0 / f32(max(size.samples, 1u));
    var indirect = bitcast<vec4<f32>>(sums[part + own]).xyz;
    if size.samples > 1u {
        for (var slot = 0u; slot < 9u; slot++) {
            let pair = sums[2u * part + 5u * own + slot / 2u];
            let albedo = albedo_sum(select(pair.xy, pair.zw, (slot & 1u) == 1u));
            if any(albedo != vec3<f32>(0.0)) {
                let other = pixel + slot % 3u + slot / 3u * size.width - size.width - 1u;
                indirect += albedo * light[other].xyz;
            }
        }
    } else if reflects(seen) {
        indirect += seen.colour * light[pixel].xyz;
    }
    picture[pixel] = bitcast<vec4<f32>>(sums[own]) * share;
    picture[pixels + pixel] = vec4<f32>(indirect * share, seen.depth);
}
