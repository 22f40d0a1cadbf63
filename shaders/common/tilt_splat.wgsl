// Tilts splats of points without normals as the planes that fit_planes has fitted. Needs a variable
// `frame`, common/squares.wgsl and a function `plane_at`. Twins:
// crates/render/src/passes/fit_planes.rs and crates/render/src/ewa/splat.rs.

// Constants of fit_planes.rs.
const SIDE_MIN: f32 = 1.5;
const SIDE_MIN_PX: f32 = 8.0;
const LEVELS_MAX: u32 = 2u;
const OFF_PLANE_MAX: f32 = 3.0;
const STEEP: f32 = 4.0;
// Width of splats on fitted planes across the slope (splat.rs).
const ACROSS_SLOPE: f32 = 1.5;
// Steepest slope that is followed (tangent.rs).
const SLOPE_MAX: f32 = 32.0;

// Relative growth of depth a pixel right and down on the plane of a splat at `p`; zeros if it has
// none.
fn growth_of(p: vec3<f32>, radius: f32) -> vec2<f32> {
    let scale = frame.focal_px / p.z;
    let place = placed(p.xy * scale);
    let least = max(radius * scale * SIDE_MIN, SIDE_MIN_PX);
    var first = 0u;
    var looked = 0u;
    for (var level = 0u; level < LEVELS; level += 1u) {
        let side = f32(SQUARE_PX << level);
        let count = squares_in(level);
        if side >= least && looked < LEVELS_MAX {
            looked += 1u;
            // Squares at the border have few neighbours: the planes beside them are taken.
            let last = vec2<f32>(max(count, vec2<u32>(2u)) - 2u);
            let square = min(floor(max(place / side, vec2<f32>(1.0))), last);
            let plane = plane_at(first + u32(square.y) * count.x + u32(square.x));
            let off = place - (square + 0.5) * side;
            let nearer = 1.0 - dot(plane.xy, off);
            let here = plane.w * nearer;
            let growth = plane.xy / nearer;
            let slope = (abs(growth.x) + abs(growth.y)) * frame.focal_px;
            let is_on = abs(here * p.z - 1.0) * p.z <= radius * OFF_PLANE_MAX;
            if here > 0.0 && is_on && (looked == 1u || slope >= STEEP) {
                return growth / max(slope / SLOPE_MAX, 1.0);
            }
        }
        first += count.x * count.y;
    }
    return vec2<f32>(0.0);
}

// Normal of the disc of a splat on a fitted plane; zeros without one.
fn widened_normal(p: vec3<f32>, growth: vec2<f32>) -> vec3<f32> {
    let seen = p.xy / p.z;
    let slope = growth * frame.focal_px;
    let plane = normalize(vec3<f32>(slope, -(dot(slope, seen) + 1.0)));
    let to_eye = -normalize(vec3<f32>(seen, 1.0));
    let cosine = dot(plane, to_eye);
    let wide = min(abs(cosine) * ACROSS_SLOPE, 1.0);
    let sine = sqrt(max(1.0 - cosine * cosine, 0.0));
    if all(slope == vec2<f32>(0.0)) || sine <= 0.0 {
        return vec3<f32>(0.0);
    }
    let share = sqrt(max(1.0 - wide * wide, 0.0)) / sine;
    return (plane - to_eye * cosine) * share + to_eye * wide;
}
