// Guided filter, first step: sums of each moment over the pixels of a row within the radius. Pixels
// that are not usable are left out. Twin: crates/trace/src/filter/moments.rs.

// include common/band.wgsl
// include common/guides.wgsl
// include common/box_sum.wgsl
// include common/usable.wgsl

@group(0) @binding(0) var<uniform> band: Band;
// Normal (0 to 1) and depth.
@group(0) @binding(1) var<storage, read> guides: array<vec4<f32>>;
// Light, and 1 where there is a surface, else 0.
@group(0) @binding(2) var<storage, read> light: array<vec4<f32>>;
// Planes of sums.
@group(0) @binding(3) var<storage, read_write> sums: array<f32>;

var<private> row: u32;
var<private> plane: u32;

// White noise of variance one: a random sign, by the hash `lowbias32` (Wellons) of the pixel.
fn white(pixel: u32) -> f32 {
    var hash = pixel;
    hash = (hash ^ (hash >> 16u)) * 0x7feb352du;
    hash = (hash ^ (hash >> 15u)) * 0x846ca68bu;
    return select(-1.0, 1.0, ((hash ^ (hash >> 16u)) & 1u) == 0u);
}

// One of: 1, the guides (1 to 4), the channels of light (5 to 7), white noise (8), luminance (9).
fn factor(which: u32, guide: vec4<f32>, colour: vec3<f32>, noise: f32) -> f32 {
    var all = array<f32, 10>(
        1.0,
        guide.x,
        guide.y,
        guide.z,
        guide.w,
        colour.x,
        colour.y,
        colour.z,
        noise,
        luminance(colour),
    );
    return all[which];
}

// Factors of a moment.
fn factors(moment: u32) -> vec2<u32> {
    var at = moment;
    if at <= GUIDES {
        return vec2<u32>(0u, at);
    }
    at -= 1u + GUIDES;
    for (var i = 1u; i <= GUIDES; i++) {
        let pairs = GUIDES + 1u - i;
        if at < pairs {
            return vec2<u32>(i, i + at);
        }
        at -= pairs;
    }
    if at < SIGNALS * (GUIDES + 1u) {
        return vec2<u32>(at / SIGNALS, 5u + at % SIGNALS);
    }
    return vec2<u32>(9u, 9u);
}

var<private> pair: vec2<u32>;

fn item(x: i32) -> f32 {
    if x < 0 || x >= i32(band.width) {
        return 0.0;
    }
    let pixel = (band.pixel_first + row) * band.width + u32(x);
    let here = light[pixel];
    let guide = guides[pixel];
    if !is_usable(here, guide) {
        return 0.0;
    }
    let used = used(guide);
    let noise = white(pixel);
    return factor(pair.x, used, here.xyz, noise) * factor(pair.y, used, here.xyz, noise);
}

fn put(x: i32, sum: f32) {
    if x < i32(band.width) {
        sums[(plane * band.pixel_rows + row) * band.width + u32(x)] = sum;
    }
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let first = i32(id.x) * RUN;
    if first >= i32(band.width) || id.y >= band.pixel_rows {
        return;
    }
    row = id.y;
    plane = id.z;
    pair = factors(plane);
    box_sums(first, band.radius);
}
