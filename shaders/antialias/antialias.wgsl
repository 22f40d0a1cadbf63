// Antialias: smooths the picture where a surface ends before another or before the background, and
// at creases; and writes the picture. Twin: crates/render/src/passes/antialias.rs, which explains
// the method and the constants.

// include common/frame.wgsl
// include common/marks.wgsl
// include common/srgb.wgsl
// include common/backdrop.wgsl

// Whether pixels carry normals.
override NORMALS: bool;
// Weights along an axis, of coverage (binomial) and of colours, and the sums of all weights.
const COVERAGE: array<f32, 5> = array<f32, 5>(1.0, 4.0, 6.0, 4.0, 1.0);
const COVERAGE_SUM: f32 = 256.0;
const COLOUR: array<f32, 5> = array<f32, 5>(0.0, 1.0, 2.0, 1.0, 0.0);
const COLOUR_SUM: f32 = 16.0;
// Slope of the outline over that of its weighted count.
const STEEP: f32 = 1.5;
// Distance by which outlines are moved inwards, pixels.
const INSET_PX: f32 = 0.4;
// Slope (depth over width) above which neighbouring pixels show two surfaces.
const STEP_PX: f32 = 6.0;
// Square of the cosine of the angle between normals at a crease (30 degrees).
const CREASE: f32 = 0.75;
// Depth between a surface and the background.
const FAR: f32 = 3.4028234e38;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> depth: array<f32>;
@group(0) @binding(2) var<storage, read> marks: array<u32>;
@group(0) @binding(3) var<storage, read> normals: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> sources: array<u32>;
@group(0) @binding(5) var<storage, read> shaded: array<u32>;
@group(0) @binding(6) var<storage, read_write> rgba: array<u32>;
@group(0) @binding(7) var picture: texture_storage_2d<rgba8unorm, write>;

// include common/source.wgsl

// The greatest step of depth to a neighbour so far, and the depth halfway between its sides.
struct Split {
    step: f32,
    depth: f32,
}

// The greater of a step so far and that between two depths.
fn split_by(split: Split, here: f32, beside: f32) -> Split {
    if is_infinite(here) || is_infinite(beside) {
        // The background is farther than any surface.
        if is_infinite(here) != is_infinite(beside) && !is_infinite(split.step) {
            return Split(infinity(), FAR);
        }
        return split;
    }
    let step = abs(beside - here);
    let nearer = min(beside, here);
    if step > STEP_PX / frame.focal_px * nearer && step > split.step {
        return Split(step, nearer + step * 0.5);
    }
    return split;
}

// The depth between the sides of the greatest step to a neighbour; infinite without a step.
fn split_at(at: vec2<u32>, pixel: u32) -> f32 {
    let here = depth[pixel];
    var split = Split(0.0, infinity());
    if at.x > 0u {
        split = split_by(split, here, depth[pixel - 1u]);
    }
    if at.x + 1u < frame.width {
        split = split_by(split, here, depth[pixel + 1u]);
    }
    if at.y > 0u {
        split = split_by(split, here, depth[pixel - frame.width]);
    }
    if at.y + 1u < frame.height {
        split = split_by(split, here, depth[pixel + frame.width]);
    }
    return split.depth;
}

// Whether the pixel `beside` shows a surface whose normal makes a crease with `normal`.
fn is_crease(normal: vec3<f32>, beside: u32) -> bool {
    if is_infinite(depth[beside]) {
        return false;
    }
    let other = normals[source_of(beside)].xyz;
    let cosine = dot(normal, other);
    return cosine * max(cosine, 0.0) < CREASE * dot(normal, normal) * dot(other, other);
}

// Whether there is a crease between a pixel and its right or lower neighbour.
fn is_bent(at: vec2<u32>, pixel: u32) -> bool {
    if is_infinite(depth[pixel]) {
        return false;
    }
    let normal = normals[source_of(pixel)].xyz;
    return (at.x + 1u < frame.width && is_crease(normal, pixel + 1u))
        || (at.y + 1u < frame.height && is_crease(normal, pixel + frame.width));
}

// Whether a pixel was beside a step, or silhouette removed it or a neighbour.
fn is_outline(at: vec2<u32>, pixel: u32) -> bool {
    return (marks[pixel] & EDGE) != 0u
        || sources[pixel] != 0u
        || (at.x > 0u && sources[pixel - 1u] != 0u)
        || (at.x + 1u < frame.width && sources[pixel + 1u] != 0u)
        || (at.y > 0u && sources[pixel - frame.width] != 0u)
        || (at.y + 1u < frame.height && sources[pixel + frame.width] != 0u);
}

// A pixel of the surroundings, clamped to the picture.
fn around(at: vec2<u32>, dx: i32, dy: i32) -> u32 {
    let last = vec2<i32>(i32(frame.width), i32(frame.height)) - 1;
    let place = vec2<u32>(clamp(vec2<i32>(at) + vec2<i32>(dx, dy), vec2<i32>(0), last));
    return place.y * frame.width + place.x;
}

// An offset of about two pixels in a direction. Computed without a root, so that CPU and GPU choose
// the same.
fn inwards(slope: vec2<f32>) -> vec2<i32> {
    let square = dot(slope, slope);
    let part = slope * slope * 16.0;
    // Rounds the components of the offset: from three quarters of its length to two, from a quarter
    // to one.
    let steps = vec2<i32>(part > vec2<f32>(square)) + vec2<i32>(part > vec2<f32>(9.0 * square));
    return select(steps, -steps, slope < vec2<f32>(0.0));
}

// The mean colours in front of the depth `split` and behind it, mixed by coverage: sRGB bytes.
fn antialiased(at: vec2<u32>, split: f32) -> u32 {
    // Without a split all pixels are in front.
    let is_whole = is_infinite(split);
    var across = COVERAGE;
    var weights = COLOUR;
    var coverage = 0.0;
    // Direction in which the count of pixels in front grows: their weighted offsets.
    var slope = vec2<f32>(0.0);
    for (var y = 0; y < 5; y++) {
        for (var x = 0; x < 5; x++) {
            let d = depth[around(at, x - 2, y - 2)];
            if is_whole || (!is_infinite(d) && d <= split) {
                let count = across[x] * across[y];
                coverage += count;
                slope += vec2<f32>(vec2<i32>(x, y) - 2) * count;
            }
        }
    }
    let inner = inwards(slope);
    let d = depth[around(at, inner.x, inner.y)];
    if is_whole || (!is_infinite(d) && d <= split) {
        coverage -= INSET_PX * sqrt(dot(slope, slope));
    }
    // Weighted sums of colours times alpha, and of alpha: of the pixels in front, and of all.
    var before = vec4<f32>(0.0);
    var all = vec4<f32>(0.0);
    var weight = 0.0;
    for (var y = 1; y < 4; y++) {
        for (var x = 1; x < 4; x++) {
            let pixel = around(at, x - 2, y - 2);
            let share = weights[x] * weights[y];
            let seen = unpack4x8unorm(shaded[pixel]);
            let colour = vec4<f32>(light_of(seen.xyz), 1.0) * (seen.w * 255.0 * share);
            all += colour;
            if is_whole || (!is_infinite(depth[pixel]) && depth[pixel] <= split) {
                before += colour;
                weight += share;
            }
        }
    }
    let covered = clamp((coverage / COVERAGE_SUM - 0.5) * STEEP + 0.5, 0.0, 1.0);
    var mixed = all / COLOUR_SUM;
    if weight != 0.0 && weight != COLOUR_SUM {
        mixed = before * (covered / weight) + (all - before) * ((1.0 - covered) / (COLOUR_SUM - weight));
    }
    var light = vec3<f32>(0.0);
    if mixed.w > 0.0 {
        light = mixed.xyz / mixed.w;
    }
    return packed_bytes(vec4<u32>(vec4<f32>(srgb_of(light) * 255.0, mixed.w) + 0.5));
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    var colour = shaded[pixel];
    var is_soft = false;
    if NORMALS {
        is_soft = is_bent(id.xy, pixel);
    }
    if is_soft || is_outline(id.xy, pixel) {
        let split = split_at(id.xy, pixel);
        if is_soft || !is_infinite(split) {
            colour = antialiased(id.xy, split);
        }
    }
    rgba[pixel] = colour;
    // Wraps to large numbers in the margin left of the picture and above it.
    let place = id.xy - frame.margin_px;
    if all(place < vec2<u32>(frame.width, frame.height) - 2u * frame.margin_px) {
        textureStore(picture, place, unpack4x8unorm(colour));
    }
}
