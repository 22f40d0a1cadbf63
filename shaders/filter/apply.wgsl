// Guided filter, last step: the mean of the functions of all windows that a pixel is in, at its
// guides. Pixels that are not usable keep their light, or become black. Twin:
// crates/trace/src/filter/guided.rs.

// include common/band.wgsl
// include common/guides.wgsl
// include common/usable.wgsl

@group(0) @binding(0) var<uniform> band: Band;
@group(0) @binding(1) var<storage, read> guides: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> light: array<vec4<f32>>;
// Planes of coefficients, summed over windows.
@group(0) @binding(3) var<storage, read> sums: array<f32>;
// With white noise its result is the fourth value.
@group(0) @binding(4) var<storage, read_write> filtered: array<vec4<f32>>;

// Number of windows of a line of pixels that cover one of them.
fn covering(at: u32, count: u32) -> i32 {
    return min(i32(at) + band.radius, i32(count) - 1) - max(i32(at) - band.radius, 0) + 1;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= band.width || id.y >= band.rows {
        return;
    }
    let pixel = (band.first + id.y) * band.width + id.x;
    let here = light[pixel];
    if !is_usable(here, guides[pixel]) {
        filtered[pixel] = unfiltered(here);
        return;
    }
    let guide = used(guides[pixel]);
    let stride = band.rows * band.width;
    var at = id.y * band.width + id.x;
    var sum = vec4<f32>(0.0);
    for (var i = 0u; i <= GUIDES; i++) {
        var coefficient = vec4<f32>(sums[at], sums[at + stride], sums[at + 2u * stride], 0.0);
        if SIGNALS == 4u {
            coefficient.w = sums[at + 3u * stride];
        }
        // The constant comes last.
        sum += coefficient * select(1.0, guide[min(i, 3u)], i < GUIDES);
        at += SIGNALS * stride;
    }
    // Every window that covers a usable pixel has that pixel.
    let windows = covering(id.x, band.width) * covering(band.first + id.y, band.height);
    let mean = sum / f32(windows);
    filtered[pixel] = select(vec4<f32>(mean.xyz, here.w), mean, SIGNALS == 4u);
}
