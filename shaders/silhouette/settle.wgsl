// Removes pixels that the waves left isolated, and writes the picture's depth: that of each pixel's
// source, continued behind the removed pixels. Twin: `Waves::left_alone` in
// crates/render/src/passes/silhouette/mod.rs, which explains the constants.

// include common/frame.wgsl
// include common/limit.wgsl

// A pixel is isolated if at least ALONE of its eight neighbours show a surface behind it and its
// radius is at least ALONE_RADIUS_PX, but not beside a pixel that was removed from a line.
const ALONE: u32 = 7u;
const ALONE_RADIUS_PX: f32 = 3.0;
// The surface behind is continued if its depth changes by at most STEEPEST (depth over width) and
// by at most the share RISE_MAX, and at least MIRRORED_PX pixels from the rim.
const STEEPEST: f32 = 4.0;
const MIRRORED_PX: i32 = 8;
const RISE_MAX: f32 = 0.5;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> sources: array<u32>;
@group(0) @binding(2) var<storage, read> depth: array<f32>;
@group(0) @binding(3) var<storage, read> tint: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> sources_after: array<u32>;
@group(0) @binding(5) var<storage, read_write> settled: array<f32>;

// include common/source.wgsl

// Whether a pixel is isolated; `beyond` is the depth at which another surface begins.
fn is_alone(at: vec2<u32>, pixel: u32, beyond: f32) -> bool {
    if any(at == vec2<u32>(0u)) || any(at + 1u == vec2<u32>(frame.width, frame.height)) {
        return false;
    }
    if !(tint[pixel].w >= ALONE_RADIUS_PX) {
        return false;
    }
    var behind = 0u;
    for (var i = 0u; i < 9u; i++) {
        let beside = pixel + i / 3u * frame.width + i % 3u - frame.width - 1u;
        if sources[beside] > PIXEL_MASK {
            return false;
        }
        if depth[source_of(beside)] > beyond {
            behind++;
        }
    }
    return behind >= ALONE;
}

// The farther source of two removed pixels, `found` and `beside`; `found` is `pixel` if none was
// found yet.
fn farther(found: u32, beside: u32, pixel: u32) -> u32 {
    if sources[beside] == 0u {
        return found;
    }
    let is_farther = found == pixel || depth[source_of(beside)] > depth[source_of(found)];
    return select(found, beside, is_farther);
}

// Continues the surface behind a removed pixel by mirroring it at the rim, if the mirrored pixel is
// of the same surface and was not removed itself.
fn carry_on(at: vec2<i32>, pixel: u32, source: u32) {
    let rim_pixel = (source & PIXEL_MASK) - 1u;
    let rim = vec2<i32>(i32(rim_pixel % frame.width), i32(rim_pixel / frame.width));
    let there = 2 * rim - at;
    let here = depth[rim_pixel];
    if any(there < vec2<i32>(0)) || any(there >= vec2<i32>(i32(frame.width), i32(frame.height))) || is_infinite(here) {
        return;
    }
    let mirrored = u32(there.y) * frame.width + u32(there.x);
    if sources[mirrored] != 0u || is_infinite(depth[mirrored]) {
        return;
    }
    let apart = abs(rim - at);
    let away = max(apart.x, apart.y);
    let slack = (tint[rim_pixel].w + f32(away) * STEEPEST) * (1.0 / frame.focal_px);
    let rise = depth[mirrored] - here;
    if away >= MIRRORED_PX && abs(rise) <= here * min(slack, RISE_MAX) {
        sources_after[pixel] = (mirrored + 1u) | (source & ~PIXEL_MASK);
        settled[pixel] = here - rise;
    }
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    let beyond = limit(depth[pixel], pixel);
    var after = pixel;
    if sources[pixel] == 0u && is_alone(id.xy, pixel, beyond) {
        after = farther(after, pixel - 1u, pixel);
        after = farther(after, pixel + 1u, pixel);
        after = farther(after, pixel - frame.width, pixel);
        after = farther(after, pixel + frame.width, pixel);
        // The new source must be behind the pixel.
        if !(depth[source_of(after)] > beyond) {
            after = pixel;
        }
    }
    sources_after[pixel] = sources[after];
    settled[pixel] = depth[source_of(after)];
    if sources[after] != 0u {
        carry_on(vec2<i32>(id.xy), pixel, sources[after]);
    }
}
