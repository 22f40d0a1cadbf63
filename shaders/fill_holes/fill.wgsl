// Closes the gaps: each becomes the mean of its neighbours in front of it that are no gaps
// themselves. Only such pixels are read and only gaps are written, so the order of pixels does not
// matter. Twin: crates/render/src/passes/fill_holes.rs.

// include common/frame.wgsl
// include common/marks.wgsl
// include common/around.wgsl

// Whether pixels carry normals.
override NORMALS: bool;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> marks: array<u32>;
@group(0) @binding(2) var<storage, read_write> depth: array<f32>;
@group(0) @binding(3) var<storage, read_write> front: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> tint: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> normal: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    if (marks[pixel] & GAP) == 0u {
        return;
    }
    let here = depth[pixel];
    var count = 0.0;
    var interval = vec2<f32>(0.0);
    var mean_tint = vec4<f32>(0.0);
    var mean_depth = 0.0;
    var mean_normal = vec4<f32>(0.0);
    for (var k = 0u; k < 8u; k++) {
        let n = beside(pixel, k);
        if (marks[n] & GAP) != 0u || !(depth[n] < here && is_in_front(depth[n], tint[n].w, here)) {
            continue;
        }
        count += 1.0;
        interval += front[n].xy;
        mean_tint += tint[n];
        mean_depth += depth[n];
        if NORMALS {
            mean_normal += normal[n];
        }
    }
    if count == 0.0 {
        return;
    }
    let share = 1.0 / count;
    depth[pixel] = mean_depth * share;
    front[pixel] = vec4<f32>(interval * share, 0.0, 0.0);
    tint[pixel] = mean_tint * share;
    if NORMALS {
        normal[pixel] = mean_normal * share;
    }
}
