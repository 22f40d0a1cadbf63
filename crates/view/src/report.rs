//! The report of a scripted run as JSON: frame times of each flight, peaks of memory, stalls,
//! faults.

use crate::times::{FrameTime, quantile};
use serde_json::{Value, json};

/// One flight of a script.
#[derive(Clone, Debug, Default)]
pub struct Flight {
    /// Times of its frames.
    pub frames: Vec<FrameTime>,
    /// Begin and end, seconds since the start.
    pub span_s: [f64; 2],
    /// Bytes read before its begin and before its end.
    pub read_bytes: [u64; 2],
    /// Sum of the points drawn in all frames.
    pub points: u64,
    /// Number of frames without points.
    pub empty: u64,
}

impl Flight {
    /// Converts to JSON.
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

    /// 99th percentile of the intervals, milliseconds.
    pub fn p99_ms(&self) -> f64 {
        quantile(self.frames.iter().map(|f| f.interval_ms), 0.99)
    }
}

/// Measurements of the whole run.
#[derive(Clone, Debug, Default)]
pub struct Record {
    /// The flights: the first while the scene loads, the last with the scene resident (if it read
    /// nothing).
    pub flights: Vec<Flight>,
    /// Whether a flight is in progress.
    pub is_flying: bool,
    /// Peak of the drawing memory in slots, bytes.
    pub drawing_bytes_peak: u64,
    /// Peak of GPU buffers, bytes, if a GPU drew.
    pub gpu_bytes_peak: Option<u64>,
    /// Peak of the anonymous memory of the process, bytes.
    pub anon_bytes_peak: u64,
    /// Number of times that the render thread waited for another thread.
    pub stalls: u64,
    /// CPU time, milliseconds, and pixels that were painted, of each pass in which the pointer
    /// moved over a picture at rest.
    pub pointed: Vec<[f64; 2]>,
    /// Faults, each once.
    pub faults: Vec<String>,
}

impl Record {
    /// The flight in progress.
    pub fn flight(&mut self) -> Option<&mut Flight> {
        if self.is_flying { self.flights.last_mut() } else { None }
    }

    /// Adds a fault, unless it is known.
    pub fn fault(&mut self, fault: &str) {
        if !self.faults.iter().any(|f| f == fault) && self.faults.len() < 100 {
            self.faults.push(fault.to_owned());
        }
    }

    /// Converts to JSON.
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
        let pointed = |of: usize| {
            let at = |share| quantile(self.pointed.iter().map(|pass| pass[of]), share);
            json!({ "p50": at(0.5), "p99": at(0.99), "max": at(1.0) })
        };
        let pointed = (!self.pointed.is_empty()).then(
            || json!({ "passes": self.pointed.len(), "cpu_ms": pointed(0), "pixels": pointed(1) }),
        );
        json!({
            "flights": self.flights.iter().map(Flight::json).collect::<Vec<_>>(),
            "pointed": pointed,
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
    fn the_first_flight_is_compared_with_the_last() {
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
