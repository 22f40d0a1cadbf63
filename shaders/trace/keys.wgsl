// Key of each disc along a Hilbert curve (`skilling2004`) through the cube around the scene, with
// its index. Twin: crates/trace/src/accel/hilbert.rs.

struct Cube {
    // Least corner.
    corner: vec4<f32>,
    // Cells of the curve in a unit of length.
    scale: f32,
    // Number of discs.
    count: u32,
    unused: u32,
    unused_2: u32,
}

// Bits of a coordinate.
const BITS: u32 = 10u;

@group(0) @binding(0) var<uniform> cube: Cube;
@group(0) @binding(1) var<storage, read> discs: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> pairs: array<vec2<u32>>;

// Index of a cell along the curve.
fn hilbert(cell: vec3<u32>) -> u32 {
    var x = cell;
    for (var q = 1u << (BITS - 1u); q > 1u; q >>= 1u) {
        let p = q - 1u;
        for (var i = 0u; i < 3u; i++) {
            if (x[i] & q) != 0u {
                x.x ^= p;
            } else {
                let t = (x.x ^ x[i]) & p;
                x.x ^= t;
                x[i] ^= t;
            }
        }
    }
    x.y ^= x.x;
    x.z ^= x.y;
    var t = 0u;
    for (var q = 1u << (BITS - 1u); q > 1u; q >>= 1u) {
        if (x.z & q) != 0u {
            t ^= q - 1u;
        }
    }
    x ^= vec3<u32>(t);
    var key = 0u;
    for (var bit = 0u; bit < BITS; bit++) {
        let at = BITS - 1u - bit;
        let digits = (x >> vec3<u32>(at)) & vec3<u32>(1u);
        key = (key << 3u) | (digits.x << 2u) | (digits.y << 1u) | digits.z;
    }
    return key;
}

@compute @workgroup_size(256)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let at = id.x + id.y * groups.x * 256u;
    if at >= cube.count {
        return;
    }
    let cells = (discs[2u * at].xyz - cube.corner.xyz) * cube.scale;
    let last = vec3<f32>(f32((1u << BITS) - 1u));
    pairs[at] = vec2<u32>(hilbert(vec3<u32>(clamp(cells, vec3<f32>(0.0), last))), at);
}
