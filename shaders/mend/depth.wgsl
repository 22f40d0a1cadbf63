// The depth image of the filled level: mean depths, infinite where there is nothing. Twin:
// `Level::depth_image` in crates/render/src/pyramid.rs.

// include common/frame.wgsl
// include common/level.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> front: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> mean_depth: array<f32>;
@group(0) @binding(3) var<storage, read_write> depth: array<f32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    depth[pixel] = select(infinity(), mean_depth[pixel], is_valid(front[pixel]));
}
