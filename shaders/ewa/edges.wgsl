// Marks the edges of the depth image after EWA splatting, for the passes that follow; each pixel is
// its own source. Twin: crates/render/src/picture/edges.rs.

// include common/frame.wgsl
// include common/marks.wgsl
// include common/step.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> depth: array<f32>;
@group(0) @binding(2) var<storage, read_write> marks: array<u32>;
@group(0) @binding(3) var<storage, read_write> sources: array<u32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    marks[pixel] = select(0u, EDGE, is_edge(id.xy, pixel));
    sources[pixel] = 0u;
}
