// How far a surface may reach beyond its samples, for silhouette. Needs variables `frame`, `front`
// and `tint`. Twin: crates/render/src/passes/silhouette/rim.rs, which explains the constants.

// Whether pixels carry normals.
override NORMALS: bool;

// Reach in radii, without normals and with, and in pixels at least.
const OVERHANG: vec2<f32> = vec2<f32>(0.35, 0.5);
const OVERHANG_MIN_PX: vec2<f32> = vec2<f32>(1.5, 1.2);
const LINE_OVERHANG_PX: f32 = 0.9;

// The direction `k` of eight, in their order around a pixel.
fn direction(k: u32) -> vec2<i32> {
    let x = array<i32, 8>(1, 1, 0, -1, -1, -1, 0, 1);
    return vec2<i32>(x[k & 7u], x[(k + 6u) & 7u]);
}

// Length of a step in a direction, pixels.
fn stride(way: vec2<i32>) -> f32 {
    return select(1.0, 1.41421356, way.x != 0 && way.y != 0);
}

// Whether a pixel may stick out, of a surface or a line.
fn may_stick_out(pixel: u32) -> bool {
    let displaced = front[pixel].zw;
    return dot(displaced, displaced) > LINE_OVERHANG_PX * LINE_OVERHANG_PX;
}

// Whether a pixel is too far from the samples that it was interpolated from: across a line whose
// outward direction, plus one, is `line`, or in any direction from a surface if `line` is 0.
fn sticks_out(pixel: u32, line: u32) -> bool {
    if line > 0u {
        let way = direction(line - 1u);
        let along = vec2<f32>(way) * (1.0 / stride(way));
        return front[pixel].z * along.x + front[pixel].w * along.y > LINE_OVERHANG_PX;
    }
    let share = select(OVERHANG.x, OVERHANG.y, NORMALS);
    let least = select(OVERHANG_MIN_PX.x, OVERHANG_MIN_PX.y, NORMALS);
    let reach = max(tint[pixel].w * share, least);
    let displaced = front[pixel].zw;
    return dot(displaced, displaced) > reach * reach;
}
