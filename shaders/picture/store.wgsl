// Copies the picture to the texture that a window shows, after resolve. Host:
// crates/render/src/gpu/passes/store.rs.

// include common/frame.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> rgba: array<u32>;
@group(0) @binding(2) var picture: texture_storage_2d<rgba8unorm, write>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < frame.width && id.y < frame.height {
        textureStore(picture, id.xy, unpack4x8unorm(rgba[id.y * frame.width + id.x]));
    }
}
