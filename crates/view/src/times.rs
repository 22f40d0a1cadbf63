//! How long frames took: the last few seconds for the plot, and quantiles of any run of them.

use std::collections::VecDeque;

/// Frames kept at most: at a thousand a second, the seconds of the plot.
const FRAMES_MAX: usize = 8192;

/// A frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameTime {
    /// When it was shown, seconds since the start.
    pub at_s: f64,
    /// From the frame before to it, milliseconds.
    pub interval_ms: f64,
    /// Of that, what talking, copying and drawing took.
    pub work_ms: f64,
}

/// The frames of the last seconds.
#[derive(Clone, Debug)]
pub struct Times {
    frames: VecDeque<FrameTime>,
    window_s: f64,
}

impl Times {
    /// Of so many seconds.
    pub fn new(window_s: f64) -> Self {
        Self { frames: VecDeque::new(), window_s }
    }

    /// Seconds that are kept.
    pub fn window_s(&self) -> f64 {
        self.window_s
    }

    /// Adds a frame; forgets those that are too old.
    pub fn push(&mut self, frame: FrameTime) {
        self.frames.push_back(frame);
        let oldest = frame.at_s - self.window_s;
        while self.frames.len() > FRAMES_MAX || self.frames.front().is_some_and(|f| f.at_s < oldest)
        {
            self.frames.pop_front();
        }
    }

    /// The frames, the oldest first.
    pub fn frames(&self) -> impl ExactSizeIterator<Item = &FrameTime> {
        self.frames.iter()
    }

    /// The interval that a share, 0 to 1, of the frames did not pass, milliseconds; 0 of none.
    pub fn quantile_ms(&self, share: f64) -> f64 {
        quantile(self.frames.iter().map(|f| f.interval_ms), share)
    }
}

/// The value that a share, 0 to 1, of the values does not pass; 0 of none.
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
