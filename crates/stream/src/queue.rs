//! The load queue from the LOD thread, which replaces its contents, to the loader threads, which
//! take the best batch. It is a lock and not a channel because it is replaced as a whole: otherwise
//! a loader could take a child whose parent was just withdrawn. The lock is held only to move
//! batches.

#[cfg(loom)]
use loom::sync::{Condvar, Mutex, MutexGuard};
use std::collections::VecDeque;
use std::sync::PoisonError;
#[cfg(not(loom))]
use std::sync::{Condvar, Mutex, MutexGuard};

/// A queue that can be closed.
#[derive(Debug)]
pub(crate) struct Queue<T> {
    state: Mutex<State<T>>,
    /// Notified when a batch is added or the queue is closed.
    changed: Condvar,
}

#[derive(Debug)]
struct State<T> {
    /// Best first.
    waiting: VecDeque<T>,
    is_closed: bool,
}

impl<T> Queue<T> {
    pub(crate) fn new() -> Self {
        let state = State { waiting: VecDeque::new(), is_closed: false };
        Self { state: Mutex::new(state), changed: Condvar::new() }
    }

    /// No invariant spans two statements under the lock, so a poisoned lock is still usable.
    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes the best entry, waiting for one; `None` once the queue is closed.
    pub(crate) fn take(&self) -> Option<T> {
        let mut state = self.lock();
        loop {
            if state.is_closed {
                return None;
            }
            if let Some(best) = state.waiting.pop_front() {
                return Some(best);
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Removes all entries that were not taken.
    pub(crate) fn take_back(&self) -> VecDeque<T> {
        std::mem::take(&mut self.lock().waiting)
    }

    /// Adds entries, best first, after [`Queue::take_back`]. The caller bounds their number.
    pub(crate) fn fill(&self, best_first: impl IntoIterator<Item = T>) {
        self.lock().waiting.extend(best_first);
        self.changed.notify_all();
    }

    /// Number of waiting entries.
    pub(crate) fn len(&self) -> usize {
        self.lock().waiting.len()
    }

    /// Closes the queue, which ends all waits.
    pub(crate) fn close(&self) {
        self.lock().is_closed = true;
        self.changed.notify_all();
    }
}
