// Copies a buffer, 16 bytes a thread, to measure the memory bandwidth of kernels. Host:
// crates/bench/src/draw/gpu.rs.

@group(0) @binding(0) var<storage, read> source: array<vec4<u32>>;
@group(0) @binding(1) var<storage, read_write> copied: array<vec4<u32>>;

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = id.x + id.y * groups.x * 256u;
    if i < arrayLength(&source) {
        copied[i] = source[i];
    }
}
