// The view, the lights, and how paths are followed; and places on surfaces. The shader that
// includes this declares `world`, `tree`, `boxes`, `discs` and `lamps`. Twins:
// crates/trace/src/camera.rs and crates/trace/src/paths/surface.rs.

// include common/tree.wgsl
// include common/unit.wgsl
// include common/lamps.wgsl
// include common/sequence.wgsl
// include common/place_seen.wgsl

struct World {
    // Eye, and pixels of a unit of length at unit eye depth.
    eye: vec4<f32>,
    // Right, and the depth of the near plane.
    right: vec4<f32>,
    // Up; and the depth at which lengths have their size on the picture if rays are parallel, else
    // 0.
    up: vec4<f32>,
    forward: vec4<f32>,
    // Sky straight up, at the horizon, and straight down.
    zenith: vec4<f32>,
    horizon: vec4<f32>,
    ground: vec4<f32>,
    width: u32,
    height: u32,
    lamps: u32,
    bounces: u32,
    // Binary logarithm of the number of shadow rays to a light of some extent.
    shadow_log2: u32,
    shows_sky: u32,
    // Number of the sample in its batch, and of all before it.
    number: u32,
    index: u32,
    sequence: Sequence,
    part: Part,
    // Width and height of the image of the sky, pixels; zeros without one.
    sky_width: u32,
    sky_height: u32,
    unused: u32,
    unused_2: u32,
}

// Rows of the picture that a dispatch goes over, and those whose places are in memory.
struct Part {
    first: u32,
    rows: u32,
    first_place: u32,
    place_rows: u32,
}

// Index in `places` of a pixel, by its column and row.
fn place_at(x: u32, y: u32) -> u32 {
    return (y - world.part.first_place) * world.width + x;
}

fn start_of(place: Place) -> vec3<f32> {
    return place.point + place.normal * place.lift;
}

// Ray through a position of the picture, from the near plane on.
fn eye_ray(at: vec2<f32>) -> Ray {
    let x = (at.x - f32(world.width) * 0.5) / world.eye.w;
    let y = (f32(world.height) * 0.5 - at.y) / world.eye.w;
    let beside = world.right.xyz * x + world.up.xyz * y;
    if world.up.w > 0.0 {
        let start = world.eye.xyz + beside * world.up.w + world.forward.xyz * world.right.w;
        return Ray(start, infinity(), world.forward.xyz);
    }
    let towards = world.forward.xyz + beside;
    let direction = unit_or(towards, world.forward.xyz);
    return Ray(world.eye.xyz + towards * world.right.w, infinity(), direction);
}

// What a ray from the eye sees.
fn see(ray: Ray) -> Place {
    var place: Place;
    place.depth = infinity();
    let surface = blended_from_eye(ray);
    var nearest = surface.distance;
    if !is_infinite(nearest) {
        place.point = ray.origin + ray.direction * nearest;
        place.lift = surface.lift;
        place.normal = surface.normal;
        place.colour = surface.albedo;
        let is_back = dot(faced, surface.normal) < 0.0;
        place.kind = select(REFLECTS, REFLECTS_BACK, is_back);
    }
    for (var i = 0u; i < world.lamps; i++) {
        let at = meet_lamp(lamps[i], ray.origin, ray.direction);
        if at < nearest {
            nearest = at;
            place.point = ray.origin + ray.direction * at;
            place.lift = 0.0;
            place.normal = -ray.direction;
            place.colour = lamps[i].colour.xyz;
            place.kind = EMITS;
        }
    }
    let depth = dot(place.point - world.eye.xyz, world.forward.xyz);
    if place.kind != NOTHING && !is_infinite(depth) {
        place.depth = depth;
    } else {
        place.kind = NOTHING;
    }
    return place;
}

fn finite(light: vec3<f32>) -> vec3<f32> {
    let is_lost = is_infinite(light.x) || is_infinite(light.y) || is_infinite(light.z);
    return select(light, vec3<f32>(0.0), is_lost);
}
