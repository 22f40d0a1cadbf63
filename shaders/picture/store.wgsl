// Copies the picture without its margin to the texture that a window shows, after dots are drawn.
// Host: crates/render/src/gpu/passes/store.rs.

// include common/frame.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> rgba: array<u32>;
@group(0) @binding(2) var picture: texture_storage_2d<rgba8unorm, write>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let margin = vec2<u32>(frame.margin_px);
    let at = id.xy + margin;
    if all(at + margin < vec2<u32>(frame.width, frame.height)) {
        textureStore(picture, id.xy, unpack4x8unorm(rgba[at.y * frame.width + at.x]));
    }
}
