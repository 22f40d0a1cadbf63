// Project by one 64-bit atomic minimum a point: a pixel keeps the least `depth << 32 | point`
// (schuetz2021). A workgroup draws a chunk, run by run, and reads nothing of runs whose boxes are
// outside the picture. The frame buffer is read before it is written, because most points lose
// already there. Twin: crates/render/src/passes/project.rs.

// include common/points.wgsl
// include common/runs.wgsl

@group(0) @binding(7) var<storage, read_write> hits: array<atomic<u64>>;
// Boxes of the runs of the page of positions.
@group(0) @binding(8) var<storage, read> boxes: array<vec4<u32>>;

// Whether pixels are read and written. If not, all other work is done, for comparison in the
// benchmark `draw`.
override TOUCHES_PIXELS: bool = true;
// Whether runs are skipped by their boxes.
override SKIPS_RUNS: bool = true;

// Bound of rounding errors in the projections of a point and of a box, relative to the distance
// from the eye: about twenty roundings of 2^-24, and divisions, which drivers may round worse.
const ROUNDING: f32 = 0.00000381469726;

// Runs of the chunk that may be in the picture, a bit each.
var<workgroup> in_sight: atomic<u32>;

// Greatest extent of a box along a direction.
fn reach(along: vec3<f32>, middle: vec3<f32>, half: vec3<f32>) -> f32 {
    return dot(along, middle) + dot(abs(along), half);
}

// Whether a point of a run may be in the picture; NaN may be.
fn may_be_seen(draw: Draw, box: RunBox) -> bool {
    let dropped = select((1u << draw.shift) - 1u, 0u, draw.residual_page == NO_PAGE);
    let low = box.low << vec3<u32>(draw.shift);
    let high = (box.high << vec3<u32>(draw.shift)) + dropped;
    let a = steps_from_anchor(draw.base_high, draw.base_low, draw.bias_steps, low) * frame.step;
    let b = steps_from_anchor(draw.base_high, draw.base_low, draw.bias_steps, high) * frame.step;
    let middle = (a + b) * 0.5;
    let half = abs(b - a) * 0.5;
    // From the centre to the left and upper, and to the right and lower side of the picture at unit
    // depth, and a pixel.
    let size = vec2<f32>(f32(frame.width), f32(frame.height));
    let before = (frame.centre_px + 1.0) / frame.focal_px;
    let behind = (size - frame.centre_px + 1.0) / frame.focal_px;
    let slack = (dot(abs(middle) + half, vec3<f32>(1.0)) + frame.anchor_depth) * ROUNDING;
    // The sides of a pinhole's picture lean outwards; those of a parallel view are fixed.
    let leans = select(vec4<f32>(before, behind), vec4<f32>(0.0), frame.is_parallel == 1u);
    let first = -slack * (abs(before) + 1.0) - before * frame.anchor_depth;
    let last = -slack * (abs(behind) + 1.0) - behind * frame.anchor_depth;
    let is_near = reach(-frame.back, middle, half) < frame.near - frame.anchor_depth - slack;
    let is_left = reach(frame.right - frame.back * leans.x, middle, half) < first.x;
    let is_right = reach(-frame.right - frame.back * leans.z, middle, half) < last.x;
    let is_above = reach(-frame.up - frame.back * leans.y, middle, half) < first.y;
    let is_below = reach(frame.up - frame.back * leans.w, middle, half) < last.y;
    return !(is_near || is_left || is_right || is_above || is_below);
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let item = group.x + group.y * groups.x;
    if item >= arrayLength(&work) {
        return;
    }
    let number = work[item];
    let chunk = chunks[number];
    let draw = draws[chunk.draw];
    // Points are counted from the first byte of the page, like runs.
    let start = (draw.position_word >> 1u) + chunk.first;
    let end = start + min(chunk.points, CHUNK_POINTS);
    let first = start / RUN_POINTS;
    if first + thread < (end + RUN_POINTS - 1u) / RUN_POINTS {
        if !SKIPS_RUNS || may_be_seen(draw, unpack_box(boxes[first + thread])) {
            atomicOr(&in_sight, 1u << thread);
        }
    }
    workgroupBarrier();
    for (var left = atomicLoad(&in_sight); left != 0u; left &= left - 1u) {
        let at = (first + firstTrailingBit(left)) * RUN_POINTS + thread;
        if at >= start && at < end {
            draw_point(draw, chunk, number, at - start);
        }
    }
}

// Draws point `i` of chunk `number`.
fn draw_point(draw: Draw, chunk: Chunk, number: u32, i: u32) {
    let index = chunk.first + i;
    let seen = see(draw, index);
    if !is_inside(seen) {
        return;
    }
    let at = min(vec2<u32>(seen.at), vec2<u32>(frame.width, frame.height) - 1u);
    let pixel = at.y * frame.width + at.x;
    let value = (u64(bitcast<u32>(seen.depth)) << 32u) | u64(number * CHUNK_POINTS + i);
    if TOUCHES_PIXELS {
        if value >= atomicLoad(&hits[pixel]) {
            return;
        }
    } else if value > u64(pixel) {
        // Always true, because the bits of a depth are above all pixel indices; but a compiler does
        // not know that, and keeps both operands.
        return;
    }
    if is_dropped(chunk.draw, draw, index, seen) {
        return;
    }
    atomicMin(&hits[pixel], value);
}
