// Along which directions the picture sees what is off its middle, and what that does to sizes. Twin: crates/render/src/passes/gather.rs.

// As in crates/render/src/passes/gather.rs.
const STRETCHED: f32 = 0.83;

// The direction of a place: to the right and upwards, over the depth.
fn seen_at(at: vec2<f32>) -> vec2<f32> {
    return vec2<f32>(at.x - frame.centre_px.x, frame.centre_px.y - at.y) * (1.0 / frame.focal_px);
}

// The greatest radius of a sphere's picture over that in the middle: it is stretched away from there.
fn of_sphere(seen: vec2<f32>) -> f32 {
    return sqrt(dot(seen, seen) + 1.0);
}

// Half the minor and the major axis of a disc's picture over those of one that is seen in the middle and faces the eye.
fn of_disc(normal: vec3<f32>, seen: vec2<f32>) -> vec2<f32> {
    let k = dot(seen, normal.xy);
    let along = abs(normal.z - k);
    let across = sqrt(max(dot(seen, seen) * dot(normal.xy, normal.xy) - k * k + 1.0, 1.0));
    return vec2<f32>(along, max(along, across));
}
