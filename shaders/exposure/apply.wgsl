// Multiplies the colour of each pixel by the mean of all scans around it over the mean of its own
// scan, both interpolated from the grid. Twin: crates/render/src/passes/exposure.rs.

// include common/frame.wgsl
// include common/exposure.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> front: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> tint: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> depths: array<f32>;
@group(0) @binding(4) var<storage, read> slots: array<u32>;
@group(0) @binding(5) var<storage, read> sums: array<u32>;

// Greatest gain; the least is one over it.
const GAIN_MAX: f32 = 2.0;
// Added to means, so that the gain of dark surfaces stays near one.
const DARK: f32 = 1e-3;

fn sum_at(word: u32) -> vec4<f32> {
    return vec4<f32>(vec4<u32>(sums[word], sums[word + 1u], sums[word + 2u], sums[word + 3u]));
}

fn mean(sum: vec4<f32>) -> vec3<f32> {
    return sum.xyz / (sum.w * STEPS) + DARK;
}

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let pixel = id.x + id.y * groups.x * 256u;
    if pixel >= frame.width * frame.height || is_infinite(front[pixel].x) {
        return;
    }
    // The two cells along each axis, and the two slices, between whose centres the pixel lies: the
    // index of the second, and its weight.
    let at = vec2<u32>(pixel % frame.width, pixel / frame.width) + CELL_PX / 2u;
    let upper = at / CELL_PX;
    let share = (vec2<f32>(at % CELL_PX) + 0.5) / f32(CELL_PX);
    let slice_size = 1u << SLICE_BITS;
    let behind = bitcast<u32>(depths[pixel]) + slice_size / 2u;
    let deeper = f32(behind % slice_size) / f32(slice_size);
    var all = vec4<f32>(0.0);
    var own = vec4<f32>(0.0);
    for (var k = 0u; k < 8u; k += 1u) {
        let corner = vec2<u32>(k & 1u, (k >> 1u) & 1u);
        let cell = upper + corner;
        if any(cell == vec2<u32>(0u)) || any(cell > vec2<u32>(cells_across(), cells_down())) {
            continue;
        }
        let is_second = corner == vec2<u32>(1u);
        let shares = select(1.0 - share, share, is_second);
        let is_deeper = (k & 4u) != 0u;
        let weight = shares.x * shares.y * select(1.0 - deeper, deeper, is_deeper);
        let slice = behind / slice_size - select(1u, 0u, is_deeper);
        let first = slots_at(cell - 1u, slice);
        all += sum_at(first) * weight;
        own += sum_at(first + slots[pixel] * 4u) * weight;
    }
    let gain = clamp(mean(all) / mean(own), vec3<f32>(1.0 / GAIN_MAX), vec3<f32>(GAIN_MAX));
    tint[pixel] *= vec4<f32>(gain, 1.0);
}
