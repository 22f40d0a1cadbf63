// Fits a plane to the nearest point of each square and those of the squares around it. Twin:
// crates/render/src/passes/fit_planes.rs, which explains the method and the constants.

// include common/frame.wgsl
// include common/squares.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
// Nearest points (fit_planes/nearest.wgsl).
@group(0) @binding(1) var<storage, read> nears: array<vec2<u32>>;
// Relative growth of depth a pixel right and down, the reach of depth intervals, and the inverse
// depth in the middle of the square, or zero without a plane.
@group(0) @binding(2) var<storage, read_write> planes: array<vec4<f32>>;

// Reach without a plane; and distance from a plane up to which a neighbour counts, in squares.
const BARE_REACH: f32 = 2.0;
const OFF_MAX: f32 = 1.0;
// Reach of a trusted plane, then the mean distances above which a plane is trusted less, and not at
// all.
const TRUST_APART: vec3<f32> = vec3<f32>(0.8, 0.2, 0.4);
const TRUST_CROWDED: vec3<f32> = vec3<f32>(BARE_REACH, 0.18, 0.35);
const MISSING_MAX: f32 = 1.0;
const AREA_MIN: f32 = 0.2;
const BETTER: f32 = 1e-3;
const NEARER_MAX: f32 = 1e6;
const NEARER_MIN: f32 = 0.1;
const LEAST_SUM: f32 = 1.1754944e-38;

// From the own point to those of the neighbours: pixels, and the relative growth of the inverse
// depth.
var<private> around: array<vec3<f32>, 8>;
var<private> is_there: array<bool, 8>;

// Offset to a neighbour, in squares.
fn neighbour(k: u32) -> vec2<i32> {
    switch k {
        case 0u: { return vec2<i32>(1, 0); }
        case 1u: { return vec2<i32>(0, 1); }
        case 2u: { return vec2<i32>(-1, 0); }
        case 3u: { return vec2<i32>(0, -1); }
        case 4u: { return vec2<i32>(1, 1); }
        case 5u: { return vec2<i32>(-1, 1); }
        case 6u: { return vec2<i32>(-1, -1); }
        default: { return vec2<i32>(1, -1); }
    }
}

// Pixel of a nearest point.
fn pixel_of(near: vec2<u32>) -> vec2<f32> {
    return vec2<f32>(f32(near.y & 0xffffu), f32(near.y >> 16u));
}

// Sum of the distances of the neighbours from a plane, each at most `most`.
fn off_of(steeper: vec2<f32>, most: f32) -> f32 {
    var sum = 0.0;
    for (var k = 0u; k < 8u; k += 1u) {
        if is_there[k] {
            sum += min(abs(dot(steeper, around[k].xy) - around[k].z), most);
        }
    }
    return sum;
}

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let square = square_of(id.x + id.y * groups.x * 256u);
    if square.index >= arrayLength(&nears) {
        return;
    }
    let own = nears[square.index];
    let near = bitcast<f32>(own.x);
    if near == 0.0 {
        planes[square.index] = vec4<f32>(0.0, 0.0, BARE_REACH, 0.0);
        return;
    }
    let count_of = squares_in(square.level);
    let first = square.index - (square.place.y * count_of.x + square.place.x);
    let place = vec2<i32>(square.place);
    var count = 0.0;
    var missing = 0.0;
    for (var k = 0u; k < 8u; k += 1u) {
        let beside = place + neighbour(k);
        let is_before = beside.x < i32(count_of.x) && beside.y < i32(count_of.y);
        is_there[k] = beside.x >= 0 && beside.y >= 0 && is_before;
        around[k] = vec3<f32>(0.0);
        if is_there[k] {
            let other = nears[first + u32(beside.y) * count_of.x + u32(beside.x)];
            is_there[k] = bitcast<f32>(other.x) > 0.0;
            missing += select(1.0, 0.0, is_there[k]);
            let nearer = min(bitcast<f32>(other.x) / near - 1.0, NEARER_MAX);
            around[k] = vec3<f32>(pixel_of(other) - pixel_of(own), nearer);
        }
        count += select(0.0, 1.0, is_there[k]);
    }
    let side = f32(SQUARE_PX << square.level);
    let most = OFF_MAX * side / frame.focal_px;
    var steepest = vec2<f32>(0.0);
    var off = off_of(steepest, most);
    for (var k = 0u; k < 4u; k += 1u) {
        let a = around[k];
        let b = around[(k + 1u) % 4u];
        let area = a.x * b.y - a.y * b.x;
        if !is_there[k] || !is_there[(k + 1u) % 4u] || abs(area) < AREA_MIN * side * side {
            continue;
        }
        let over = 1.0 / area;
        let steeper = vec2<f32>(a.z * b.y - b.z * a.y, a.x * b.z - b.x * a.z) * over;
        let sum = off_of(steeper, most);
        if sum + most * BETTER < off {
            off = sum;
            steepest = steeper;
        }
    }
    let mean = off / max(count * most, LEAST_SUM);
    let trust = TRUST_APART * (1.0 - frame.crowding) + TRUST_CROWDED * frame.crowding;
    let doubt = clamp((mean - trust.y) * (1.0 / (trust.z - trust.y)), 0.0, 1.0);
    let mistrust = doubt * frame.fitting + (1.0 - frame.fitting);
    let reach = mistrust * (BARE_REACH - trust.x) + trust.x;
    if missing > MISSING_MAX {
        planes[square.index] = vec4<f32>(0.0, 0.0, BARE_REACH, 0.0);
    } else {
        let growth = -steepest * (1.0 - mistrust);
        let to_middle = (vec2<f32>(square.place) + 0.5) * side - pixel_of(own) - 0.5;
        let nearer = 1.0 - dot(growth, to_middle);
        let is_plane = any(growth != vec2<f32>(0.0)) && nearer > NEARER_MIN;
        // Of wide squares, the growth is that in the middle.
        let over = select(1.0, 1.0 / nearer, square.level > 0u);
        planes[square.index] = vec4<f32>(growth * over, reach, select(0.0, near * nearer, is_plane));
    }
}
