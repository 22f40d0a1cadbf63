// Conversion between linear light and sRGB. Needs common/infinite.wgsl. The host uses tables
// (crates/render/src/inputs/colour.rs), so bytes may differ by one.

// A value clamped to 0 to 1; 0 for NaN.
fn share(x: f32) -> f32 {
    return select(0.0, clamp(x, 0.0, 1.0), is_number(x));
}

// sRGB of linear light.
fn srgb_of(light: vec3<f32>) -> vec3<f32> {
    let c = vec3<f32>(share(light.x), share(light.y), share(light.z));
    let curve = 1.055 * pow(c, vec3<f32>(1.0 / 2.4)) - 0.055;
    return select(curve, c * 12.92, c <= vec3<f32>(0.0031308));
}

// Linear light of sRGB.
fn light_of(srgb: vec3<f32>) -> vec3<f32> {
    let curve = pow((srgb + 0.055) / 1.055, vec3<f32>(2.4));
    return select(curve, srgb / 12.92, srgb <= vec3<f32>(0.04045));
}
