// Direct light by shadow rays, and paths of indirect light. Twins: crates/trace/src/paths/direct.rs
// and indirect.rs.

// include common/world.wgsl
// include common/directions.wgsl
// include common/sky.wgsl
// include common/tally.wgsl

// Dimensions of the numbers for lights: one a light.
const LIGHT_DIMENSION: u32 = 16u;
// Share of the distance to a light at which shadow rays end.
const SHADOW_REACH: f32 = 0.9999;
const PI_SHARE: f32 = 0.31830987;
// First dimension of the numbers of bounces, and dimensions of each.
const BOUNCE_DIMENSION: u32 = 1024u;
// Bounces from which on paths end at random.
const ROULETTE_BOUNCE: u32 = 8u;
// Distance in lifts within which a ray may hit the surface that it left, and the cosine between
// stored normals above which it did.
const OWN_LIFTS: f32 = 4.0;
const OWN_COS: f32 = 0.5;
// The greatest number below 1.
const BELOW_ONE: f32 = 0.99999988;

// Light of a lamp at a place; none from behind it.
fn arrival_at(source: u32, place: Place, u: vec2<f32>) -> Arrival {
    let arrival = arrival_of(lamps[source], place.point, u, place.lift);
    if dot(arrival.direction, place.normal) > 0.0 {
        return arrival;
    }
    return nothing();
}

// What a white Lambert surface reflects of an arrival.
fn unshadowed(place: Place, arrival: Arrival) -> vec3<f32> {
    return arrival.irradiance * (dot(arrival.direction, place.normal) * PI_SHARE);
}

fn is_visible(place: Place, arrival: Arrival) -> bool {
    tally[SHADOW_RAYS]++;
    let start = start_of(place);
    if is_infinite(arrival.distance) {
        return !is_blocked(Ray(start, infinity(), arrival.direction));
    }
    let towards = place.point + arrival.direction * arrival.distance - start;
    let reach = length(towards) * SHADOW_REACH;
    return !is_blocked(Ray(start, reach, unit_or(towards, arrival.direction)));
}

// Light from all lamps at a place that the eye sees.
fn direct(place: Place, sample: Sample) -> vec3<f32> {
    var sum = vec3<f32>(0.0);
    for (var source = 0u; source < world.lamps; source++) {
        let soft = is_soft(lamps[source]);
        let log2 = select(0u, world.shadow_log2, soft);
        for (var i = 0u; i < (1u << log2); i++) {
            var u = vec2<f32>(0.5);
            if soft {
                u = part(sample, LIGHT_DIMENSION + source, i, log2);
            }
            let arrival = arrival_at(source, place, u);
            if any(arrival.direction != vec3<f32>(0.0)) && is_visible(place, arrival) {
                sum += unshadowed(place, arrival) / f32(1u << log2);
            }
        }
    }
    return sum;
}

// Radiance that a place reflects, by a ray to one lamp, chosen in proportion to what each would add
// without shadow.
fn reflected_of_one(place: Place, sample: Sample, dimension: u32) -> vec3<f32> {
    var choice = 0.0;
    if world.lamps > 1u {
        choice = pair(sample, dimension).x;
    }
    var total = 0.0;
    var weight = 0.0;
    var chosen = nothing();
    var radiance = vec3<f32>(0.0);
    for (var source = 0u; source < world.lamps; source++) {
        var u = vec2<f32>(0.5);
        if is_soft(lamps[source]) {
            u = pair(sample, dimension + 1u + source);
        }
        let arrival = arrival_at(source, place, u);
        let own = place.colour * unshadowed(place, arrival);
        let own_weight = own.x + own.y + own.z;
        if !(own_weight > 0.0) {
            continue;
        }
        total += own_weight;
        let share = own_weight / total;
        if choice < share || weight == 0.0 {
            choice = min(choice / share, BELOW_ONE);
            chosen = arrival;
            radiance = own;
            weight = own_weight;
        } else {
            choice = (choice - share) / (1.0 - share);
        }
    }
    if weight > 0.0 && is_visible(place, chosen) {
        return radiance * (total / weight);
    }
    return vec3<f32>(0.0);
}

// Incident indirect light at a place by one path: mean radiance weighted by the cosine.
fn incident(start: Place, sample: Sample) -> vec3<f32> {
    var sum = vec3<f32>(0.0);
    var throughput = vec3<f32>(1.0);
    var place = start;
    var stored = select(start.normal, -start.normal, start.kind == REFLECTS_BACK);
    var direction = cosine_direction(place.normal, pair(sample, BOUNCE_DIMENSION));
    for (var bounce = 1u; bounce <= world.bounces; bounce++) {
        let dimension = BOUNCE_DIMENSION * (bounce + 1u);
        let ray = Ray(start_of(place), infinity(), direction);
        tally[BOUNCE_RAYS]++;
        let surface = blended(ray);
        if is_infinite(surface.distance) {
            tally[ESCAPED]++;
            sum += throughput * sky(direction);
            break;
        }
        let is_near = surface.distance < place.lift * OWN_LIFTS;
        if is_near && dot(faced, stored) > OWN_COS {
            tally[SELF_HITS]++;
        }
        stored = faced;
        place.point = ray.origin + direction * surface.distance;
        place.lift = surface.lift;
        place.normal = surface.normal;
        place.colour = surface.albedo;
        sum += throughput * reflected_of_one(place, sample, dimension + 2u);
        if bounce == world.bounces {
            break;
        }
        throughput *= place.colour;
        direction = cosine_direction(place.normal, pair(sample, dimension));
        if bounce >= ROULETTE_BOUNCE {
            let survival = min(max(max(throughput.x, throughput.y), throughput.z), 1.0);
            if pair(sample, dimension + 1u).y >= survival {
                break;
            }
            throughput /= survival;
        }
    }
    return finite(sum);
}
