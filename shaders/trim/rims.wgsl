// The rims of surfaces that stick out: for each pixel at one the pixel beyond. Twin: `Waves::rims` in
// crates/render/src/trim.rs.

// include common/frame.wgsl
// include common/marks.wgsl
// include common/overhang.wgsl
// include common/turns.wgsl

// Beyond a rim nothing of the surface lies for a radius, and for so many pixels at least and at most.
const OPEN_PX: vec2<f32> = vec2<f32>(4.0, 32.0);

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> marks: array<u32>;
@group(0) @binding(2) var<storage, read> depth: array<f32>;
@group(0) @binding(3) var<storage, read> front: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> tint: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> sources: array<u32>;
// Whether a pixel has gone in a tile.
@group(0) @binding(6) var<storage, read_write> gone: array<atomic<u32>>;

// The eight directions, around.
fn direction(k: u32) -> vec2<i32> {
    let x = array<i32, 8>(1, 1, 0, -1, -1, -1, 0, 1);
    return vec2<i32>(x[k & 7u], x[(k + 6u) & 7u]);
}

fn is_in_picture(at: vec2<i32>) -> bool {
    return all(at >= vec2<i32>(0)) && all(at < vec2<i32>(i32(frame.width), i32(frame.height)));
}

// Whether nothing that way lies as near as the surface.
fn is_open(at: vec2<i32>, way: vec2<i32>, reach: i32, beyond: f32) -> bool {
    for (var k = 1; k <= reach; k++) {
        let there = at + way * k;
        if !is_in_picture(there) {
            return f32(k) > OPEN_PX.x;
        }
        if depth[u32(there.y) * frame.width + u32(there.x)] <= beyond {
            return false;
        }
    }
    return true;
}

// The pixel beyond the rim plus one, where the pixel is at one: outwards in three neighbouring directions
// nothing lies as near as the surface; else 0.
fn beyond_rim(at: vec2<i32>, pixel: u32) -> u32 {
    if is_infinite(depth[pixel]) || !overhangs(pixel) {
        return 0u;
    }
    let beyond = limit(depth[pixel], pixel);
    let reach = i32(clamp(tint[pixel].w + 1.0, OPEN_PX.x, OPEN_PX.y));
    // A bit a direction; the diagonals matter beside an open one only.
    var open = 0u;
    for (var k = 0u; k < 8u; k += 2u) {
        if is_open(at, direction(k), reach, beyond) {
            open |= 1u << k;
        }
    }
    for (var k = 1u; k < 8u; k += 2u) {
        let beside = (1u << (k - 1u)) | (1u << ((k + 1u) & 7u));
        if (open & beside) != 0u && is_open(at, direction(k), reach, beyond) {
            open |= 1u << k;
        }
    }
    for (var k = 0u; k < 8u; k++) {
        let three = (1u << k) | (1u << ((k + 1u) & 7u)) | (1u << ((k + 7u) & 7u));
        if (open & three) == three {
            let there = at + direction(k);
            if !is_in_picture(there) {
                return 0u;
            }
            return u32(there.y) * frame.width + u32(there.x) + 1u;
        }
    }
    return 0u;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    var source = 0u;
    if (marks[pixel] & EDGE) != 0u {
        source = beyond_rim(vec2<i32>(id.xy), pixel);
    }
    sources[pixel] = source;
    if source != 0u {
        atomicStore(&gone[id.y / TILE * picture_tiles().x + id.x / TILE], 1u);
    }
}
