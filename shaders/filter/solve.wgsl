// Guided filter, second step: from the moments of each window, the coefficients of the linear
// function of the guides that fits its light best (`bauszat2011` equations 7 to 9). Twin:
// crates/trace/src/filter/solve.rs.

// include common/band.wgsl
// include common/guides.wgsl

@group(0) @binding(0) var<uniform> band: Band;
// Planes of moments, summed over windows.
@group(0) @binding(1) var<storage, read> sums: array<f32>;
// Planes of coefficients: the signals of those of each guide, then of the constant. All are zero
// for a window without pixels that count.
@group(0) @binding(2) var<storage, read_write> solved: array<f32>;

// Least ridge of a guide: above what the rounding of sums in 32 bits makes of its variance.
const RIDGE_MIN: f32 = 1e-6;
// Least squared mean of luminance, against a division by zero where it is dark.
const LEAST: f32 = 1e-30;
// Greatest share of noise in the mean of a window: the guides then count for nothing.
const NOISE_MAX: f32 = 1e6;

// First moment of the pairs of a guide with itself and later ones.
fn pairs_of(guide: u32) -> u32 {
    return 1u + GUIDES + guide * GUIDES - (guide * guide - guide) / 2u;
}

var<private> pixel: u32;
var<private> stride: u32;

fn sum(moment: u32) -> f32 {
    return sums[moment * stride + pixel];
}

// Sums of the signals by `1` or a guide.
fn light(factor: u32) -> vec4<f32> {
    let first = signals() + factor * SIGNALS;
    var all = vec4<f32>(sum(first), sum(first + 1u), sum(first + 2u), 0.0);
    if SIGNALS == 4u {
        all.w = sum(first + 3u);
    }
    return all;
}

fn put(coefficient: u32, value: f32) {
    solved[coefficient * stride + pixel] = value;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= band.width || id.y >= band.window_rows {
        return;
    }
    pixel = id.y * band.width + id.x;
    stride = band.window_rows * band.width;
    let count = sum(0u);
    if count <= 0.0 {
        for (var i = 0u; i < coefficients(); i++) {
            put(i, 0.0);
        }
        return;
    }
    let share = 1.0 / count;
    let mean = light(0u) * share;
    var guide: array<f32, 4>;
    for (var i = 0u; i < GUIDES; i++) {
        guide[i] = sum(1u + i) * share;
    }
    let luminance_mean = luminance(mean.xyz);
    let variance = max(sum(moments() - 1u) * share - luminance_mean * luminance_mean, 0.0);
    let noise = min(variance * share / max(luminance_mean * luminance_mean, LEAST), NOISE_MAX);
    // The normal equations, row by row: covariance of a guide with the others, and with light.
    var covariance: array<array<f32, 4>, 4>;
    var slope: array<vec4<f32>, 4>;
    for (var i = 0u; i < GUIDES; i++) {
        for (var j = i; j < GUIDES; j++) {
            let both = sum(pairs_of(i) + j - i) * share - guide[i] * guide[j];
            covariance[i][j] = both;
            covariance[j][i] = both;
        }
        let own = max(covariance[i][i], 0.0);
        covariance[i][i] = own + max(band.epsilon[i] + band.noise[i] * noise, RIDGE_MIN);
        slope[i] = light(1u + i) * share - guide[i] * mean;
    }
    // Elimination needs no pivot: the matrix is symmetric and positive definite.
    for (var j = 0u; j + 1u < GUIDES; j++) {
        for (var i = j + 1u; i < GUIDES; i++) {
            let part = covariance[i][j] / covariance[j][j];
            for (var k = j; k < GUIDES; k++) {
                covariance[i][k] -= part * covariance[j][k];
            }
            slope[i] -= part * slope[j];
        }
    }
    var constant = mean;
    for (var step = 0u; step < GUIDES; step++) {
        let i = GUIDES - 1u - step;
        for (var k = i + 1u; k < GUIDES; k++) {
            slope[i] -= covariance[i][k] * slope[k];
        }
        slope[i] /= max(covariance[i][i], RIDGE_MIN);
        constant -= slope[i] * guide[i];
        for (var c = 0u; c < SIGNALS; c++) {
            put(SIGNALS * i + c, slope[i][c]);
        }
    }
    for (var c = 0u; c < SIGNALS; c++) {
        put(SIGNALS * GUIDES + c, constant[c]);
    }
}
