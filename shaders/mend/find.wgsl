// Finds edges of the depth image, and among them the gaps: pixels that lie behind nearly all of their
// neighbours. Twins: crates/render/src/edges.rs, mend.rs.

// include common/frame.wgsl
// include common/marks.wgsl
// include common/around.wgsl
// include common/step.wgsl

// Whether pixels carry normals.
override NORMALS: bool;
// Whether edges are found; else those found before are looked at again.
override FIRST: bool;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> depth: array<f32>;
@group(0) @binding(2) var<storage, read> tint: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> marks: array<u32>;

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
    return count >= SURROUNDED;
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
    if mark != 0u && is_gap(id.xy, pixel) {
        mark |= GAP;
    }
    marks[pixel] = mark;
}
