// The picture's depth after trimming: that of what each pixel shows.

// include common/frame.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> sources: array<u32>;
@group(0) @binding(2) var<storage, read> depth: array<f32>;
@group(0) @binding(3) var<storage, read_write> settled: array<f32>;

// include common/source.wgsl

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < frame.width && id.y < frame.height {
        let pixel = id.y * frame.width + id.x;
        settled[pixel] = depth[shown(pixel)];
    }
}
