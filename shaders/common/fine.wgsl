// Which splats a ray can meet. Needs common/infinite.wgsl. Twin: `is_fine` in
// crates/trace/src/scene/splats.rs.

// Radius of a disc over the drawn radius of its splat.
const RADIUS_FACTOR: f32 = 1.4;
// Greatest coordinate and radius.
const COORDINATE_MAX: f32 = 1e15;

// Whether a ray can meet a splat with this place, radius of its disc, and colour.
fn is_fine(centre: vec3<f32>, radius: f32, colour: vec3<f32>) -> bool {
    let is_near = all(abs(centre) <= vec3<f32>(COORDINATE_MAX));
    let has_extent = radius > 0.0 && radius <= COORDINATE_MAX;
    return is_near && has_extent && is_number(colour.x + colour.y + colour.z);
}
