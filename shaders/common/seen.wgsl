// Directions of pixels from the eye, and the sizes that spheres and discs have there. Needs a
// variable `frame`. Twin: crates/render/src/passes/gather.rs.

// Share of the stretching of spheres away from the centre that radii follow.
const STRETCHED: f32 = 0.83;

// Direction from the eye to a place in the picture: right and up, over the depth.
fn seen_at(at: vec2<f32>) -> vec2<f32> {
    return vec2<f32>(at.x - frame.centre_px.x, frame.centre_px.y - at.y) * (1.0 / frame.focal_px);
}

// Major axis of a sphere's picture over that in the centre, away from which it is stretched.
fn of_sphere(seen: vec2<f32>) -> f32 {
    return sqrt(dot(seen, seen) + 1.0);
}

// Minor and major axis of a disc's picture over those of a disc in the centre that faces the eye.
fn of_disc(normal: vec3<f32>, seen: vec2<f32>) -> vec2<f32> {
    let k = dot(seen, normal.xy);
    let along = abs(normal.z - k);
    let across = sqrt(max(dot(seen, seen) * dot(normal.xy, normal.xy) - k * k + 1.0, 1.0));
    return vec2<f32>(along, max(along, across));
}
