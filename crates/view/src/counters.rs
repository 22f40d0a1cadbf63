//! Counts that the panel shows, taken from each frame and from the session's status.

use esker_engine::draw::session::GpuBytes;
use esker_engine::light::status::LitStatus;
use esker_engine::{Cut, Status};

/// Counts of the newest frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Counters {
    /// Nodes drawn.
    pub nodes: u64,
    /// Points drawn.
    pub points: u64,
    /// Nodes left out because they are hidden.
    pub occluded: u64,
    /// Whether the view is settled: nothing more is loaded for it.
    pub settled: bool,
    /// Time to choose the cut that was drawn, milliseconds.
    pub lod_ms: f64,
    /// Time to draw, milliseconds.
    pub draw_ms: f64,
    /// Status of streaming.
    pub status: Status,
    /// Bytes of GPU buffers, if a GPU draws.
    pub gpu_bytes: Option<GpuBytes>,
    /// Bytes read a second, measured over at least half a second.
    pub read_rate: f64,
    /// Reads a second, measured over at least half a second.
    pub reads_rate: f64,
    /// State of the picture if it is lit.
    pub lit: Option<LitStatus>,
    sample: Option<(f64, u64, u64)>,
}

impl Counters {
    /// Bytes and reads a second.
    pub fn rates(&self) -> [f64; 2] {
        [self.read_rate, self.reads_rate]
    }

    /// Takes the counts of a drawn frame.
    pub fn take_frame(&mut self, cut: &Cut, points: u64, draw_ms: f64) {
        self.nodes = cut.nodes.len() as u64;
        self.points = points;
        self.occluded = cut.counters.occluded + cut.counters.contour_occluded;
        self.settled = cut.settled;
        self.lod_ms = cut.lod_ms;
        self.draw_ms = draw_ms;
    }

    /// Takes the status at the time `now_s`, seconds.
    pub fn take_status(&mut self, status: Status, now_s: f64) {
        let (then_s, bytes, reads) =
            self.sample.unwrap_or((now_s, status.read_bytes, status.reads));
        let seconds = now_s - then_s;
        // A session that was opened again counts from zero.
        let restarted = status.read_bytes < bytes || status.reads < reads;
        if restarted || self.sample.is_none() {
            self.sample = Some((now_s, status.read_bytes, status.reads));
        } else if seconds >= 0.5 {
            self.read_rate = (status.read_bytes - bytes) as f64 / seconds;
            self.reads_rate = (status.reads - reads) as f64 / seconds;
            self.sample = Some((now_s, status.read_bytes, status.reads));
        }
        self.status = status;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_cover_the_last_half_second_and_survive_a_reopened_session() {
        let mut counters = Counters::default();
        let status = |read_bytes, reads| Status { read_bytes, reads, ..Status::default() };
        counters.take_status(status(1000, 1), 10.0);
        counters.take_status(status(3000, 5), 12.0);
        assert_eq!((counters.read_rate, counters.reads_rate), (1000.0, 2.0));
        counters.take_status(status(10, 1), 12.1);
        counters.take_status(status(110, 2), 13.1);
        assert_eq!(counters.read_rate, 100.0);
    }
}
