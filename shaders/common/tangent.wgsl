// Depth along the plane of a disc. Needs a variable `frame`. Twin:
// crates/render/src/passes/tangent.rs, which has the derivation.

// Steepest slope (depth over width) along which planes are followed.
const SLOPE_MAX: f32 = 32.0;
// Factor by which a move changes depth at most.
const FACTOR_MAX: f32 = 2.0;
// Least positive normal number.
const LEAST: f32 = 1.1754944e-38;

// Change of q over a move of `by` pixels, on a plane whose normal has the components `tilt` right
// and up.
fn turn_of(tilt: vec2<f32>, by: vec2<f32>) -> f32 {
    return tilt.x * by.x - tilt.y * by.y;
}

// Depth after a move over that before it, from q before the move and the change of q.
fn over_turn(q: f32, turn: f32) -> f32 {
    return q / clamp(q + turn, q * FACTOR_MAX, q * (1.0 / FACTOR_MAX));
}

// Relative change of the inverse depth a pixel right and down on the plane, at a place.
fn slope_of(normal: vec4<f32>, at: vec2<f32>) -> vec2<f32> {
    return vec2<f32>(normal.x, -normal.y) / facing(normal, at);
}

// Depth of a plate of unit thickness along the ray at a place; `normal` has unit length.
fn thickness(normal: vec4<f32>, at: vec2<f32>) -> f32 {
    return -frame.focal_px / facing(normal, at);
}

// q at a place, on a plane that is turned to the eye and no steeper than can be followed. Below
// zero.
fn facing(normal: vec4<f32>, at: vec2<f32>) -> f32 {
    let tilt = vec2<f32>(normal.x, -normal.y);
    let q = dot(tilt, at - frame.centre_px) - normal.z * frame.focal_px;
    let steepest = (abs(tilt.x) + abs(tilt.y)) * (frame.focal_px / SLOPE_MAX);
    return min(q, -steepest) - LEAST;
}
