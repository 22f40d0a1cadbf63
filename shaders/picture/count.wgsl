// Counts the pixels of the picture, without its margin, that show a surface. Host:
// crates/render/src/gpu/feedback.rs.

// include common/frame.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> depth: array<f32>;
// Number of pixels with a winning point, and of pixels that show a surface.
@group(0) @binding(2) var<storage, read_write> counts: array<atomic<u32>, 2>;

var<workgroup> covered: atomic<u32>;

@compute @workgroup_size(256)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let pixel = id.x + id.y * groups.x * 256u;
    let size = vec2<u32>(frame.width, frame.height) - 2u * frame.margin_px;
    if pixel < size.x * size.y {
        let place = vec2<u32>(pixel % size.x, pixel / size.x) + frame.margin_px;
        if !is_infinite(depth[place.y * frame.width + place.x]) {
            atomicAdd(&covered, 1u);
        }
    }
    workgroupBarrier();
    if thread == 0u {
        atomicAdd(&counts[1], atomicLoad(&covered));
    }
}
