// Places that rays from the eye see, and that paths meet.

// What a place shows: nothing, a surface that reflects, a light, or a surface whose stored normal
// points away from the ray.
const NOTHING: f32 = 0.0;
const REFLECTS: f32 = 1.0;
const EMITS: f32 = 2.0;
const REFLECTS_BACK: f32 = 3.0;

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

// Whether a place is on a surface.
fn reflects(place: Place) -> bool {
    return place.kind == REFLECTS || place.kind == REFLECTS_BACK;
}

// Whether a place reflects light.
fn receives(place: Place) -> bool {
    return reflects(place) && any(place.colour != vec3<f32>(0.0));
}
