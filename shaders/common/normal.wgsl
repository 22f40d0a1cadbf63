// Octahedral normals (meyer2010). Twin: crates/points/src/quant.rs.

// The code of a point without a normal.
const NO_NORMAL: u32 = 0x80008000u;

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
