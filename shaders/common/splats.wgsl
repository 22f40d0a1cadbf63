// Splats as crates/render/src/ewa/ makes them (splat.rs has the same record), and the settings of a batch of points.
// Needs common/infinite.wgsl.

struct Batch {
    // Square of the cutoff times the low-pass's variance, 0 without one.
    lowpass: f32,
    // Half the square of the cutoff.
    half_cutoff: f32,
    // Cutoff radii over stored ones.
    radius_factor: f32,
    // Its first chunk of points.
    first_chunk: u32,
    // Chunks of the frame.
    chunks: u32,
    // Places for points in a batch: whole chunks.
    points: u32,
    // Places for entries of tiles.
    entries: u32,
    // Whether it is the frame's first batch.
    is_first: u32,
    // Tiles in a row, rows of tiles.
    tiles: vec2<u32>,
    unused: vec2<u32>,
    // The eye on the lattice, rounded down: the part above 2^16, the part below, and what is left, steps.
    eye_high: vec3<i32>,
    eye_low: vec3<i32>,
    eye_rest: vec3<f32>,
    // Log2 of the grain of clip lines, an axis, steps.
    grain: vec3<u32>,
}

struct Splat {
    // Where its coordinates start, pixels; the first two of the form.
    a: vec4<f32>,
    // The rest of the form.
    b: vec4<f32>,
    // Inverse depth there, its growth to the right and down; how far it moves back.
    c: vec4<f32>,
    // Bits of its colour (linear light); its packed normal, or bits of its radius in pixels.
    d: vec4<u32>,
}

// What of a splat its clip lines keep: all, what the first one keeps, what both, what either.
const KEPT_WHOLE: u32 = 0u;
const KEPT_ONE: u32 = 1u;
const KEPT_BOTH: u32 = 2u;
const KEPT_EITHER: u32 = 3u;

// Pixels on a side of a tile.
const TILE: u32 = 16u;
// The first word of the empty box of a splat that cannot be drawn: the eye lies in its plane.
const DROPPED: u32 = 0xffffu;
// A point that is none.
const NOTHING: u32 = 0xffffffffu;
// As in crates/render/src/ewa/splat.rs.
const WIDENED: f32 = 0.875;

// Ten bits each, with a sign.
fn packed_normal(n: vec3<f32>) -> u32 {
    let q = vec3<u32>(n * 511.0 + 512.5) & vec3<u32>(0x3ffu);
    return q.x | (q.y << 10u) | (q.z << 20u);
}

fn unpacked_normal(code: u32) -> vec3<f32> {
    let q = (vec3<u32>(code) >> vec3<u32>(0u, 10u, 20u)) & vec3<u32>(0x3ffu);
    return (vec3<f32>(q) - 512.0) / 511.0;
}

// The square of the place in the splat, 1 at the cutoff, and the inverse depth on its plane; 2 where outside.
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
    // Where it pays, weights follow the exact projected Gaussian.
    if splat.b.y < 0.0 {
        let z = clamp(plane, ends.x, ends.y);
        squared = max(1.0 - (1.0 - squared) * (ends.x * ends.y) / (z * z), 0.0);
    }
    return vec2<f32>(squared, clamp(plane, ends.x * WIDENED, ends.y / WIDENED));
}
