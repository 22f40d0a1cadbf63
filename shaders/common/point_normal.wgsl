// Normals of points, turned to the eye. Needs common/place.wgsl, common/normal.wgsl,
// common/facing.wgsl, and variables `frame` and `draws`. Twin: crates/render/src/passes/gather.rs.

// The normal in view space; zero without a normal. The last value is 1 at the back of a
// surface, if normals have fronts, else 0.
fn normal_to_eye(code: u32, draw: u32, offset: vec3<u32>) -> vec4<f32> {
    if code == NO_NORMAL {
        return vec4<f32>(0.0);
    }
    let world = normal_of(code);
    // Unless back faces are culled, a normal may face either way, and is turned to the eye.
    let d = &draws[draw];
    let steps = steps_from_anchor((*d).base_high, (*d).base_low, (*d).bias_steps, offset);
    let from_eye = steps * frame.step - frame.back * frame.anchor_depth;
    let is_turned = frame.cull_back_faces == 0u;
    let n = select(world, towards_eye(world, from_eye), is_turned);
    let looked_away = select(0.0, 1.0, is_turned && frame.has_fronts == 1u && dot(world, from_eye) > 0.0);
    return vec4<f32>(dot(frame.right, n), dot(frame.up, n), dot(frame.back, n), looked_away);
}
