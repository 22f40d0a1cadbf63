// Puts discs into the order of their sorted keys.

@group(0) @binding(0) var<storage, read> pairs: array<vec2<u32>>;
@group(0) @binding(1) var<storage, read> discs: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> ordered: array<vec4<f32>>;

@compute @workgroup_size(256)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let at = id.x + id.y * groups.x * 256u;
    if at >= arrayLength(&ordered) / 2u {
        return;
    }
    let source = pairs[at].y;
    ordered[2u * at] = discs[2u * source];
    ordered[2u * at + 1u] = discs[2u * source + 1u];
}
