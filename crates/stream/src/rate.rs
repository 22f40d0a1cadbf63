//! A limit on the rate of reading, which all loaders share: a local disk reads like a slower one,
//! or like a network, so that orders of loading can be compared.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Times at which bytes may be read.
#[derive(Debug)]
pub(crate) struct Rate {
    bytes_a_second: u64,
    /// End of the last read that was granted.
    busy_until: Mutex<Option<Instant>>,
}

impl Rate {
    /// Limits reading to `bytes_a_second`, at least 1.
    pub(crate) fn new(bytes_a_second: u64) -> Self {
        Self { bytes_a_second: bytes_a_second.max(1), busy_until: Mutex::new(None) }
    }

    /// Time from `now` until `bytes` more would be read; they are counted as read.
    pub(crate) fn take(&self, bytes: u64, now: Instant) -> Duration {
        let mut busy_until = self.busy_until.lock().unwrap_or_else(PoisonError::into_inner);
        let start = busy_until.map_or(now, |until| until.max(now));
        let end = start + Duration::from_secs_f64(bytes as f64 / self.bytes_a_second as f64);
        *busy_until = Some(end);
        end.duration_since(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loaders_share_the_rate_and_idle_time_is_not_saved_up() {
        let rate = Rate::new(1000);
        let start = Instant::now();
        assert_eq!(rate.take(500, start), Duration::from_millis(500));
        assert_eq!(rate.take(250, start), Duration::from_millis(750));
        let later = start + Duration::from_secs(10);
        assert_eq!(rate.take(100, later), Duration::from_millis(100));
    }
}
