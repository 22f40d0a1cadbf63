//! Adapts the size of the picture while the camera moves, so that frames take the time that is
//! wanted. At rest the picture has all pixels.

/// Least scale of the picture's sides.
const SCALE_MIN: f64 = 0.33;
/// Scales are multiples of this.
const SCALE_STEP: f64 = 0.05;
/// Time that a frame is meant to take, over the time that it may take.
const AIM: f64 = 0.8;
/// Time over which frames must become faster, of the time they may take, before they are drawn
/// finer: a scale that holds does not flicker.
const FAST: f64 = 0.5;
/// Weight of the newest frame in the mean.
const NEWEST: f64 = 0.3;
/// Ratio of a frame to the mean from which on it counts alone: the view has changed.
const OTHER: f64 = 2.0;
/// Seconds after the last movement until the picture has all pixels again, while the pointer still
/// drags; at once where nothing does.
const REST_S: f64 = 0.2;

/// Scale of the picture, from the times of frames.
#[derive(Clone, Debug)]
pub struct Sharpness {
    /// Whether pictures may be coarser while the camera moves.
    pub is_on: bool,
    /// Time that a frame may take while the camera moves, milliseconds.
    frame_ms: f64,
    scale: f64,
    /// Mean time of a frame with all pixels, milliseconds. The CPU's time follows the pixels.
    whole_ms: Option<f64>,
    moved_s: f64,
    /// Whether the pointer drags.
    is_held: bool,
}

impl Sharpness {
    /// Makes a scale for frames of at most `frame_ms`, that is always 1 unless `is_on`.
    pub fn new(is_on: bool, frame_ms: f64) -> Self {
        let moved_s = f64::NEG_INFINITY;
        Self { is_on, frame_ms, scale: 1.0, whole_ms: None, moved_s, is_held: false }
    }

    /// Scale of the picture's sides at this time.
    pub fn scale(&self, now_s: f64) -> f64 {
        if self.is_on && self.is_moving(now_s) { self.scale } else { 1.0 }
    }

    /// Records that the camera has moved, and whether the pointer drags it.
    pub fn moved(&mut self, now_s: f64, is_held: bool) {
        (self.moved_s, self.is_held) = (now_s, is_held);
    }

    /// Records that nothing moves any more: the next picture has all pixels.
    pub fn rests(&mut self) {
        if !self.is_held {
            self.moved_s = f64::NEG_INFINITY;
        }
    }

    /// Records that the pointer has let go.
    pub fn let_go(&mut self) {
        self.is_held = false;
    }

    /// Whether the camera moves, or has only just stopped.
    pub fn is_moving(&self, now_s: f64) -> bool {
        now_s - self.moved_s < REST_S
    }

    /// Records the time that a frame of this scale took, milliseconds, and adapts the scale. Frames
    /// at rest tell it before the first movement.
    pub fn drew(&mut self, ms: f64, scale: f64) {
        let own = ms / (scale * scale);
        let mean = match self.whole_ms {
            Some(mean) if own < mean * OTHER && own > mean / OTHER => mean + (own - mean) * NEWEST,
            _ => own,
        };
        self.whole_ms = Some(mean);
        let now = mean * self.scale * self.scale;
        if now > self.frame_ms || (now < self.frame_ms * FAST && self.scale < 1.0) {
            let wanted = (self.frame_ms * AIM / mean.max(1e-6)).sqrt();
            self.scale = ((wanted / SCALE_STEP).floor() * SCALE_STEP).clamp(SCALE_MIN, 1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Moves for some frames of `whole_ms` with all pixels; returns their scales.
    fn moving(sharpness: &mut Sharpness, whole_ms: f64, frames: usize) -> Vec<f64> {
        let frame = |i: usize| {
            let now = i as f64 * 0.05;
            sharpness.moved(now, false);
            let scale = sharpness.scale(now);
            sharpness.drew(whole_ms * scale * scale, scale);
            scale
        };
        (0..frames).map(frame).collect()
    }

    #[test]
    fn slow_frames_become_coarser_while_moving_but_not_at_rest() {
        let mut sharpness = Sharpness::new(true, 33.0);
        let scales = moving(&mut sharpness, 120.0, 60);
        let last = scales[59];
        assert!((33.0 * FAST..=33.0).contains(&(120.0 * last * last)), "{last}");
        assert!(scales[5..].iter().all(|scale| *scale == last), "the scale has settled");
        assert_eq!(sharpness.scale(60.0), 1.0);
        assert!(moving(&mut sharpness, 10.0, 60)[59] == 1.0, "fast frames are sharp again");
        sharpness.is_on = false;
        assert_eq!(sharpness.scale(0.0), 1.0);
    }

    #[test]
    fn the_first_moving_frame_is_as_coarse_as_frames_at_rest_tell() {
        let mut sharpness = Sharpness::new(true, 33.0);
        sharpness.drew(130.0, 1.0);
        sharpness.moved(1.0, false);
        let first = sharpness.scale(1.0);
        assert!((33.0 * FAST..=33.0).contains(&(130.0 * first * first)), "{first}");
    }

    #[test]
    fn pictures_are_sharp_at_once_where_nothing_moves_and_soon_where_a_drag_pauses() {
        let mut sharpness = Sharpness::new(true, 33.0);
        sharpness.drew(130.0, 1.0);
        sharpness.moved(1.0, false);
        sharpness.rests();
        assert_eq!(sharpness.scale(1.01), 1.0);
        sharpness.moved(2.0, true);
        sharpness.rests();
        assert!(sharpness.scale(2.01) < 1.0, "the pointer may go on");
        assert_eq!(sharpness.scale(2.0 + REST_S), 1.0);
        sharpness.moved(3.0, true);
        sharpness.let_go();
        sharpness.rests();
        assert_eq!(sharpness.scale(3.01), 1.0);
    }
}
