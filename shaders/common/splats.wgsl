// Splats, and the uniform of a batch of points. Needs common/infinite.wgsl. Host:
// crates/render/src/gpu/passes/ewa.rs. Twins: crates/render/src/ewa/splat.rs (the same record) and
// clip.rs.

struct Batch {
    // Square of the cutoff times the variance of the low-pass; 0 without a low-pass.
    lowpass: f32,
    // Half the square of the cutoff.
    half_cutoff: f32,
    // Cutoff radii over stored radii.
    radius_factor: f32,
    // First chunk of the batch.
    first_chunk: u32,
    // Number of chunks of the frame.
    chunks: u32,
    // Capacity for points, a multiple of a chunk.
    points: u32,
    // Capacity for entries of tiles.
    entries: u32,
    // 1 for the first batch of the frame.
    is_first: u32,
    // Tiles across and down the picture.
    tiles: vec2<u32>,
    unused: vec2<u32>,
    // The eye on the lattice, in steps: multiples of 2^16, the whole steps below, and the fraction.
    anchor_high: vec3<i32>,
    anchor_low: vec3<i32>,
    anchor_rest: vec3<f32>,
    // Log2 of the grain of clip lines along each axis, steps.
    grain: vec3<u32>,
}

struct Splat {
    // Origin of its coordinates, pixels; the first two coefficients of the form.
    a: vec4<f32>,
    // The other coefficients of the form.
    b: vec4<f32>,
    // Inverse depth at the origin, its growth a pixel right and down; distance by which it is moved
    // back.
    c: vec4<f32>,
    // Bits of its colour (linear light); its packed normal, or the bits of its radius in pixels.
    d: vec4<u32>,
}

// The part of a splat that its clip lines keep: all of it, the side of one line, of both, or of
// either.
const KEPT_WHOLE: u32 = 0u;
const KEPT_ONE: u32 = 1u;
const KEPT_BOTH: u32 = 2u;
const KEPT_EITHER: u32 = 3u;

// Pixels on a side of a tile.
const TILE: u32 = 16u;
// First word of the empty box of a splat that cannot be drawn because the eye is in its plane.
const DROPPED: u32 = 0xffffu;
// Number of no point.
const NOTHING: u32 = 0xffffffffu;
// How far beyond the disc's own range of inverse depths its plane is followed, as a factor.
const WIDENED: f32 = 0.875;

// A normal in ten bits an axis.
fn packed_normal(n: vec3<f32>) -> u32 {
    let q = vec3<u32>(n * 511.0 + 512.5) & vec3<u32>(0x3ffu);
    return q.x | (q.y << 10u) | (q.z << 20u);
}

// The normal of a code of packed_normal.
fn unpacked_normal(code: u32) -> vec3<f32> {
    let q = (vec3<u32>(code) >> vec3<u32>(0u, 10u, 20u)) & vec3<u32>(0x3ffu);
    return (vec3<f32>(q) - 512.0) / 511.0;
}

// Square of the distance of a pixel from the splat's centre (1 at the cutoff, 2 outside), and the
// inverse depth on the splat's plane.
fn seen_at(splat: Splat, place: vec2<f32>, near: f32) -> vec2<f32> {
    let d = place - splat.a.xy;
    let plane = splat.c.y * d.x + (splat.c.x + splat.c.z * d.y);
    if splat.c.w < 0.0 {
        let u = (splat.a.z * d.x + (splat.b.x + splat.a.w * d.y)) / plane;
        let v = (splat.b.y * d.x + (splat.b.w + splat.b.z * d.y)) / plane;
        let squared = u * u + v * v;
        let meets = plane > 0.0 && plane <= 1.0 / near && squared < 1.0;
        return vec2<f32>(select(2.0, squared, meets), plane);
    }
    let u = splat.a.z * d.x - splat.a.w * d.y;
    let v = splat.b.x * d.y;
    var squared = u * u + v * v;
    if !(squared < 1.0) {
        return vec2<f32>(2.0, 1.0);
    }
    let ends = splat.b.zw;
    // If depth varies much over the splat, weights follow the exact projected Gaussian.
    if splat.b.y < 0.0 {
        let z = clamp(plane, ends.x, ends.y);
        squared = max(1.0 - (1.0 - squared) * (ends.x * ends.y) / (z * z), 0.0);
    }
    return vec2<f32>(squared, clamp(plane, ends.x * WIDENED, ends.y / WIDENED));
}
