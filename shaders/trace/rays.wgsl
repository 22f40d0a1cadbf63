// Traces a list of rays: the blended surface that each meets first, or whether anything lies on it.
// Twin: crates/trace/src/scene.

// include common/tree.wgsl

// Whether only to test whether rays are blocked.
override SHADOW: bool;

@group(0) @binding(0) var<uniform> tree: Tree;
@group(0) @binding(1) var<storage, read> boxes: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> discs: array<vec4<f32>>;
// Origin and reach, direction and nothing.
@group(0) @binding(3) var<storage, read> rays: array<vec4<f32>>;
// Distance and normal, albedo and lift. A ray that meets nothing has an
// infinite distance; one that is blocked a distance of zero.
@group(0) @binding(4) var<storage, read_write> hits: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let at = id.x + id.y * groups.x * 64u;
    if at >= arrayLength(&rays) / 2u {
        return;
    }
    let ray = Ray(rays[2u * at].xyz, rays[2u * at].w, rays[2u * at + 1u].xyz);
    if SHADOW {
        hits[2u * at] = vec4<f32>(select(infinity(), 0.0, is_blocked(ray)), 0.0, 0.0, 0.0);
        return;
    }
    let surface = blended(ray);
    hits[2u * at] = vec4<f32>(surface.distance, surface.normal);
    hits[2u * at + 1u] = vec4<f32>(surface.albedo, surface.lift);
}
