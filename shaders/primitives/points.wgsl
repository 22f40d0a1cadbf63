// Project by point primitives: a vertex a point, an instance a chunk. A point is moved to the
// centre of its pixel, and the depth test keeps the nearest. The output is the number of the point
// and the bits of its depth. Twin: crates/render/src/passes/project.rs.

// include common/points.wgsl

struct Vertex {
    @builtin(position) at: vec4<f32>,
    @location(0) @interpolate(flat) hit: vec2<u32>,
}

struct Exact {
    @location(0) hit: vec2<u32>,
    @builtin(frag_depth) key: f32,
}

@vertex
fn vertex(@builtin(vertex_index) i: u32, @builtin(instance_index) item: u32) -> Vertex {
    // A place that is clipped.
    let nowhere = Vertex(vec4<f32>(2.0, 2.0, 2.0, 1.0), vec2<u32>(0xffffffffu));
    let number = work[item];
    let chunk = chunks[number];
    if i >= chunk.points {
        return nowhere;
    }
    let draw = draws[chunk.draw];
    let index = chunk.first + i;
    let seen = see(draw, index);
    if !is_inside(seen) {
        return nowhere;
    }
    if is_dropped(chunk.draw, draw, index, seen) {
        return nowhere;
    }
    let size = vec2<f32>(f32(frame.width), f32(frame.height));
    let middle = (floor(seen.at) + 0.5) / size * 2.0 - 1.0;
    let hit = vec2<u32>(number * CHUNK_POINTS + i, bitcast<u32>(seen.depth));
    return Vertex(vec4<f32>(middle.x, -middle.y, key_of(hit.y), 1.0), hit);
}

// A number from 0 to 1 in the order of the depths, from the near plane to 2^125 times its depth.
// Bits of positive floats have the order of the floats, and are shifted to end at 1. The least key
// is a normal number, because drivers may flush denormal ones to zero.
fn key_of(depth_bits: u32) -> f32 {
    let bits = depth_bits - bitcast<u32>(frame.near) + 0x00800000u;
    return bitcast<f32>(min(bits, 0x3f7fffffu));
}

@fragment
fn fragment(in: Vertex) -> @location(0) vec2<u32> {
    return in.hit;
}

// In OpenGL, whose clip space goes from -1 to 1, the key would be rounded; so the fragment writes
// it.
@fragment
fn fragment_exact(in: Vertex) -> Exact {
    return Exact(in.hit, key_of(in.hit.y));
}
