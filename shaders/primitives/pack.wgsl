// What the point primitives drew becomes the frame buffer that the passes after it read.

// include common/frame.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
// Point in x, bits of the depth in y; all ones where nothing was drawn.
@group(0) @binding(1) var drawn: texture_2d<u32>;
@group(0) @binding(2) var<storage, read_write> hits: array<vec2<u32>>;

@compute @workgroup_size(16, 16)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < frame.width && id.y < frame.height {
        hits[id.y * frame.width + id.x] = textureLoad(drawn, id.xy, 0).xy;
    }
}
