//! How many pixels a picture has while the camera moves: so few that it follows the hand, where the
//! renderer is slow. At rest the picture is always whole.

/// Shares of the window's pixels on a side.
const SCALES: [f64; 5] = [1.0, 0.8, 0.6, 0.45, 0.33];
/// Frames that take longer are drawn coarser, those that take less than the other are drawn finer;
/// milliseconds.
const SLOW_MS: f64 = 40.0;
const FAST_MS: f64 = 14.0;
/// Weight of the newest frame in the mean.
const NEWEST: f64 = 0.3;
/// Seconds after the last movement until the picture is whole again.
const REST_S: f64 = 0.2;

/// The share of pixels drawn.
#[derive(Clone, Debug)]
pub struct Sharpness {
    /// Whether moving pictures may be coarser.
    pub is_on: bool,
    step: usize,
    mean_ms: f64,
    moved_s: f64,
}

impl Sharpness {
    /// Whole pictures always, unless `is_on`.
    pub fn new(is_on: bool) -> Self {
        Self { is_on, step: 0, mean_ms: 0.0, moved_s: f64::NEG_INFINITY }
    }

    /// The share of pixels on a side, at this time.
    pub fn scale(&self, now_s: f64) -> f64 {
        if self.is_on && self.is_moving(now_s) { SCALES[self.step] } else { 1.0 }
    }

    /// The camera has moved.
    pub fn moved(&mut self, now_s: f64) {
        self.moved_s = now_s;
    }

    /// Whether the camera moves, or has only just stopped.
    pub fn is_moving(&self, now_s: f64) -> bool {
        now_s - self.moved_s < REST_S
    }

    /// A frame took so long to draw.
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
            // What is expected of the new step, so that it is judged by its own frames.
            self.mean_ms *= (SCALES[step] / SCALES[self.step]).powi(2);
            self.step = step;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_frames_become_coarser_while_moving_and_whole_at_rest() {
        let mut sharpness = Sharpness::new(true);
        for i in 0..60 {
            let now = f64::from(i) * 0.05;
            sharpness.moved(now);
            let ms = 120.0 * sharpness.scale(now).powi(2);
            sharpness.drew(ms, now);
        }
        let scale = sharpness.scale(3.0);
        assert!(scale < 0.7, "{scale}");
        assert!((FAST_MS..=SLOW_MS).contains(&(120.0 * scale.powi(2))), "it has settled");
        assert_eq!(sharpness.scale(60.0), 1.0);
        sharpness.is_on = false;
        assert_eq!(sharpness.scale(3.0), 1.0);
    }
}
