// Mixes the attributes of the winning points in level 0 with the averages of the pixels' front
// surfaces. Twin: crates/render/src/passes/average.rs.

// include common/frame.wgsl
// include common/average.wgsl

// Whether pixels carry normals.
override NORMALS: bool = false;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> sums: array<u32>;
@group(0) @binding(2) var<storage, read_write> front: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> tint: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> depths: array<f32>;
@group(0) @binding(5) var<storage, read_write> normals: array<vec4<f32>>;

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let pixel = id.x + id.y * groups.x * 256u;
    if pixel >= frame.width * frame.height {
        return;
    }
    let first = pixel * words();
    let count = f32(sums[first + AT_COUNT]);
    if count <= 1.0 || count > POINTS_MAX {
        return;
    }
    let share = 1.0 / (count * STEPS);
    let at = first + AT_COLOUR;
    let colour = vec3<f32>(vec3<u32>(sums[at], sums[at + 1u], sums[at + 2u])) * share;
    let own = tint[pixel];
    tint[pixel] = vec4<f32>(own.xyz * (1.0 - frame.crowding) + colour * frame.crowding, own.w);
    if NORMALS {
        let n = first + AT_NORMAL;
        let mean = vec3<f32>(vec3<u32>(sums[n], sums[n + 1u], sums[n + 2u])) * share;
        var normal = mean * 2.0 - 1.0;
        // Without any normals the mean differs from zero by the rounding to steps only.
        if all(abs(normal) <= vec3<f32>(2.0 / STEPS)) {
            normal = vec3<f32>(0.0);
        }
        let before = normals[pixel];
        normal = before.xyz * (1.0 - frame.crowding) + normal * frame.crowding;
        normals[pixel] = vec4<f32>(normal, before.w);
        return;
    }
    let depth = depths[pixel];
    let reach = bitcast<f32>(sums[first + AT_REACH]);
    let scale = frame.focal_px / depth - f32(sums[first + AT_DEPTH]) * share * reach;
    let moved = (frame.focal_px / scale - depth) * frame.crowding;
    depths[pixel] = depth + moved;
    front[pixel] += vec4<f32>(moved, moved, 0.0, 0.0);
}
