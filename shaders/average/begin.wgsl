// Clears the sums of each pixel and stores the plane of its winning point. Twin:
// crates/render/src/passes/average.rs.

// include common/frame.wgsl
// include common/tangent.wgsl
// include common/plane.wgsl
// include common/average.wgsl

// Whether pixels carry normals.
override NORMALS: bool = PLANE == NORMAL;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> front: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> from_planes: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read_write> sums: array<u32>;

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let pixel = id.x + id.y * groups.x * 256u;
    if pixel >= frame.width * frame.height {
        return;
    }
    let first = pixel * words();
    for (var i = 0u; i < words(); i += 1u) {
        sums[first + i] = 0u;
    }
    let own = front[pixel];
    if is_infinite(own.x) {
        sums[first + AT_SCALE] = INFINITE_BITS;
        return;
    }
    let scale = frame.focal_px / own.x;
    var slope = vec2<f32>(0.0);
    if PLANE == FITTED {
        let tilt = plane_of(pixel).xy;
        slope = vec2<f32>(-tilt.x, tilt.y) * scale;
    } else if PLANE == NORMAL {
        let centre = vec2<f32>(vec2<u32>(pixel % frame.width, pixel / frame.width)) + 0.5;
        slope = slope_of(plane_of(pixel), centre - own.zw) * scale;
    }
    sums[first + AT_SCALE] = bitcast<u32>(scale + dot(slope, own.zw));
    sums[first + AT_SLOPE] = bitcast<u32>(slope.x);
    sums[first + AT_SLOPE + 1u] = bitcast<u32>(slope.y);
    sums[first + AT_REACH] = bitcast<u32>(scale - frame.focal_px / own.y);
}
