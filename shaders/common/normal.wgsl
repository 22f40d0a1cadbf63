// Octahedral normals (meyer2010). Twin: crates/points/src/quant.rs.

// The code of a point without a normal.
const NO_NORMAL: u32 = 0x80008000u;

// Below this square of the cosine of its angle with the direction from the eye, a normal that looks
// away is taken for one at an outline. Twin: crates/render/src/simd/values.rs.
const OUTLINE_COS2: f32 = 0.125;

// A unit normal turned to the eye: reversed where a surface is seen from behind, mirrored at the
// plane across the view at an outline. Zero stays zero.
fn towards_eye(normal: vec3<f32>, from_eye: vec3<f32>) -> vec3<f32> {
    let away = dot(normal, from_eye);
    let distance2 = dot(from_eye, from_eye);
    if away <= 0.0 {
        return normal;
    }
    return select(-normal, normal - from_eye * (2.0 * away / distance2), away * away < distance2 * OUTLINE_COS2);
}

// The unit vector of a code; zero for NO_NORMAL.
fn normal_of(code: u32) -> vec3<f32> {
    if code == NO_NORMAL {
        return vec3<f32>(0.0);
    }
    let parts = vec2<i32>(bitcast<i32>(code << 16u) >> 16u, bitcast<i32>(code) >> 16u);
    let p = max(vec2<f32>(parts) / 32767.0, vec2<f32>(-1.0));
    let z = 1.0 - abs(p.x) - abs(p.y);
    let folded = 1.0 - abs(p.yx);
    let turned = select(-folded, folded, p >= vec2<f32>(0.0));
    let n = vec3<f32>(select(p, turned, z < 0.0), z);
    return n / sqrt(dot(n, n));
}
