// How far a surface may reach beyond its samples. Needs variables `frame`, `front`, `tint`. Twin:
// crates/render/src/passes/silhouette/rim.rs, which has the measurements behind the constants.

// Whether pixels carry normals.
override NORMALS: bool;

// Over the radius, without normals and with, and in pixels at least.
const OVERHANG: vec2<f32> = vec2<f32>(0.35, 0.5);
const OVERHANG_MIN_PX: vec2<f32> = vec2<f32>(1.5, 1.2);
const LINE_OVERHANG_PX: f32 = 0.9;

// The eight directions, around.
fn direction(k: u32) -> vec2<i32> {
    let x = array<i32, 8>(1, 1, 0, -1, -1, -1, 0, 1);
    return vec2<i32>(x[k & 7u], x[(k + 6u) & 7u]);
}

// Length of a step in a direction, pixels.
fn stride(way: vec2<i32>) -> f32 {
    return select(1.0, 1.41421356, way.x != 0 && way.y != 0);
}

// Whether a pixel may stick out, of whatever it is a part.
fn may_stick_out(pixel: u32) -> bool {
    let displaced = front[pixel].zw;
    return dot(displaced, displaced) > LINE_OVERHANG_PX * LINE_OVERHANG_PX;
}

// Whether a pixel lies too far from the samples that it was interpolated from: at a line with this direction outwards
// (plus one), or where it is 0 at any surface.
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
