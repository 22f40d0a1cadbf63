// Eye-dome lighting (boucheny2009, section 3): darkens pixels by how far they lie behind those
// around them. Twin: crates/render/src/passes/eye_dome.rs, which explains the constants.

// include common/frame.wgsl
// include common/hits.wgsl

// Whether only the pixels of dots are darkened.
override DOTS_ONLY: bool = false;

// Offsets to the right and down, in turn.
const AROUND: array<i32, 16> = array<i32, 16>(2, 0, -2, 0, 0, 2, 0, -2, 1, 1, 1, -1, -1, 1, -1, -1);
const DARKENING: f32 = 50.0;
const BRIGHTNESS_MIN: f32 = 0.15;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> depths: array<u32>;
@group(0) @binding(2) var<storage, read_write> rgba: array<u32>;
@group(0) @binding(3) var<storage, read> dots: array<vec2<u32>>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    let own = depths[pixel];
    if own == INFINITE_BITS || (DOTS_ONLY && dots[pixel].y == NO_HIT) {
        return;
    }
    let size = vec2<i32>(vec2<u32>(frame.width, frame.height));
    var sum = 0.0;
    for (var i = 0u; i < 8u; i++) {
        let at = vec2<i32>(id.xy) + vec2<i32>(AROUND[2u * i], AROUND[2u * i + 1u]);
        if any(at < vec2<i32>(0)) || any(at >= size) {
            continue;
        }
        let other = depths[u32(at.y) * frame.width + u32(at.x)];
        // Bits of positive numbers are ordered as these: what is not in front adds nothing.
        if other < own {
            sum += log2(bitcast<f32>(own) / bitcast<f32>(other));
        }
    }
    let brightness = max(exp(-DARKENING * frame.eye_dome * (sum / 8.0)), BRIGHTNESS_MIN);
    let bytes = unpack4xU8(rgba[pixel]);
    let darker = vec4<u32>(vec4<f32>(bytes) * brightness + 0.5);
    rgba[pixel] = pack4xU8(vec4<u32>(darker.xyz, bytes.w));
}
