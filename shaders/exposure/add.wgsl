// Adds the colour of each pixel to two slots of its cell: that of all scans and that of its own
// scan. Twin: crates/render/src/passes/exposure.rs.

// include common/frame.wgsl
// include common/exposure.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> front: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> tint: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> depths: array<f32>;
@group(0) @binding(4) var<storage, read> slots: array<u32>;
@group(0) @binding(5) var<storage, read_write> sums: array<atomic<u32>>;

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let pixel = id.x + id.y * groups.x * 256u;
    if pixel >= frame.width * frame.height || is_infinite(front[pixel].x) {
        return;
    }
    let cell = vec2<u32>(pixel % frame.width, pixel / frame.width) / CELL_PX;
    let first = slots_at(cell, bitcast<u32>(depths[pixel]) >> SLICE_BITS);
    let colour = vec3<u32>(clamp(tint[pixel].xyz, vec3<f32>(0.0), vec3<f32>(1.0)) * STEPS + 0.5);
    let value = vec4<u32>(colour, 1u);
    let own = first + slots[pixel] * 4u;
    for (var k = 0u; k < 4u; k += 1u) {
        atomicAdd(&sums[first + k], value[k]);
        atomicAdd(&sums[own + k], value[k]);
    }
}
