// Finds the rims of surfaces and lines that stick out beyond their samples: the source of a pixel
// at a rim becomes the pixel beyond the rim. Twin: `Rims::beyond` in
// crates/render/src/passes/silhouette/rim.rs, which explains the constants.

// include common/frame.wgsl
// include common/marks.wgsl
// include common/limit.wgsl
// include common/overhang.wgsl
// include common/turns.wgsl

// Distance without the surface beyond a rim, pixels: a radius, clamped to this range.
const OPEN_PX: vec2<f32> = vec2<f32>(4.0, 32.0);
// A surface may continue beyond a gap up to STEEPER times as steeply as before it; the slope is
// taken over these numbers of radii.
const SLOPE_RADII: vec3<i32> = vec3<i32>(2, 3, 4);
const STEEPER: f32 = 1.5;
// Least reach for which a slope is taken, pixels.
const SLOPE_REACH_MIN: i32 = 8;
// A common multiple of SLOPE_RADII.
const WIDTH_RADII: i32 = 12;
// Greatest width of a line, radii plus pixels; least length on either side, radii; and greatest
// radius, pixels.
const LINE_WIDTH: vec2<f32> = vec2<f32>(2.0, 2.0);
const LINE_SIDE: f32 = 2.0;
const LINE_RADIUS_MAX_PX: f32 = 32.0;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> marks: array<u32>;
@group(0) @binding(2) var<storage, read> depth: array<f32>;
@group(0) @binding(3) var<storage, read> front: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> tint: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> sources: array<u32>;
// Whether a pixel of a tile was removed.
@group(0) @binding(6) var<storage, read_write> gone: array<atomic<u32>>;

// include common/source.wgsl

fn is_in_picture(at: vec2<i32>) -> bool {
    return all(at >= vec2<i32>(0)) && all(at < vec2<i32>(i32(frame.width), i32(frame.height)));
}

fn pixel_of(at: vec2<i32>) -> u32 {
    return u32(at.y) * frame.width + u32(at.x);
}

// Growth of depth over WIDTH_RADII times `reach` beyond a pixel up to which the surface continues.
// Computed without a division, because GPUs may round quotients differently.
fn rise_of(at: vec2<i32>, way: vec2<i32>, reach: i32) -> f32 {
    var rise = 0.0;
    if reach < SLOPE_REACH_MIN {
        return rise;
    }
    for (var i = 0; i < 3; i++) {
        let inner = at - way * (SLOPE_RADII[i] * reach);
        if is_in_picture(inner) {
            let times = STEEPER * f32(WIDTH_RADII / SLOPE_RADII[i]);
            rise = max(rise, (depth[pixel_of(at)] - depth[pixel_of(inner)]) * times);
        }
    }
    return rise;
}

// Whether within `reach` pixels in direction `way` nothing is as near as the surface or its
// continuation.
fn is_open(at: vec2<i32>, way: vec2<i32>, reach: i32, beyond: f32) -> bool {
    // In most cases the next pixel is as near, which needs no slope.
    if is_in_picture(at + way) && depth[pixel_of(at + way)] <= beyond {
        return false;
    }
    let rise = rise_of(at, way, reach);
    for (var k = 1; k <= reach; k++) {
        let there = at + way * k;
        if !is_in_picture(there) {
            return f32(k) > OPEN_PX.x;
        }
        if (depth[pixel_of(there)] - beyond) * f32(WIDTH_RADII * reach) <= rise * f32(k) {
            return false;
        }
    }
    return true;
}

// Whether the surface continues for `wanted` steps in direction `way`.
fn goes_on(start: vec2<i32>, way: vec2<i32>, wanted: u32, radius: f32) -> bool {
    let slack = 1.0 + radius * (1.0 / frame.focal_px);
    var at = start;
    for (var steps = 0u; steps < wanted; steps++) {
        let next = at + way;
        if !is_in_picture(next) || depth[pixel_of(next)] > depth[pixel_of(at)] * slack {
            return false;
        }
        at = next;
    }
    return true;
}

// Whether the band inside a rim that is open in direction `outwards` is a line: no wider than a
// disc, open on its other side, and long.
fn is_line(at: vec2<i32>, outwards: u32, beyond: f32) -> bool {
    let radius = tint[pixel_of(at)].w;
    if radius > LINE_RADIUS_MAX_PX {
        return false;
    }
    let inwards = direction(outwards + 4u);
    let along = direction(outwards + 2u);
    let width = (radius * LINE_WIDTH.x + LINE_WIDTH.y) / stride(inwards);
    var inner = at;
    for (var k = 0; ; k++) {
        let next = inner + inwards;
        if !is_in_picture(next) || depth[pixel_of(next)] > beyond {
            let reach = i32(clamp(radius + 1.0, OPEN_PX.x, OPEN_PX.y));
            if !is_open(inner, inwards, reach, beyond) {
                return false;
            }
            // Back from the far rim to the centre of the band.
            inner -= inwards * (k / 2);
            break;
        }
        if f32(k) > width {
            return false;
        }
        inner = next;
    }
    let wanted = u32(radius * LINE_SIDE / stride(along));
    return goes_on(inner, along, wanted, radius) && goes_on(inner, -along, wanted, radius);
}

// Whether the surface ends in direction `k`.
fn bit(open: u32, k: u32) -> bool {
    return ((open >> (k & 7u)) & 1u) == 1u;
}

// The outward direction, plus one, of the line that a rim belongs to; 0 if it belongs to none or is
// a tip.
fn line_of(at: vec2<i32>, pixel: u32, open: u32, beyond: f32) -> u32 {
    let count = countOneBits(open);
    if count > 5u {
        return 0u;
    }
    for (var k = 0u; k < 8u; k++) {
        let is_inner = bit(open, k + 7u) && bit(open, k) && bit(open, k + 1u);
        if is_inner && (count == 4u || bit(open, k + 6u) == bit(open, k + 2u)) {
            return select(0u, k + 1u, sticks_out(pixel, k + 1u) && is_line(at, k, beyond));
        }
    }
    return 0u;
}

// The source of a pixel at a rim, which is the pixel beyond; 0 if it is not at a rim. A rim is
// where the surface ends in three neighbouring directions.
fn beyond_rim(at: vec2<i32>, pixel: u32) -> u32 {
    if is_infinite(depth[pixel]) || !may_stick_out(pixel) {
        return 0u;
    }
    let beyond = limit(depth[pixel], pixel);
    let reach = i32(clamp(tint[pixel].w + 1.0, OPEN_PX.x, OPEN_PX.y));
    // A bit for each open direction; diagonals are tested only beside an open one.
    var open = 0u;
    for (var k = 0u; k < 8u; k += 2u) {
        if is_open(at, direction(k), reach, beyond) {
            open |= 1u << k;
        }
    }
    for (var k = 1u; k < 8u; k += 2u) {
        let beside = (1u << (k - 1u)) | (1u << ((k + 1u) & 7u));
        if (open & beside) != 0u && is_open(at, direction(k), reach, beyond) {
            open |= 1u << k;
        }
    }
    for (var k = 0u; k < 8u; k++) {
        let three = (1u << k) | (1u << ((k + 1u) & 7u)) | (1u << ((k + 7u) & 7u));
        if (open & three) == three {
            let there = at + direction(k);
            if !is_in_picture(there) {
                return 0u;
            }
            let line = line_of(at, pixel, open, beyond);
            if line == 0u && !sticks_out(pixel, 0u) {
                return 0u;
            }
            return (pixel_of(there) + 1u) | (line << PIXEL_BITS);
        }
    }
    return 0u;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    var source = 0u;
    if (marks[pixel] & EDGE) != 0u {
        source = beyond_rim(vec2<i32>(id.xy), pixel);
    }
    sources[pixel] = source;
    if source != 0u {
        atomicStore(&gone[id.y / TILE * picture_tiles().x + id.x / TILE], 1u);
    }
}
