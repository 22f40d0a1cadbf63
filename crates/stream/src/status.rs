//! Status of streaming: sizes and budgets, bytes read, and faults. A copy of plain numbers that any
//! thread may take at any time.

/// A snapshot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Status {
    /// Bytes of drawing memory in slots, those of requests in progress included.
    pub drawing_bytes: u64,
    /// Greatest value of `drawing_bytes` so far.
    pub drawing_bytes_peak: u64,
    /// Nodes whose planes are resident.
    pub nodes_resident: usize,
    /// Requests that wait for a loader.
    pub requests_waiting: usize,
    /// Requests that loaders have taken and the render thread has not uploaded yet.
    pub requests_in_flight: usize,
    /// Bytes read from the file.
    pub read_bytes: u64,
    /// Bytes read that belong to requested planes.
    pub useful_bytes: u64,
    /// Number of read calls.
    pub reads: u64,
    /// Nodes loaded.
    pub nodes_loaded: u64,
    /// Nodes whose slots were given to others.
    pub nodes_evicted: u64,
    /// Requests that were out of view when a loader took them.
    pub requests_dropped: u64,
    /// Passes of the LOD thread.
    pub passes: u64,
    /// Times of these passes, milliseconds.
    pub lod_ms: LodPassTimes,
    /// Requests that could not be read; they are made again, after pauses that double.
    pub reads_failed: u64,
    /// Nodes that failed so often that views no longer wait for them.
    pub nodes_failed: u64,
    /// Last fault: file, what is wrong, what to do.
    pub fault: Option<String>,
}

/// Times of passes, as a histogram of fixed size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LodPassTimes {
    /// Time of the last pass, milliseconds.
    pub last_ms: f64,
    /// Longest time, milliseconds.
    pub max_ms: f64,
    /// Passes by time: bin `i` ends at [`LodPassTimes::FIRST_MS`] * 2^(i/4).
    counts: [u64; Self::BINS],
}

impl LodPassTimes {
    /// End of the first bin, milliseconds.
    const FIRST_MS: f64 = 0.01;
    /// Number of bins; the last one ends at ten minutes.
    const BINS: usize = 104;

    /// Adds a pass.
    pub(crate) fn add(&mut self, ms: f64) {
        self.last_ms = ms;
        self.max_ms = self.max_ms.max(ms);
        // The cast clamps values that are negative, too large or not a number.
        let bin = ((ms / Self::FIRST_MS).log2() * 4.0).ceil() as usize;
        self.counts[bin.min(Self::BINS - 1)] += 1;
    }

    /// Time that a share (0 to 1) of the passes did not exceed: exact to a fifth, 0 without passes.
    pub fn quantile_ms(&self, share: f64) -> f64 {
        let all: u64 = self.counts.iter().sum();
        let rank = (share.clamp(0.0, 1.0) * all as f64).ceil() as u64;
        let mut below = 0;
        for (bin, &count) in self.counts.iter().enumerate() {
            below += count;
            if count > 0 && below >= rank {
                return (Self::FIRST_MS * (bin as f64 / 4.0).exp2()).min(self.max_ms);
            }
        }
        0.0
    }
}

impl Default for LodPassTimes {
    fn default() -> Self {
        Self { last_ms: 0.0, max_ms: 0.0, counts: [0; Self::BINS] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_exact_to_a_fifth() {
        let mut times = LodPassTimes::default();
        assert_eq!(times.quantile_ms(0.5), 0.0);
        (1..=100).for_each(|ms| times.add(f64::from(ms)));
        for share in [0.01, 0.5, 0.99, 1.0] {
            let (is, should) = (times.quantile_ms(share), share * 100.0);
            assert!(is >= should && is <= should * 1.2, "{share}: {is}");
        }
        assert_eq!((times.last_ms, times.max_ms), (100.0, 100.0));
        times.add(f64::INFINITY);
        times.add(-1.0);
    }
}
