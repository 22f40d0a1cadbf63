//! Nodes that could not be read: when they are tried again, and when a view no longer waits for
//! them.

use std::collections::HashMap;
use std::time::{Duration, Instant};

/// Pause after the first failure; each further failure doubles it.
const PAUSE: Duration = Duration::from_millis(100);

/// Failures after which a view settles without the node: a disk has had twelve seconds to recover
/// by then. The node is still tried after each longest pause, since the disk may recover later.
const FAILURES_MAX: u32 = 7;

/// Failures of a node.
#[derive(Clone, Copy, Debug)]
struct Failures {
    count: u32,
    /// Time of the next try.
    due: Instant,
}

/// All nodes that failed and have not been read since.
#[derive(Debug, Default)]
pub(crate) struct Retries {
    nodes: HashMap<u32, Failures>,
}

impl Retries {
    /// Notes a failure; after a final one views do not wait for the node.
    pub(crate) fn fail(&mut self, node: u32, now: Instant, is_final: bool) {
        let failures = self.nodes.entry(node).or_insert(Failures { count: 0, due: now });
        if is_final {
            failures.count = failures.count.max(FAILURES_MAX);
        }
        failures.due = now + PAUSE * (1 << failures.count.min(FAILURES_MAX));
        failures.count += 1;
    }

    /// Notes that a node was read.
    pub(crate) fn succeed(&mut self, node: u32) {
        self.nodes.remove(&node);
    }

    /// Whether reading a node failed.
    pub(crate) fn has_failed(&self, node: u32) -> bool {
        self.nodes.contains_key(&node)
    }

    /// Whether a node may be requested now.
    pub(crate) fn may_request(&self, node: u32, now: Instant) -> bool {
        self.nodes.get(&node).is_none_or(|f| f.due <= now)
    }

    /// Time of the next retry; `None` if no node failed.
    pub(crate) fn next_due(&self, now: Instant) -> Option<Instant> {
        self.nodes.values().map(|f| f.due).filter(|&due| due > now).min()
    }

    /// Whether a view should wait for the retry of some node.
    pub(crate) fn is_waiting(&self, now: Instant) -> bool {
        self.nodes.values().any(|f| f.count < FAILURES_MAX && f.due > now)
    }

    /// Number of nodes that views no longer wait for.
    pub(crate) fn given_up(&self) -> u64 {
        self.nodes.values().filter(|f| f.count >= FAILURES_MAX).count() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_double_until_a_node_is_given_up() {
        let (mut retries, mut now) = (Retries::default(), Instant::now());
        let mut pause = PAUSE;
        for failure in 1..=FAILURES_MAX + 3 {
            assert!(retries.may_request(5, now));
            retries.fail(5, now, false);
            assert!(!retries.may_request(5, now) && retries.may_request(6, now));
            assert_eq!(retries.is_waiting(now), failure < FAILURES_MAX);
            assert_eq!(retries.given_up(), u64::from(failure >= FAILURES_MAX));
            assert_eq!(retries.next_due(now), Some(now + pause));
            now += pause;
            pause = (pause * 2).min(PAUSE * (1 << FAILURES_MAX));
        }
    }

    #[test]
    fn views_do_not_wait_after_a_final_failure() {
        let (mut retries, now) = (Retries::default(), Instant::now());
        retries.fail(5, now, true);
        assert!(!retries.is_waiting(now) && retries.given_up() == 1);
        // The file may come back.
        assert!(retries.next_due(now).is_some());
    }

    #[test]
    fn a_node_that_was_read_starts_anew() {
        let (mut retries, now) = (Retries::default(), Instant::now());
        retries.fail(5, now, false);
        retries.succeed(5);
        assert!(
            retries.may_request(5, now)
                && !retries.has_failed(5)
                && retries.next_due(now).is_none()
        );
    }
}
