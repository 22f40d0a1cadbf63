// Vectors of unit length. Needs common/infinite.wgsl.

// Whether a vector can be scaled to unit length.
fn has_direction(v: vec3<f32>) -> bool {
    let share = 1.0 / length(v);
    return share > 0.0 && !is_infinite(share);
}

// The vector scaled to unit length, or `otherwise` if that is impossible.
fn unit_or(v: vec3<f32>, otherwise: vec3<f32>) -> vec3<f32> {
    if !has_direction(v) {
        return otherwise;
    }
    return v * (1.0 / length(v));
}
