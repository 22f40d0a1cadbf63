//! What a scripted run was like, for machines: frame times of each flight, the first frame, peaks
//! against budgets, stalls, faults.

use crate::times::{FrameTime, quantile};
use serde_json::{Value, json};

/// One flight of a script.
#[derive(Clone, Debug, Default)]
pub struct Flight {
    /// Its frames.
    pub frames: Vec<FrameTime>,
    /// When it began and ended, seconds since the start.
    pub span_s: [f64; 2],
    /// Bytes read when it began and ended.
    pub read_bytes: [u64; 2],
    /// Points drawn, over all frames.
    pub points: u64,
    /// Frames without a point.
    pub empty: u64,
}

impl Flight {
    /// For machines.
    pub fn json(&self) -> Value {
        let frames = self.frames.len().max(1) as f64;
        let figures = |of: fn(&FrameTime) -> f64| {
            let at = |share| quantile(self.frames.iter().map(of), share);
            json!({ "p50": at(0.5), "p99": at(0.99), "max": at(1.0) })
        };
        json!({
            "frames": self.frames.len(),
            "seconds": self.span_s[1] - self.span_s[0],
            "interval_ms": figures(|f| f.interval_ms),
            "work_ms": figures(|f| f.work_ms),
            "read_bytes": self.read_bytes[1] - self.read_bytes[0],
            "points_mean": self.points as f64 / frames,
            "frames_empty": self.empty,
        })
    }

    /// The interval that 99 of 100 frames did not pass, milliseconds.
    pub fn p99_ms(&self) -> f64 {
        quantile(self.frames.iter().map(|f| f.interval_ms), 0.99)
    }
}

/// What is collected over the whole run.
#[derive(Clone, Debug, Default)]
pub struct Record {
    /// The flights, the first while loading, the last with everything resident (if it read
    /// nothing).
    pub flights: Vec<Flight>,
    /// Whether a flight is being flown.
    pub is_flying: bool,
    /// The most bytes of drawing memory in slots.
    pub drawing_bytes_peak: u64,
    /// The most bytes of GPU buffers, where a GPU drew.
    pub gpu_bytes_peak: Option<u64>,
    /// The most anonymous memory of the process, bytes.
    pub anon_bytes_peak: u64,
    /// Waits of the render thread.
    pub stalls: u64,
    /// What went wrong.
    pub faults: Vec<String>,
}

impl Record {
    /// The flight that is being flown.
    pub fn flight(&mut self) -> Option<&mut Flight> {
        if self.is_flying { self.flights.last_mut() } else { None }
    }

    /// Notes a fault, once.
    pub fn fault(&mut self, fault: &str) {
        if !self.faults.iter().any(|f| f == fault) && self.faults.len() < 100 {
            self.faults.push(fault.to_owned());
        }
    }

    /// For machines.
    pub fn json(&self) -> Value {
        let [first, last] = [self.flights.first(), self.flights.last()];
        let ratio = match (first, last) {
            (Some(first), Some(last)) if self.flights.len() > 1 && last.p99_ms() > 0.0 => {
                Some(first.p99_ms() / last.p99_ms())
            }
            _ => None,
        };
        let is_resident = self.flights.len() > 1
            && last.is_some_and(|flight| flight.read_bytes[0] == flight.read_bytes[1]);
        json!({
            "flights": self.flights.iter().map(Flight::json).collect::<Vec<_>>(),
            "last_is_resident": is_resident,
            "p99_loading_over_resident": ratio,
            "drawing_bytes_peak": self.drawing_bytes_peak,
            "gpu_bytes_peak": self.gpu_bytes_peak,
            "anon_bytes_peak": self.anon_bytes_peak,
            "stalls": self.stalls,
            "faults": self.faults,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loading_is_compared_with_the_last_flight() {
        let flight = |ms: f64, read: u64| Flight {
            frames: vec![FrameTime { at_s: 0.0, interval_ms: ms, work_ms: ms }; 10],
            read_bytes: [5, 5 + read],
            ..Flight::default()
        };
        let mut record = Record { flights: vec![flight(12.0, 100)], ..Record::default() };
        assert_eq!(record.json()["p99_loading_over_resident"], Value::Null);
        record.flights.push(flight(10.0, 0));
        let report = record.json();
        assert_eq!(report["p99_loading_over_resident"], 1.2);
        assert_eq!(report["last_is_resident"], true);
        assert_eq!(report["flights"][0]["read_bytes"], 100);
    }
}
