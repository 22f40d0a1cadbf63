// Steps of the depth image. Needs variables `frame` and `depth`. Twin:
// crates/render/src/picture/edges.rs.

// Slope (depth over width) above which neighbouring pixels show two surfaces.
const STEP_PX: f32 = 2.0;

// Whether two depths of neighbouring pixels make a step.
fn is_step(a: f32, b: f32) -> bool {
    if is_infinite(a) || is_infinite(b) {
        return is_infinite(a) != is_infinite(b);
    }
    return abs(a - b) > STEP_PX / frame.focal_px * min(a, b);
}

// Whether a pixel is beside a step.
fn is_edge(at: vec2<u32>, pixel: u32) -> bool {
    let here = depth[pixel];
    return (at.x > 0u && is_step(here, depth[pixel - 1u]))
        || (at.x + 1u < frame.width && is_step(here, depth[pixel + 1u]))
        || (at.y > 0u && is_step(here, depth[pixel - frame.width]))
        || (at.y + 1u < frame.height && is_step(here, depth[pixel + frame.width]));
}
