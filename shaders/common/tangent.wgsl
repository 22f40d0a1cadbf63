// Depth along a disc's plane. Needs a variable `frame`. Twin: crates/render/src/passes/tangent.rs, which says how.

// Steepest slope (depth over width) that planes are followed with.
const SLOPE_MAX: f32 = 32.0;
// Depths change by at most this factor in one move.
const FACTOR_MAX: f32 = 2.0;
const LEAST: f32 = 1.1754944e-38;

// What q changes by over so many pixels, where normals have these parts right and up.
fn turn_of(tilt: vec2<f32>, by: vec2<f32>) -> f32 {
    return tilt.x * by.x - tilt.y * by.y;
}

// Depth after a move over that before it, from q before it and what the move changes it by.
fn over_turn(q: f32, turn: f32) -> f32 {
    return q / clamp(q + turn, q * FACTOR_MAX, q * (1.0 / FACTOR_MAX));
}

// What one over the depth changes by, over itself at a place, a pixel right and down on the plane.
fn slope_of(normal: vec4<f32>, at: vec2<f32>) -> vec2<f32> {
    return vec2<f32>(normal.x, -normal.y) / facing(normal, at);
}

// Depth that a plate of unit thickness takes along the rays at a place; `normal` has unit length.
fn thickness(normal: vec4<f32>, at: vec2<f32>) -> f32 {
    return -frame.focal_px / facing(normal, at);
}

// Of planes turned to the eye, not steeper than can be followed. Below zero.
fn facing(normal: vec4<f32>, at: vec2<f32>) -> f32 {
    let tilt = vec2<f32>(normal.x, -normal.y);
    let q = dot(tilt, at - frame.centre_px) - normal.z * frame.focal_px;
    let steepest = (abs(tilt.x) + abs(tilt.y)) * (frame.focal_px / SLOPE_MAX);
    return min(q, -steepest) - LEAST;
}
