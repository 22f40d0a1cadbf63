// Bilateral mean of the depth image along an axis, of five taps `STEP` pixels apart. Twin:
// crates/render/src/passes/smooth_depth.rs.

// include common/frame.wgsl
// include common/radii.wgsl
// include common/smoothing.wgsl

// Distance between taps, pixels.
override STEP: u32;
// Whether along columns, else along rows.
override DOWN: bool;
// Weights from the centre outwards (binomial).
const TAPS: vec3<f32> = vec3<f32>(6.0, 4.0, 1.0);
// Radius of discs over the distance of taps above which a round has any weight, and all of its
// weight.
const RADIUS_PER_STEP: vec2<f32> = vec2<f32>(1.7, 2.5);

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> smoothing: Smoothing;
@group(0) @binding(2) var<storage, read> rough: array<f32>;
@group(0) @binding(3) var<storage, read_write> smoothed: array<f32>;
// Result of the previous round, which replaces the rough image if a wider round was made.
@group(0) @binding(4) var<storage, read> smoother: array<f32>;
@group(0) @binding(5) var<storage, read> radii: array<f32>;

// Whether a wider round was made.
var<private> is_later: bool;

// The depth that this round smooths.
fn depth(pixel: u32) -> f32 {
    if is_later {
        return smoother[pixel];
    }
    return rough[pixel];
}

// Weight of the round whose taps are `step` pixels apart, for discs of this radius; 0 if it is left
// out.
fn share(step: u32, radius_px: f32) -> f32 {
    if step <= 2u {
        return 1.0;
    }
    let part = radius_px / f32(step) - RADIUS_PER_STEP.x;
    return clamp(part / (RADIUS_PER_STEP.y - RADIUS_PER_STEP.x), 0.0, 1.0);
}

// Sum of the taps at `distance` on both sides, and 1, if both are on the surface; else zeros.
// `limit` is the greatest difference of depth within a surface.
fn pair(pixel: u32, at: u32, count: u32, stride: u32, distance: u32, limit: f32) -> vec2<f32> {
    if at < distance || at + distance >= count {
        return vec2<f32>(0.0);
    }
    let here = depth(pixel);
    let before = depth(pixel - distance * stride);
    let after = depth(pixel + distance * stride);
    // Taps count in pairs, so that the edge of a slope does not bend inwards.
    let is_near = abs(before - here) < limit && abs(after - here) < limit;
    return select(vec2<f32>(0.0), vec2<f32>(before + after, 1.0), is_near);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    is_later = STEP < 8u && share(2u * STEP, smoothing.most_px) > 0.0;
    let is_made = share(STEP, smoothing.most_px) > 0.0;
    if !is_made || id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    let here = depth(pixel);
    let radius_px = radius_around(id.xy);
    let weight = share(STEP, radius_px);
    let at = select(id.x, id.y, DOWN);
    let count = select(frame.width, frame.height, DOWN);
    // Along rows only pixels with all taps in the picture are smoothed.
    let is_border = !DOWN && (at < 2u * STEP || at + 2u * STEP >= count);
    if weight == 0.0 || is_infinite(here) || is_border {
        smoothed[pixel] = here;
        return;
    }
    let stride = select(1u, frame.width, DOWN);
    let limit = near_share(f32(STEP), radius_px) * here;
    let inner = pair(pixel, at, count, stride, STEP, limit) * (TAPS.y * weight);
    let outer = pair(pixel, at, count, stride, 2u * STEP, limit) * (TAPS.z * weight);
    smoothed[pixel] = (here * TAPS.x + inner.x + outer.x) / (TAPS.x + 2.0 * (inner.y + outer.y));
}
