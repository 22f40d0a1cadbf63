// Uses incident light of the last picture again after a move of the camera: the mean of its guides
// around a place, of those that lie on its surface. A dispatch goes over a part of the new picture
// and one of the last. Host: crates/trace/src/gpu/history.rs. Twin:
// crates/trace/src/paths/history.rs.

// include common/places.wgsl
// include common/fits.wgsl
// include common/history.wgsl

struct Moved {
    // Eye of the last picture, and pixels of a unit of length at unit depth.
    eye: vec4<f32>,
    // Right, and the depth of the near plane.
    right: vec4<f32>,
    // Up; and the depth at which lengths have their size on the picture if rays are parallel, else
    // 0.
    up: vec4<f32>,
    forward: vec4<f32>,
    // Size of both pictures.
    width: u32,
    height: u32,
    // Samples of the last picture.
    samples: f32,
    // Whether light of the picture before it was used in it.
    has_past: u32,
    // Rows of the part, and the first whose places are in memory; then the same of the last
    // picture.
    first: u32,
    rows: u32,
    first_place: u32,
    last_first: u32,
    last_rows: u32,
    last_first_place: u32,
    // Pixels of a unit of length at unit depth in the new picture.
    focal: f32,
    unused: u32,
}

@group(0) @binding(0) var<uniform> moved: Moved;
@group(0) @binding(1) var<storage, read> places: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> last_places: array<vec4<f32>>;
// Mean incident light of the last picture, and what it used of the one before.
@group(0) @binding(3) var<storage, read> last_light: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> last_past: array<vec4<f32>>;
// Light, and the number of samples that it stands for.
@group(0) @binding(5) var<storage, read_write> past: array<vec4<f32>>;

// Share of the weight of a corner that is the same for all, so that a fitting one always counts.
const WEIGHT_LEAST: f32 = 1e-3;

fn last_place_of(pixel: u32) -> Place {
    let at = 3u * (pixel - moved.last_first_place * moved.width);
    let a = last_places[at];
    let b = last_places[at + 1u];
    let c = last_places[at + 2u];
    return Place(a.xyz, a.w, b.xyz, b.w, c.xyz, c.w);
}

// Samples that the light of a pixel of the last picture stands for.
fn samples_of(pixel: u32) -> f32 {
    let before = select(0.0, last_past[pixel].w, moved.has_past == 1u);
    return min(moved.samples + samples_left(before, moved.samples), HISTORY_SAMPLES);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= moved.width || id.y >= moved.rows {
        return;
    }
    let row = id.y + moved.first;
    let seen = place_of((row - moved.first_place) * moved.width + id.x);
    let towards = seen.point - moved.eye.xyz;
    let depth = dot(towards, moved.forward.xyz);
    if !receives(seen) || !(depth >= moved.right.w) {
        return;
    }
    let size = vec2<f32>(f32(moved.width), f32(moved.height));
    let off = vec2<f32>(dot(towards, moved.right.xyz), -dot(towards, moved.up.xyz));
    let at_depth = select(depth, moved.up.w, moved.up.w > 0.0);
    let corner = size * 0.5 + off * (moved.eye.w / at_depth) - 0.5;
    let top_left = floor(corner);
    if !(all(top_left >= vec2<f32>(-1.0)) && all(top_left < size)) {
        return;
    }
    // The part of the last picture that has the upper corners has the lower ones too.
    let owner = u32(max(top_left.y, 0.0));
    if owner < moved.last_first || owner >= moved.last_first + moved.last_rows {
        return;
    }
    var light = vec3<f32>(0.0);
    var samples = 0.0;
    var weights = 0.0;
    for (var i = 0u; i < 4u; i++) {
        let at = top_left + vec2<f32>(f32(i & 1u), f32(i >> 1u));
        if any(at < vec2<f32>(0.0)) || any(at >= size) {
            continue;
        }
        let pixel = u32(at.y) * moved.width + u32(at.x);
        let guide = last_place_of(pixel);
        if !receives(guide) || !fits(guide, seen, moved.focal) {
            continue;
        }
        let near = 1.0 - abs(corner - at);
        let weight = near.x * near.y + WEIGHT_LEAST;
        light += last_light[pixel].xyz * weight;
        samples += samples_of(pixel) * weight;
        weights += weight;
    }
    if weights > 0.0 {
        let held = min(samples / weights, HISTORY_SAMPLES);
        past[row * moved.width + id.x] = vec4<f32>(light / weights, held);
    }
}
