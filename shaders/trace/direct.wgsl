// Adds one sample of what the eye sees of each pixel: direct light, and which guide its indirect
// light is looked up from, by similarity of normal and depth (`bauszat2011` 3.2, equations 3 to 5).
// Twins: crates/trace/src/paths/band.rs and lookup.rs.

// include common/direct.wgsl
// include common/places.wgsl
// include common/fits.wgsl
// include common/links.wgsl

// Whether this is the first sample, which is that of the guide.
override FIRST: bool;

@group(0) @binding(0) var<uniform> tree: Tree;
@group(0) @binding(1) var<storage, read> boxes: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> discs: array<vec4<f32>>;
@group(0) @binding(3) var<uniform> world: World;
@group(0) @binding(4) var<storage, read> places: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> lamps: array<Lamp>;
@group(0) @binding(6) var<storage, read> sky_pixels: array<vec4<f32>>;
// For all pixels of the part direct light and the number of samples that hit a surface; then
// indirect light that is not looked up and the number of its samples, as the bits of floats; then
// the albedo of the samples that look up each of the nine pixels around a pixel, two words each
// (common/links.wgsl), ten a pixel.
@group(0) @binding(7) var<storage, read_write> sums: array<vec4<u32>>;
// Low and high words of counts.
@group(0) @binding(8) var<storage, read_write> counts: array<atomic<u32>, 10>;

// Dimension of the numbers for places within a pixel.
const PIXEL_DIMENSION: u32 = 0u;
// Squared difference of normals, and share of the depth, up to which they are equal.
const NORMAL_ROUNDING: f32 = 1e-6;
const DEPTH_ROUNDING: f32 = 1e-5;
// Difference of similarities up to which guides are equally similar, and the first is taken.
const NEAR_TIE: f32 = 1e-4;
// The pixel itself among the nine around it.
const MIDDLE_SLOT: u32 = 4u;

// Slot of the most similar guide among the four pixel centres around a position; 9 if none fits.
fn most_similar(pixel: vec2<u32>, at: vec2<f32>, seen: Place) -> u32 {
    let middle = vec2<f32>(pixel) + 0.5;
    let beside = vec2<i32>(pixel) + select(vec2<i32>(1), vec2<i32>(-1), at < middle);
    let size = vec2<i32>(vec2<u32>(world.width, world.height));
    var is_valid: array<bool, 4>;
    var normals: array<f32, 4>;
    var depths: array<f32, 4>;
    var slots: array<u32, 4>;
    var most = vec2<f32>(0.0);
    for (var i = 0u; i < 4u; i++) {
        let is_beside = vec2<bool>((i & 1u) == 1u, i >= 2u);
        let other = select(vec2<i32>(pixel), beside, is_beside);
        if any(other < vec2<i32>(0)) || any(other >= size) {
            continue;
        }
        let guide = place_of(place_at(u32(other.x), u32(other.y)));
        if !receives(guide) {
            continue;
        }
        is_valid[i] = true;
        let turn = guide.normal - seen.normal;
        normals[i] = dot(turn, turn);
        depths[i] = abs(guide.depth - seen.depth);
        most = max(most, vec2<f32>(normals[i], depths[i]));
        let step = vec2<u32>(other + 1 - vec2<i32>(pixel));
        slots[i] = step.y * 3u + step.x;
    }
    var best = 9u;
    var similarity = -1.0;
    for (var i = 0u; i < 4u; i++) {
        // If all differences are rounding, all are similar.
        let normal = select(1.0, 1.0 - normals[i] / most.x, most.x > NORMAL_ROUNDING);
        let depth_rounding = DEPTH_ROUNDING * seen.depth;
        let depth = select(1.0, 1.0 - depths[i] / most.y, most.y > depth_rounding);
        if is_valid[i] && normal * depth > similarity + NEAR_TIE {
            similarity = normal * depth;
            best = slots[i];
        }
    }
    if best == 9u {
        return best;
    }
    let other = vec2<i32>(pixel) + vec2<i32>(vec2<u32>(best % 3u, best / 3u)) - 1;
    let guide = place_of(place_at(u32(other.x), u32(other.y)));
    return select(9u, best, fits(guide, seen, world.eye.w));
}

fn add_light(at: u32, light: vec4<f32>) {
    sums[at] = bitcast<vec4<u32>>(bitcast<vec4<f32>>(sums[at]) + light);
}

// Adds the albedo of a sample that looks up a pixel beside `pixel`.
fn add_link(pixel: u32, slot: u32, albedo: vec3<f32>) {
    let at = 2u * world.width * world.part.rows + 5u * pixel + slot / 2u;
    let pair = sums[at];
    if (slot & 1u) == 0u {
        sums[at] = vec4<u32>(with_albedo(pair.xy, albedo), pair.zw);
    } else {
        sums[at] = vec4<u32>(pair.xy, with_albedo(pair.zw, albedo));
    }
}

// Adds the sample of a pixel.
fn add_sample(id: vec3<u32>) {
    if id.x >= world.width || id.y >= world.part.rows {
        return;
    }
    let own = vec2<u32>(id.x, id.y + world.part.first);
    let pixel = id.y * world.width + id.x;
    let pixels = world.width * world.part.rows;
    let sample = sample_of(world.sequence, own.x, own.y, world.number);
    var at = vec2<f32>(own) + 0.5;
    var place = place_of(place_at(own.x, own.y));
    if !FIRST {
        at = vec2<f32>(own) + pair(sample, PIXEL_DIMENSION);
    }
    let ray = eye_ray(at);
    if !FIRST {
        if world.index == 1u {
            let albedo = select(vec3<f32>(0.0), place.colour, reflects(place));
            add_link(pixel, MIDDLE_SLOT, albedo);
        }
        place = see(ray);
    }
    if place.kind == NOTHING {
        if world.shows_sky == 1u {
            add_light(pixel, vec4<f32>(finite(sky(ray.direction)), 0.0));
        }
        return;
    }
    if place.kind == EMITS {
        add_light(pixel, vec4<f32>(place.colour, 1.0));
        return;
    }
    var light = vec3<f32>(0.0);
    if receives(place) {
        light = finite(place.colour * direct(place, sample));
    }
    add_light(pixel, vec4<f32>(light, 1.0));
    if FIRST || !receives(place) {
        return;
    }
    let slot = most_similar(own, at, place);
    if slot < 9u {
        add_link(pixel, slot, place.colour);
        return;
    }
    tally[WITHOUT_GUIDE]++;
    if world.bounces > 0u {
        add_light(pixels + pixel, vec4<f32>(place.colour * incident(place, sample), 1.0));
    }
}

@compute @workgroup_size(8, 8)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    add_sample(id);
    add_tally(lane);
}
