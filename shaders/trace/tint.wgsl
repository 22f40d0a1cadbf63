// Turns splats into discs, in place: radius, albedo and no emission. Splats that no ray can meet
// become discs without extent. Host: crates/trace/src/gpu/collect.rs. Twin:
// crates/trace/src/scene/splats.rs.

// include common/infinite.wgsl
// include common/fine.wgsl

struct Rule {
    // Least corner of the scene, where discs without extent lie.
    corner: vec4<f32>,
    // Albedo of all splats, if they have the same.
    plain: vec4<f32>,
    // Factor and range from colours to albedo.
    factor: f32,
    least: f32,
    most: f32,
    is_plain: u32,
    // Number of splats.
    count: u32,
    unused: u32,
    unused_2: u32,
    unused_3: u32,
}

@group(0) @binding(0) var<uniform> rule: Rule;
// Splats as crates/render/src/gpu/splats.rs writes them, then discs (common/discs.wgsl).
@group(0) @binding(1) var<storage, read_write> discs: array<vec4<f32>>;

@compute @workgroup_size(256)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let at = id.x + id.y * groups.x * 256u;
    if at >= rule.count {
        return;
    }
    let place = discs[2u * at];
    let more = discs[2u * at + 1u];
    let radius = place.w * RADIUS_FACTOR;
    if !is_fine(place.xyz, radius, more.yzw) {
        discs[2u * at] = vec4<f32>(rule.corner.xyz, 0.0);
        discs[2u * at + 1u] = vec4<f32>(0.0);
        return;
    }
    let colour = select(more.yzw, rule.plain.xyz, rule.is_plain == 1u);
    let albedo = min(max(colour * rule.factor, vec3<f32>(rule.least)), vec3<f32>(rule.most));
    let tint = vec3<u32>(albedo * 65535.0 + 0.5);
    discs[2u * at] = vec4<f32>(place.xyz, radius);
    discs[2u * at + 1u] =
        vec4<f32>(more.x, bitcast<f32>(tint.x | (tint.y << 16u)), bitcast<f32>(tint.z), 0.0);
}
