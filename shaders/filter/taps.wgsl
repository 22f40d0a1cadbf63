// Weighted means over the neighbours of a pixel, with weights that fall with the difference of
// their guides: the cross-bilateral filter, and a pass of a-trous wavelets. Depth is compared with
// the plane through the pixel. Twins: crates/trace/src/filter/taps.rs, bilateral.rs and atrous.rs.

// include common/usable.wgsl

struct Taps {
    width: u32,
    height: u32,
    // Taps on each side of the pixel.
    reach: i32,
    // Distance between taps.
    step: i32,
    // One over the standard deviation of normal and depth, times the root of one half.
    scale: vec4<f32>,
    // Standard deviation of the weight of distance, pixels.
    sigma: f32,
    unused: u32,
    unused_2: u32,
    unused_3: u32,
}

// Whether taps are those of a cubic B-spline over a square, else of a Gaussian over a disc.
override SPLINE: bool;
// Whether normals are filtered, so that pixels that are not usable keep what they have.
override ON_GUIDES: bool;
// Whether the fourth value becomes the factor by which the mean lowers the standard deviation of
// white noise, else it is kept.
override HAS_GAIN: bool;

@group(0) @binding(0) var<uniform> shape: Taps;
@group(0) @binding(1) var<storage, read> guides: array<vec4<f32>>;
// Which pixels count.
@group(0) @binding(2) var<storage, read> light: array<vec4<f32>>;
// What is averaged.
@group(0) @binding(3) var<storage, read> source: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> filtered: array<vec4<f32>>;

// Least sum of weights, against a division by zero.
const LEAST: f32 = 1.1754944e-38;

fn counts(pixel: u32) -> bool {
    return is_usable(light[pixel], guides[pixel]);
}

// About exp(-distance): a power of a line that ends at 16.
fn falling(distance: f32) -> f32 {
    let line = max(1.0 - distance * (1.0 / 16.0), 0.0);
    let second = line * line;
    let fourth = second * second;
    let eighth = fourth * fourth;
    return eighth * eighth;
}

// Weight of a tap before guides are compared, along one axis.
fn tap_weight(tap: i32) -> f32 {
    if SPLINE {
        // 3/8, 1/4, 1/16.
        var weights = array<f32, 3>(0.375, 0.25, 0.0625);
        return weights[min(abs(tap), 2)];
    }
    let off = f32(tap) / shape.sigma;
    return exp(-0.5 * off * off);
}

// Change of depth by a pixel along an axis, of both neighbours the less.
fn slope(pixel: u32, stride: u32, is_first: bool, is_last: bool) -> f32 {
    let here = guides[pixel].w;
    let has_before = !is_first && counts(pixel - select(stride, 0u, is_first));
    let has_after = !is_last && counts(pixel + select(stride, 0u, is_last));
    var before = 0.0;
    var after = 0.0;
    if has_before {
        before = here - guides[pixel - stride].w;
    }
    if has_after {
        after = guides[pixel + stride].w - here;
    }
    if has_before && has_after {
        return select(after, before, abs(before) < abs(after));
    }
    return before + after;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= shape.width || id.y >= shape.height {
        return;
    }
    let pixel = id.y * shape.width + id.x;
    if !counts(pixel) {
        if ON_GUIDES {
            filtered[pixel] = source[pixel];
        } else {
            filtered[pixel] = unfiltered(source[pixel]);
        }
        return;
    }
    let here = guides[pixel];
    let right = slope(pixel, 1u, id.x == 0u, id.x + 1u == shape.width);
    let down = slope(pixel, shape.width, id.y == 0u, id.y + 1u == shape.height);
    var total = 0.0;
    var sum = vec3<f32>(0.0);
    var squares = 0.0;
    for (var j = -shape.reach; j <= shape.reach; j++) {
        let y = i32(id.y) + j * shape.step;
        if y < 0 || y >= i32(shape.height) {
            continue;
        }
        for (var i = -shape.reach; i <= shape.reach; i++) {
            let x = i32(id.x) + i * shape.step;
            let is_beyond = !SPLINE && i * i + j * j > shape.reach * shape.reach;
            if is_beyond || x < 0 || x >= i32(shape.width) {
                continue;
            }
            let other = u32(y) * shape.width + u32(x);
            if !counts(other) {
                continue;
            }
            var change = guides[other] - here;
            change.w -= right * f32(i * shape.step) + down * f32(j * shape.step);
            change *= shape.scale;
            let weight = falling(dot(change, change)) * tap_weight(i) * tap_weight(j);
            total += weight;
            squares += weight * weight;
            sum += source[other].xyz * weight;
        }
    }
    total = max(total, LEAST);
    let gain = sqrt(squares) / total;
    filtered[pixel] = vec4<f32>(sum / total, select(source[pixel].w, gain, HAS_GAIN));
}
