//! Frame times: those of the last seconds for the plot, and quantiles of any sequence of them.

use std::collections::VecDeque;

/// Frames that are kept at most: at a thousand a second, all that the plot shows.
const FRAMES_MAX: usize = 8192;

/// Time of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameTime {
    /// When the frame was shown, seconds since the start.
    pub at_s: f64,
    /// Time since the previous frame, milliseconds.
    pub interval_ms: f64,
    /// Time that input, uploads and drawing took, milliseconds.
    pub work_ms: f64,
}

/// Times of the frames of the last seconds.
#[derive(Clone, Debug)]
pub struct Times {
    frames: VecDeque<FrameTime>,
    window_s: f64,
}

impl Times {
    /// Keeps the frames of the last `window_s` seconds.
    pub fn new(window_s: f64) -> Self {
        Self { frames: VecDeque::new(), window_s }
    }

    /// Seconds that are kept.
    pub fn window_s(&self) -> f64 {
        self.window_s
    }

    /// Adds a frame, and removes those that are too old.
    pub fn push(&mut self, frame: FrameTime) {
        self.frames.push_back(frame);
        let oldest = frame.at_s - self.window_s;
        while self.frames.len() > FRAMES_MAX || self.frames.front().is_some_and(|f| f.at_s < oldest)
        {
            self.frames.pop_front();
        }
    }

    /// The frames, oldest first.
    pub fn frames(&self) -> impl ExactSizeIterator<Item = &FrameTime> {
        self.frames.iter()
    }

    /// Quantile of the intervals at `share`, 0 to 1, milliseconds; 0 without frames.
    pub fn quantile_ms(&self, share: f64) -> f64 {
        quantile(self.frames.iter().map(|f| f.interval_ms), share)
    }
}

/// Quantile of the values at `share`, 0 to 1; 0 without values.
pub fn quantile(values: impl Iterator<Item = f64>, share: f64) -> f64 {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    let rank = (share.clamp(0.0, 1.0) * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.max(1) - 1).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_last_seconds_are_kept() {
        let mut times = Times::new(2.0);
        for i in 0..100 {
            let interval_ms = if i < 50 { 1000.0 } else { f64::from(i) };
            times.push(FrameTime { at_s: f64::from(i) * 0.1, interval_ms, work_ms: 0.0 });
        }
        assert_eq!(times.frames().len(), 21);
        assert_eq!(times.quantile_ms(0.0), 79.0);
        assert_eq!(times.quantile_ms(1.0), 99.0);
        assert_eq!(Times::new(1.0).quantile_ms(0.5), 0.0);
    }
}
