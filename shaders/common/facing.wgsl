// Normals that are turned to the eye. Needs a variable `frame`. Twin:
// crates/render/src/simd/values.rs.

// A normal that looks away is taken for one at the outline of a surface if the square of the cosine
// of its angle with the direction from the eye is less.
const OUTLINE_COS2: f32 = 0.125;

// A unit normal turned to the eye: reversed where a surface is seen from behind, mirrored at the
// plane across the view at an outline, if normals have fronts. Zero stays zero.
fn towards_eye(normal: vec3<f32>, from_eye: vec3<f32>) -> vec3<f32> {
    let away = dot(normal, from_eye);
    let distance2 = dot(from_eye, from_eye);
    if away <= 0.0 {
        return normal;
    }
    let is_at_outline = frame.has_fronts == 1u && away * away < distance2 * OUTLINE_COS2;
    return select(-normal, normal - from_eye * (2.0 * away / distance2), is_at_outline);
}
