// Normalises sums by their weights (zwicker2004, section 6, third pass), in place, to level 0 of
// the pyramid, and writes the picture's depth. Twin: crates/render/src/ewa/blend.rs.

// include common/frame.wgsl
// include common/level.wgsl
// include common/unit.wgsl

// Whether the cloud has normals.
override NORMALS: bool = false;

@group(0) @binding(0) var<uniform> frame: Frame;
// Input: sums of the normal (or radius) and the inverse depth.
@group(0) @binding(1) var<storage, read_write> front: array<vec4<f32>>;
// Input: sums of red, green, blue and the weight.
@group(0) @binding(2) var<storage, read_write> tint: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> depths: array<f32>;
@group(0) @binding(4) var<storage, read_write> normals: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> depth: array<f32>;
// Number of pixels with a splat, and of pixels that show a surface.
@group(0) @binding(6) var<storage, read_write> counts: array<atomic<u32>, 2>;

var<workgroup> covered: atomic<u32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    if id.x < frame.width && id.y < frame.height {
        let pixel = id.y * frame.width + id.x;
        if normalise(pixel, id.xy) {
            atomicAdd(&covered, 1u);
        }
    }
    workgroupBarrier();
    if thread == 0u {
        atomicAdd(&counts[0], atomicLoad(&covered));
    }
}

// Normalises a pixel; whether it has a splat.
fn normalise(pixel: u32, at: vec2<u32>) -> bool {
    let sum = tint[pixel];
    if !(sum.w > 0.0) {
        front[pixel] = invalid();
        depth[pixel] = infinity();
        return false;
    }
    let share = 1.0 / sum.w;
    let shape = front[pixel] * share;
    let z = 1.0 / shape.w;
    front[pixel] = vec4<f32>(z, z, 0.0, 0.0);
    depths[pixel] = z;
    depth[pixel] = z;
    tint[pixel] = vec4<f32>(sum.xyz * share, select(shape.x, 1.0, NORMALS));
    if NORMALS {
        let world = shape.xyz;
        var n = vec3<f32>(dot(frame.right, world), dot(frame.up, world), dot(frame.back, world));
        if dot(n, n) < 1e-8 {
            // Without a normal the surface faces the eye.
            let from_middle = vec2<f32>(at) + 0.5 - frame.centre_px;
            n = unit_or(vec3<f32>(-from_middle.x, from_middle.y, frame.focal_px), vec3<f32>(0.0, 0.0, 1.0));
        }
        normals[pixel] = vec4<f32>(n, n.z);
    }
    return true;
}
