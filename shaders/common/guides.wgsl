// Guides of a pixel, and the moments that a regression of light on them needs (`bauszat2011` 3.3).

// Number of guides: the depth (1), the normal (3), or both (4).
override GUIDES: u32;

// Number of signals: the channels of light (3), and white noise (4).
override SIGNALS: u32;

// Middle of the range of a guide. Guides are shifted by it, so that squares of their means cancel
// less of the sums' precision.
const MIDDLE: f32 = 0.5;

// First moment of the signals: after those of nothing, each guide and each pair of guides. Those of
// the signals by each guide follow, and the square of luminance.
fn signals() -> u32 {
    return 1u + GUIDES + GUIDES * (GUIDES + 1u) / 2u;
}

// Number of moments.
fn moments() -> u32 {
    return signals() + SIGNALS * (GUIDES + 1u) + 1u;
}

// Number of coefficients of a window: those of each guide and the constant, for each signal.
fn coefficients() -> u32 {
    return SIGNALS * (GUIDES + 1u);
}

// The guides that are used, from normal (0 to 1) and depth.
fn used(guides: vec4<f32>) -> vec4<f32> {
    let shifted = guides - MIDDLE;
    if GUIDES == 1u {
        return vec4<f32>(shifted.w, 0.0, 0.0, 0.0);
    }
    return select(shifted, vec4<f32>(shifted.xyz, 0.0), GUIDES == 3u);
}

fn luminance(light: vec3<f32>) -> f32 {
    return dot(light, vec3<f32>(0.2126, 0.7152, 0.0722));
}
