//! Adapts the size of the picture while the camera moves, so that a slow renderer follows the
//! input. At rest the picture has all pixels.

/// Scales of the picture's sides.
const SCALES: [f64; 5] = [1.0, 0.8, 0.6, 0.45, 0.33];
/// Frames slower than the first are drawn coarser, frames faster than the second finer;
/// milliseconds.
const SLOW_MS: f64 = 40.0;
const FAST_MS: f64 = 14.0;
/// Weight of the newest frame in the mean.
const NEWEST: f64 = 0.3;
/// Seconds after the last movement until the picture has all pixels again.
const REST_S: f64 = 0.2;

/// Scale of the picture, from the times of frames.
#[derive(Clone, Debug)]
pub struct Sharpness {
    /// Whether pictures may be coarser while the camera moves.
    pub is_on: bool,
    step: usize,
    mean_ms: f64,
    moved_s: f64,
}

impl Sharpness {
    /// Makes a scale that is always 1 unless `is_on`.
    pub fn new(is_on: bool) -> Self {
        Self { is_on, step: 0, mean_ms: 0.0, moved_s: f64::NEG_INFINITY }
    }

    /// Scale of the picture's sides at this time.
    pub fn scale(&self, now_s: f64) -> f64 {
        if self.is_on && self.is_moving(now_s) { SCALES[self.step] } else { 1.0 }
    }

    /// Records that the camera has moved.
    pub fn moved(&mut self, now_s: f64) {
        self.moved_s = now_s;
    }

    /// Whether the camera moves, or has only just stopped.
    pub fn is_moving(&self, now_s: f64) -> bool {
        now_s - self.moved_s < REST_S
    }

    /// Records the time that a frame took to draw, and adapts the scale.
    pub fn drew(&mut self, ms: f64, now_s: f64) {
        if !self.is_moving(now_s) {
            return;
        }
        self.mean_ms += (ms - self.mean_ms) * NEWEST;
        let step = match self.mean_ms {
            mean if mean > SLOW_MS => (self.step + 1).min(SCALES.len() - 1),
            mean if mean < FAST_MS => self.step.saturating_sub(1),
            _ => self.step,
        };
        if step != self.step {
            // Expected mean at the new scale, so that the scale is judged by its own frames.
            self.mean_ms *= (SCALES[step] / SCALES[self.step]).powi(2);
            self.step = step;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_frames_become_coarser_while_moving_but_not_at_rest() {
        let mut sharpness = Sharpness::new(true);
        for i in 0..60 {
            let now = f64::from(i) * 0.05;
            sharpness.moved(now);
            let ms = 120.0 * sharpness.scale(now).powi(2);
            sharpness.drew(ms, now);
        }
        let scale = sharpness.scale(3.0);
        assert!(scale < 0.7, "{scale}");
        assert!((FAST_MS..=SLOW_MS).contains(&(120.0 * scale.powi(2))), "the scale has settled");
        assert_eq!(sharpness.scale(60.0), 1.0);
        sharpness.is_on = false;
        assert_eq!(sharpness.scale(3.0), 1.0);
    }
}
