// Lights that are sampled. Twin: crates/trace/src/light/lamp.rs.

struct Lamp {
    // Position, or corner; and the kind.
    place: vec4<f32>,
    // Direction of the sun, axis of a spot, normal of an area; and the tangent of the sun's radius,
    // the cosine of a spot's inner angle, or the area.
    axis: vec4<f32>,
    // First vector across the sun, or first edge; and the cosine of a spot's outer angle, or 1 for
    // an area with two sides.
    x: vec4<f32>,
    // Second vector across the sun, or second edge.
    y: vec4<f32>,
    // Irradiance, intensity or radiance.
    colour: vec4<f32>,
}

const SUN: f32 = 0.0;
const POINT: f32 = 1.0;
const SPOT: f32 = 2.0;
const AREA: f32 = 3.0;

const TURN: f32 = 6.2831855;

struct Arrival {
    // Unit length; zero if nothing arrives.
    direction: vec3<f32>,
    // Distance to the light; infinite for the sun.
    distance: f32,
    // Irradiance of a surface that faces the light.
    irradiance: vec3<f32>,
}

fn nothing() -> Arrival {
    return Arrival(vec3<f32>(0.0), 0.0, vec3<f32>(0.0));
}

fn smooth_step(low: f32, high: f32, x: f32) -> f32 {
    if x >= high {
        return 1.0;
    }
    let t = max((x - low) / (high - low), 0.0);
    return t * t * (3.0 - 2.0 * t);
}

// Whether a lamp has an extent.
fn is_soft(lamp: Lamp) -> bool {
    return lamp.place.w == AREA || (lamp.place.w == SUN && lamp.axis.w > 0.0);
}

// Light that arrives at `at` by two numbers in [0, 1). `least` bounds the distance from below.
fn arrival_of(lamp: Lamp, at: vec3<f32>, u: vec2<f32>, least: f32) -> Arrival {
    if lamp.place.w == SUN {
        var direction = lamp.axis.xyz;
        if lamp.axis.w > 0.0 {
            let radius = lamp.axis.w * sqrt(u.x);
            let angle = TURN * u.y;
            let off = lamp.x.xyz * cos(angle) + lamp.y.xyz * sin(angle);
            direction = unit_or(direction + off * radius, direction);
        }
        return Arrival(direction, infinity(), lamp.colour.xyz);
    }
    var towards = lamp.place.xyz - at;
    if lamp.place.w == AREA {
        towards += lamp.x.xyz * u.x + lamp.y.xyz * u.y;
    }
    let direction = unit_or(towards, vec3<f32>(0.0));
    if all(direction == vec3<f32>(0.0)) {
        return nothing();
    }
    let distance = length(towards);
    var share = 1.0;
    if lamp.place.w == SPOT {
        share = smooth_step(lamp.x.w, lamp.axis.w, -dot(direction, lamp.axis.xyz));
    }
    if lamp.place.w == AREA {
        let cosine = -dot(direction, lamp.axis.xyz);
        share = lamp.axis.w * select(cosine, abs(cosine), lamp.x.w == 1.0);
    }
    if share <= 0.0 {
        return nothing();
    }
    let squared = max(distance * distance, least * least);
    return Arrival(direction, distance, lamp.colour.xyz * (share / squared));
}

// Distance at which a ray meets an area light; infinite if it does not, or if the lamp is none.
fn meet_lamp(lamp: Lamp, origin: vec3<f32>, direction: vec3<f32>) -> f32 {
    let cosine = dot(direction, lamp.axis.xyz);
    if lamp.place.w != AREA || cosine == 0.0 || (cosine > 0.0 && lamp.x.w != 1.0) {
        return infinity();
    }
    let distance = dot(lamp.place.xyz - origin, lamp.axis.xyz) / cosine;
    let offset = origin + direction * distance - lamp.place.xyz;
    // Coordinates along both edges, by Cramer's rule on their Gram matrix.
    let aa = dot(lamp.x.xyz, lamp.x.xyz);
    let ab = dot(lamp.x.xyz, lamp.y.xyz);
    let bb = dot(lamp.y.xyz, lamp.y.xyz);
    let pa = dot(offset, lamp.x.xyz);
    let pb = dot(offset, lamp.y.xyz);
    let uv = vec2<f32>(pa * bb - pb * ab, pb * aa - pa * ab) / (aa * bb - ab * ab);
    let is_inside = all(uv >= vec2<f32>(0.0)) && all(uv <= vec2<f32>(1.0));
    return select(infinity(), distance, distance > 0.0 && is_inside);
}
