// Copies the result of the point primitives to the frame buffer. Host:
// crates/render/src/gpu/passes/primitives.rs.

// include common/frame.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
// Number of the point in x, bits of its depth in y; all ones without a point.
@group(0) @binding(1) var drawn: texture_2d<u32>;
@group(0) @binding(2) var<storage, read_write> hits: array<vec2<u32>>;

@compute @workgroup_size(16, 16)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < frame.width && id.y < frame.height {
        hits[id.y * frame.width + id.x] = textureLoad(drawn, id.xy, 0).xy;
    }
}
