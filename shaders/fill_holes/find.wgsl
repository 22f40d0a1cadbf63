// Finds edges of the depth image, and gaps: pixels behind nearly all of their neighbours
// (rosenthal2008). Twins: crates/render/src/picture/edges.rs, passes/fill_holes.rs.

// include common/frame.wgsl
// include common/marks.wgsl
// include common/around.wgsl
// include common/step.wgsl

// Whether pixels carry normals.
override NORMALS: bool;
// Whether edges are found; else those of the first round are kept.
override FIRST: bool;

// A pixel is a gap if SURROUNDED of its eight neighbours are in front of it, or CORNERED of them
// and, in each of the eight directions, a pixel in front within WITHIN_PX pixels and within its own
// radius.
const SURROUNDED: u32 = 6u;
const CORNERED: u32 = 5u;
const WITHIN_PX: i32 = 2;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> depth: array<f32>;
@group(0) @binding(2) var<storage, read> tint: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> marks: array<u32>;

// Whether in direction `k` a pixel in front of depth `here` is within its own radius.
fn meets(at: vec2<u32>, k: u32, here: f32) -> bool {
    // Row by row without the centre, as in beside().
    let i = i32(select(k + 1u, k, k < 4u));
    let way = vec2<i32>(i % 3 - 1, i / 3 - 1);
    for (var steps = 1; steps <= WITHIN_PX; steps++) {
        let there = vec2<i32>(at) + way * steps;
        if any(there < vec2<i32>(0)) || any(there >= vec2<i32>(i32(frame.width), i32(frame.height))) {
            return false;
        }
        let n = u32(there.y) * frame.width + u32(there.x);
        let radius = tint[n].w;
        if depth[n] < here && f32(steps) <= radius && is_in_front(depth[n], radius, here) {
            return true;
        }
    }
    return false;
}

// Whether a pixel is a gap.
fn is_gap(at: vec2<u32>, pixel: u32) -> bool {
    if any(at == vec2<u32>(0u)) || any(at + 1u == vec2<u32>(frame.width, frame.height)) {
        return false;
    }
    let here = depth[pixel];
    var count = 0u;
    for (var k = 0u; k < 8u; k++) {
        let n = beside(pixel, k);
        if depth[n] < here && is_in_front(depth[n], tint[n].w, here) {
            count++;
        }
    }
    if count < CORNERED || count >= SURROUNDED {
        return count >= SURROUNDED;
    }
    for (var k = 0u; k < 8u; k++) {
        if !meets(at, k, here) {
            return false;
        }
    }
    return true;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    var mark = 0u;
    if FIRST {
        mark = select(0u, EDGE, is_edge(id.xy, pixel));
    } else {
        mark = marks[pixel] & EDGE;
    }
    if is_gap(id.xy, pixel) {
        mark |= GAP;
    }
    marks[pixel] = mark;
}
