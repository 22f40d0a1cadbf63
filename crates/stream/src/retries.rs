//! Nodes that could not be read: when they are tried again, and for which nobody waits any more.

use std::collections::HashMap;
use std::time::{Duration, Instant};

/// The pause after the first failure; each further one doubles it.
const PAUSE: Duration = Duration::from_millis(100);

/// Failures after which nobody waits for a node any more: by then a disk has had twelve seconds to come
/// back. It is still tried after the longest pause, since it may come back later.
const FAILURES_MAX: u32 = 7;

/// A node's failures.
#[derive(Clone, Copy, Debug)]
struct Failures {
    count: u32,
    /// When it is tried again.
    due: Instant,
}

/// All nodes that failed and have not been read since.
#[derive(Debug, Default)]
pub(crate) struct Retries {
    nodes: HashMap<u32, Failures>,
}

impl Retries {
    /// Notes a failure.
    pub(crate) fn fail(&mut self, node: u32, now: Instant) {
        let failures = self.nodes.entry(node).or_insert(Failures { count: 0, due: now });
        failures.due = now + PAUSE * (1 << failures.count.min(FAILURES_MAX));
        failures.count += 1;
    }

    /// Notes that a node was read.
    pub(crate) fn succeed(&mut self, node: u32) {
        self.nodes.remove(&node);
    }

    /// Whether reading it failed.
    pub(crate) fn has_failed(&self, node: u32) -> bool {
        self.nodes.contains_key(&node)
    }

    /// Whether a node may be asked for.
    pub(crate) fn may_ask(&self, node: u32, now: Instant) -> bool {
        self.nodes.get(&node).is_none_or(|f| f.due <= now)
    }

    /// When the next node is tried again; `None` where none failed.
    pub(crate) fn next_due(&self, now: Instant) -> Option<Instant> {
        self.nodes.values().map(|f| f.due).filter(|&due| due > now).min()
    }

    /// Whether some node that may soon be read waits.
    pub(crate) fn is_waiting(&self, now: Instant) -> bool {
        self.nodes.values().any(|f| f.count < FAILURES_MAX && f.due > now)
    }

    /// Nodes that nobody waits for any more.
    pub(crate) fn given_up(&self) -> u64 {
        self.nodes.values().filter(|f| f.count >= FAILURES_MAX).count() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_double_until_nobody_waits() {
        let (mut retries, mut now) = (Retries::default(), Instant::now());
        let mut pause = PAUSE;
        for failure in 1..=FAILURES_MAX + 3 {
            assert!(retries.may_ask(5, now));
            retries.fail(5, now);
            assert!(!retries.may_ask(5, now) && retries.may_ask(6, now));
            assert_eq!(retries.is_waiting(now), failure < FAILURES_MAX);
            assert_eq!(retries.given_up(), u64::from(failure >= FAILURES_MAX));
            assert_eq!(retries.next_due(now), Some(now + pause));
            now += pause;
            pause = (pause * 2).min(PAUSE * (1 << FAILURES_MAX));
        }
    }

    #[test]
    fn a_node_that_was_read_starts_anew() {
        let (mut retries, now) = (Retries::default(), Instant::now());
        retries.fail(5, now);
        retries.succeed(5);
        assert!(
            retries.may_ask(5, now) && !retries.has_failed(5) && retries.next_due(now).is_none()
        );
    }
}
