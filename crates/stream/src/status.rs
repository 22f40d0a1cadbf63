//! What streaming is at: sizes against budgets, bytes read, and what went wrong. A copy of plain numbers
//! that anyone may ask for at any time.

/// A snapshot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Status {
    /// Bytes of drawing memory in slots, those of requests on their way included.
    pub drawing_bytes: u64,
    /// The most that there were.
    pub drawing_bytes_peak: u64,
    /// Nodes whose planes are resident.
    pub nodes_resident: usize,
    /// Requests that wait for a loader.
    pub requests_waiting: usize,
    /// Requests that loaders have taken and the render thread has not uploaded yet.
    pub requests_in_flight: usize,
    /// Bytes read from the file.
    pub read_bytes: u64,
    /// Bytes of those that were planes asked for.
    pub useful_bytes: u64,
    /// Calls that read.
    pub reads: u64,
    /// Nodes loaded.
    pub nodes_loaded: u64,
    /// Nodes whose slots were given to others.
    pub nodes_evicted: u64,
    /// Requests that were out of view when their turn came.
    pub requests_dropped: u64,
    /// Choices made by the LOD thread.
    pub passes: u64,
    /// Milliseconds that choices took.
    pub lod_ms: PassTimes,
    /// Requests that could not be read; they are made again, after pauses that double.
    pub reads_failed: u64,
    /// Nodes that could not be read so often that nobody waits for them.
    pub nodes_failed: u64,
    /// The last fault: file, what is wrong, what to do.
    pub fault: Option<String>,
}

/// How long passes took, as a histogram of fixed size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PassTimes {
    /// The last one, milliseconds.
    pub last_ms: f64,
    /// The longest one, milliseconds.
    pub max_ms: f64,
    /// Passes by time: bin `i` ends at [`PassTimes::FIRST_MS`] * 2^(i/4).
    counts: [u64; Self::BINS],
}

impl PassTimes {
    /// Where the first bin ends, milliseconds.
    const FIRST_MS: f64 = 0.01;
    /// The last bin ends at ten minutes.
    const BINS: usize = 104;

    /// Adds a pass.
    pub(crate) fn add(&mut self, ms: f64) {
        self.last_ms = ms;
        self.max_ms = self.max_ms.max(ms);
        // Casting clamps what is negative, too large or no number.
        let bin = ((ms / Self::FIRST_MS).log2() * 4.0).ceil() as usize;
        self.counts[bin.min(Self::BINS - 1)] += 1;
    }

    /// The time that a share of the passes, 0 to 1, did not pass: exact to a fifth, 0 without passes.
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

impl Default for PassTimes {
    fn default() -> Self {
        Self { last_ms: 0.0, max_ms: 0.0, counts: [0; Self::BINS] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_exact_to_a_fifth() {
        let mut times = PassTimes::default();
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
