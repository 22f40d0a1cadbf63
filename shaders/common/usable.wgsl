// Which pixels of the light filters count: those with a surface, with finite guides and with finite
// light.

// include common/infinite.wgsl

// Greatest light that counts: above any, and low enough that the sum of squares of a window is
// finite.
const VALUE_MAX: f32 = 1e16;
// Greatest guide that counts. Guides are of the order of one.
const GUIDE_MAX: f32 = 1e4;

// Whether the size of all components is at most a limit. Compared by bits, which are in the order
// of positive numbers, because compilers may assume that no value is NaN.
fn all_within(values: vec4<f32>, limit: f32) -> bool {
    let sizes = bitcast<vec4<u32>>(values) & vec4<u32>(0x7fffffffu);
    return all(sizes <= vec4<u32>(bitcast<u32>(limit)));
}

// `light.w` is 1 where there is a surface, else 0.
fn is_usable(light: vec4<f32>, guides: vec4<f32>) -> bool {
    return light.w > 0.0 && all_within(light, VALUE_MAX) && all_within(guides, GUIDE_MAX);
}

// Result for a pixel that no filter changes: zero in channels that are not finite.
fn unfiltered(light: vec4<f32>) -> vec4<f32> {
    let lost = vec3<bool>(is_infinite(light.x), is_infinite(light.y), is_infinite(light.z));
    return vec4<f32>(select(light.xyz, vec3<f32>(0.0), lost), light.w);
}
