// Places that rays from the eye see, and that paths meet.

// What a place shows: nothing, a surface that reflects, or a light.
const NOTHING: f32 = 0.0;
const REFLECTS: f32 = 1.0;
const EMITS: f32 = 2.0;

// A place that a ray from the eye sees, or that a path meets.
struct Place {
    point: vec3<f32>,
    // Distance along the normal at which rays that leave the surface start.
    lift: f32,
    normal: vec3<f32>,
    // Eye depth; infinite if nothing is seen.
    depth: f32,
    // Albedo, or radiance of a light.
    colour: vec3<f32>,
    kind: f32,
}

// Whether a place reflects light.
fn receives(place: Place) -> bool {
    return place.kind == REFLECTS && any(place.colour != vec3<f32>(0.0));
}
