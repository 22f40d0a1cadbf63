// How far a surface may reach beyond its samples. Needs variables `frame`, `front`, `tint`. Twin:
// crates/render/src/trim.rs, which has the measurements behind the constants.

// Whether pixels carry normals.
override NORMALS: bool;

// Over the radius, without normals and with, and in pixels at least.
const OVERHANG: vec2<f32> = vec2<f32>(0.35, 0.5);
const OVERHANG_MIN_PX: f32 = 1.5;

// Whether a pixel lies too far from the samples that it was interpolated from.
fn overhangs(pixel: u32) -> bool {
    let share = select(OVERHANG.x, OVERHANG.y, NORMALS);
    let reach = max(tint[pixel].w * share, OVERHANG_MIN_PX);
    let displaced = front[pixel].zw;
    return dot(displaced, displaced) > reach * reach;
}

// Depth beyond which there is another surface than that of a pixel at `depth` which shows `shown`.
fn limit(depth: f32, shown: u32) -> f32 {
    return depth * (1.0 + tint[shown].w * (1.0 / frame.focal_px));
}
