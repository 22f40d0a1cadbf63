//! Nodes that could not be read: when they are tried again, and when no more.

use std::collections::HashMap;
use std::time::{Duration, Instant};

/// The pause after the first failure; each further one doubles it.
const PAUSE: Duration = Duration::from_millis(100);

/// Failures after which a node is given up: by then a disk has had six seconds to come back.
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
    given_up: u64,
}

impl Retries {
    /// Notes a failure.
    pub(crate) fn fail(&mut self, node: u32, now: Instant) {
        let failures = self.nodes.entry(node).or_insert(Failures { count: 0, due: now });
        failures.due = now + PAUSE * (1 << failures.count.min(FAILURES_MAX));
        failures.count += 1;
        self.given_up += u64::from(failures.count == FAILURES_MAX);
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
        self.nodes.get(&node).is_none_or(|f| f.count < FAILURES_MAX && f.due <= now)
    }

    /// When the next of the nodes that wait is tried again; `None` where none waits.
    pub(crate) fn next_due(&self, now: Instant) -> Option<Instant> {
        let waiting = self.nodes.values().filter(|f| f.count < FAILURES_MAX && f.due > now);
        waiting.map(|f| f.due).min()
    }

    /// Nodes that are not tried again.
    pub(crate) fn given_up(&self) -> u64 {
        self.given_up
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_double_until_a_node_is_given_up() {
        let (mut retries, start) = (Retries::default(), Instant::now());
        let mut now = start;
        for failure in 0..FAILURES_MAX {
            assert!(retries.may_ask(5, now));
            retries.fail(5, now);
            assert!(!retries.may_ask(5, now));
            let due = retries.next_due(now);
            assert_eq!(due.is_none(), failure + 1 == FAILURES_MAX);
            now = due.unwrap_or(now + Duration::from_secs(3600));
        }
        assert!(!retries.may_ask(5, now) && retries.may_ask(6, now));
        assert_eq!(retries.given_up(), 1);
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
