// Measures splats in GPU memory: how many a ray can meet, the boxes of their centres and of their
// discs, and the luminance of some of them, which the albedo follows from. Host:
// crates/trace/src/gpu/collect.rs. Twins: crates/trace/src/scene/splats.rs and gpu/scene.rs.

// include common/infinite.wgsl
// include common/normal.wgsl
// include common/fine.wgsl

// As crates/render/src/gpu/splats.rs writes them.
@group(0) @binding(0) var<storage, read> splats: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> number: array<u32>;
// Number of splats that a ray can meet; then, as words that compare like the numbers, the greatest
// of each coordinate of the centres, the greatest of their negatives, and the same of the discs.
@group(0) @binding(2) var<storage, read_write> totals: array<atomic<u32>, 13>;
@group(0) @binding(3) var<storage, read_write> samples: array<f32>;

// Most splats that the luminance is taken of.
const SAMPLES: u32 = 65536u;
// Shares of red, green and blue.
const LUMINANCE: vec3<f32> = vec3<f32>(0.2126, 0.7152, 0.0722);
// Words of the totals.
const WORDS: u32 = 13u;

var<workgroup> own: array<atomic<u32>, 13>;

// A word that compares like the number.
fn ordered(value: f32) -> u32 {
    let bits = bitcast<u32>(value);
    return select(bits | 0x80000000u, ~bits, (bits >> 31u) == 1u);
}

// Takes a box into the totals of the workgroup from word `at` on.
fn add(at: u32, low: vec3<f32>, high: vec3<f32>) {
    for (var i = 0u; i < 3u; i++) {
        atomicMax(&own[at + i], ordered(high[i]));
        atomicMax(&own[at + 3u + i], ordered(-low[i]));
    }
}

@compute @workgroup_size(256)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = id.x + id.y * groups.x * 256u;
    let count = min(number[0], arrayLength(&splats) / 2u);
    if at < count {
        let place = splats[2u * at];
        let more = splats[2u * at + 1u];
        let step = count / SAMPLES + 1u;
        if at % step == 0u {
            samples[at / step] = dot(LUMINANCE, more.yzw);
        }
        let radius = place.w * RADIUS_FACTOR;
        if is_fine(place.xyz, radius, more.yzw) {
            let normal = normal_of(bitcast<u32>(more.x));
            let half = sqrt(max(vec3<f32>(1.0) - normal * normal, vec3<f32>(0.0))) * radius;
            atomicAdd(&own[0], 1u);
            add(1u, place.xyz, place.xyz);
            add(7u, place.xyz - half, place.xyz + half);
        }
    }
    workgroupBarrier();
    if lane == 0u {
        atomicAdd(&totals[0], atomicLoad(&own[0]));
    } else if lane < WORDS {
        atomicMax(&totals[lane], atomicLoad(&own[lane]));
    }
}
