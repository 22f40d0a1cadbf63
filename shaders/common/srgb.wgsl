// Between linear light and sRGB bytes, four in a word, red lowest. The host has tables (crates/render/src/inputs/colour.rs);
// a byte of difference is possible. Needs common/infinite.wgsl.

// A share of 0 to 1; what is no number is 0.
fn share(x: f32) -> f32 {
    return select(0.0, clamp(x, 0.0, 1.0), is_number(x));
}

fn srgb_of(light: vec3<f32>) -> vec3<f32> {
    let c = vec3<f32>(share(light.x), share(light.y), share(light.z));
    let curve = 1.055 * pow(c, vec3<f32>(1.0 / 2.4)) - 0.055;
    return select(curve, c * 12.92, c <= vec3<f32>(0.0031308));
}

fn light_of(srgb: vec3<f32>) -> vec3<f32> {
    let curve = pow((srgb + 0.055) / 1.055, vec3<f32>(2.4));
    return select(curve, srgb / 12.92, srgb <= vec3<f32>(0.04045));
}
