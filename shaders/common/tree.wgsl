// Traversal of the implicit tree of discs: in the order of a space-filling curve eight discs make a
// leaf, and eight leaves or nodes a node, so that no child is stored. Twin: crates/trace/src/accel.
// The shader that includes this declares `tree`, `boxes` (of the children of each node the least
// x of all eight, then y and z, then the greatest, two `vec4<f32>` each) and `discs`.

// include common/discs.wgsl
// include common/infinite.wgsl

struct Tree {
    // Number of discs.
    discs: u32,
    // Levels of nodes; the last has one node, the first holds leaves. 0 without discs.
    levels: u32,
    // 1 if rays from the eye pass through discs whose normal points away from it.
    culls: u32,
    unused: u32,
    // First node of each level.
    first: array<vec4<u32>, 3>,
}

// Children of a node, and discs of a leaf.
const WIDTH: u32 = 8u;
// Entries of the stack. Each level leaves seven at most.
const STACK: u32 = 64u;
// The level of an entry of the stack, above its index.
const LEVEL_SHIFT: u32 = 28u;
// Share by which boxes are widened against rounding.
const WIDENED: f32 = 1e-5;
// Least size of a component of the direction, so that its reciprocal is finite.
const DIRECTION_MIN: f32 = 1e-20;

// What a traversal looks for: the frontmost disc and the end of its blend, the blend, anything, or
// the nearest disc that faces a surface.
const FRONT: u32 = 0u;
const BLEND: u32 = 1u;
const ANY: u32 = 2u;
const FACING: u32 = 3u;

// Depth of a blend, and distance at which rays leave the surface, in radii.
const DEPTH: f32 = 2.0;
// Least weight of a disc: at the very rim it can round to zero.
const WEIGHT_MIN: f32 = 1.1920929e-7;
// Cosine between normals below which two surfaces face each other.
const FACING_COSINE: f32 = -0.3;
// Distance in radii from which on a facing surface counts, and share of the distance to it at which
// rays start.
const FACING_FROM: f32 = 0.5;
const FACING_SHARE: f32 = 0.5;

// A surface that a ray meets.
struct Surface {
    // Distance of the frontmost disc; infinite if there is none.
    distance: f32,
    // Radius of the frontmost disc.
    radius: f32,
    // Distance along the normal at which rays that leave the surface start.
    lift: f32,
    // Unit normal against the ray.
    normal: vec3<f32>,
    albedo: vec3<f32>,
}

var<private> aim: u32;
// Whether discs whose normal points away from the origin of the ray are not met.
var<private> skips_backs: bool;
// Discs from here on are not met.
var<private> limit: f32;
var<private> front: u32;
var<private> front_at: f32;
// Sums over the discs of the blend.
var<private> normals: vec3<f32>;
var<private> albedos: vec3<f32>;
var<private> weights: f32;
// Normal of the last surface, on the side to which the stored normal of its frontmost disc points.
// Discs that face it bound the lift.
var<private> faced: vec3<f32>;

fn visit(disc: u32, ray: Ray) {
    let met = meet(disc, ray);
    if met.y <= 0.0 {
        return;
    }
    let own = stored_normal(disc);
    if skips_backs && dot(own, ray.direction) > 0.0 {
        return;
    }
    if aim == BLEND {
        // The frontmost disc counts even if its blend ends with it.
        if met.x <= limit || disc == front {
            let weight = max(met.y, WEIGHT_MIN);
            normals += select(own, -own, dot(own, ray.direction) > 0.0) * weight;
            albedos += albedo_of(disc) * weight;
            weights += weight;
        }
        return;
    }
    if met.x >= limit {
        return;
    }
    if aim == FACING {
        if dot(own, faced) < FACING_COSINE {
            limit = met.x;
        }
        return;
    }
    if aim == ANY {
        front = disc;
        limit = -1.0;
        return;
    }
    if met.x < front_at {
        front = disc;
        front_at = met.x;
    }
    // Discs within two radii behind one of the blend belong to it.
    limit = min(limit, met.x + DEPTH * discs[2u * disc].w);
}

var<private> stack: array<vec2<u32>, 64>;
var<private> height: u32;

// Puts an entry on the stack, above those from `start` on that are farther.
fn push(entry: u32, near: f32, start: u32) {
    var at = height;
    height++;
    while at > start {
        let below = stack[at - 1u];
        if bitcast<f32>(below.y) >= near {
            break;
        }
        stack[at] = below;
        at--;
    }
    stack[at] = vec2<u32>(entry, bitcast<u32>(near));
}

// Pushes the children of a node that the ray meets, the nearest last.
fn open(level: u32, node: u32, ray: Ray, inverse: vec3<f32>) {
    let start = height;
    let base = (tree.first[(level - 1u) / 4u][(level - 1u) % 4u] + node) * 12u;
    for (var half = 0u; half < 2u; half++) {
        let at = base + half;
        let low_x = (boxes[at] - ray.origin.x) * inverse.x;
        let low_y = (boxes[at + 2u] - ray.origin.y) * inverse.y;
        let low_z = (boxes[at + 4u] - ray.origin.z) * inverse.z;
        let high_x = (boxes[at + 6u] - ray.origin.x) * inverse.x;
        let high_y = (boxes[at + 8u] - ray.origin.y) * inverse.y;
        let high_z = (boxes[at + 10u] - ray.origin.z) * inverse.z;
        let entry_xy = max(min(low_x, high_x), min(low_y, high_y));
        let entry = max(max(entry_xy, min(low_z, high_z)), vec4<f32>(0.0));
        let exit = min(min(max(low_x, high_x), max(low_y, high_y)), max(low_z, high_z));
        for (var k = 0u; k < 4u; k++) {
            let near = entry[k] * (1.0 - WIDENED);
            if near <= exit[k] * (1.0 + WIDENED) && near <= limit {
                let child = node * WIDTH + half * 4u + k;
                push(child | ((level - 1u) << LEVEL_SHIFT), near, start);
            }
        }
    }
}

fn walk(ray: Ray) {
    if tree.levels == 0u {
        return;
    }
    let size = max(abs(ray.direction), vec3<f32>(DIRECTION_MIN));
    let inverse = select(1.0 / size, -1.0 / size, ray.direction < vec3<f32>(0.0));
    height = 0u;
    push(tree.levels << LEVEL_SHIFT, 0.0, 0u);
    while height > 0u {
        height--;
        let entry = stack[height];
        if bitcast<f32>(entry.y) > limit {
            continue;
        }
        let level = entry.x >> LEVEL_SHIFT;
        let index = entry.x & ((1u << LEVEL_SHIFT) - 1u);
        if level > 0u {
            open(level, index, ray, inverse);
        } else {
            let end = min((index + 1u) * WIDTH, tree.discs);
            for (var disc = index * WIDTH; disc < end; disc++) {
                visit(disc, ray);
            }
        }
    }
}

// The surface that a ray meets first: all discs blended within two radii behind the frontmost. The
// tree is walked twice, so that no list of discs is needed.
fn blended(ray: Ray) -> Surface {
    aim = FRONT;
    limit = ray.reach;
    front_at = infinity();
    walk(ray);
    var surface: Surface;
    surface.distance = front_at;
    if is_infinite(front_at) {
        return surface;
    }
    aim = BLEND;
    normals = vec3<f32>(0.0);
    albedos = vec3<f32>(0.0);
    weights = 0.0;
    walk(ray);
    surface.radius = discs[2u * front].w;
    let size = dot(normals, normals);
    surface.normal = select(-ray.direction, normals / sqrt(size), size > 0.0);
    surface.albedo = albedos / weights;
    skips_backs = false;
    surface.lift = lift_of(ray, surface);
    return surface;
}

// The surface that a ray from the eye meets first.
fn blended_from_eye(ray: Ray) -> Surface {
    skips_backs = tree.culls == 1u;
    let surface = blended(ray);
    skips_backs = false;
    return surface;
}

// Distance at which rays leave a surface: at most half the way to one that faces it, so that they
// do not start beyond a thin wall.
fn lift_of(ray: Ray, surface: Surface) -> f32 {
    let lift = DEPTH * surface.radius;
    let least = FACING_FROM * surface.radius;
    let is_back = dot(stored_normal(front), ray.direction) > 0.0;
    let start = ray.origin + ray.direction * surface.distance + surface.normal * least;
    faced = select(surface.normal, -surface.normal, is_back);
    aim = FACING;
    limit = lift - least;
    walk(Ray(start, limit, surface.normal));
    if limit < lift - least {
        return FACING_SHARE * (least + limit);
    }
    return lift;
}

// Whether anything lies on the ray before its reach.
fn is_blocked(ray: Ray) -> bool {
    aim = ANY;
    limit = ray.reach;
    walk(ray);
    return limit < 0.0;
}
