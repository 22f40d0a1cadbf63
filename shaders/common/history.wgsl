// Light of the last picture that is used again: the light of each pixel, and the number of samples
// that it stands for. Twin: crates/trace/src/paths/history.rs.

// Samples of new light from which on the last picture no longer counts.
const HISTORY_SAMPLES: f32 = 8.0;

// Samples of the past that are left beside `samples` new ones.
fn samples_left(past: f32, samples: f32) -> f32 {
    return max(min(past, HISTORY_SAMPLES - samples), 0.0);
}
