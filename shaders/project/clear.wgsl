// Clears the frame buffer: every pixel to all ones, which no point reaches. Host:
// crates/render/src/gpu/memory/hits.rs.

// include common/frame.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
// Number of the point in x, bits of its depth in y.
@group(0) @binding(1) var<storage, read_write> hits: array<vec2<u32>>;

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let pixel = id.x + id.y * groups.x * 256u;
    if pixel < frame.width * frame.height {
        hits[pixel] = vec2<u32>(0xffffffffu);
    }
}
