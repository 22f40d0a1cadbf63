//! The load queue between the LOD thread, which empties and fills it, and the loader threads, which take
//! the best. A lock and not a channel, since it is replaced as a whole: no loader ever finds half of an
//! old queue, a child whose parent was taken back before it. Held only to move batches in or out.

#[cfg(loom)]
use loom::sync::{Condvar, Mutex, MutexGuard};
use std::collections::VecDeque;
use std::sync::PoisonError;
#[cfg(not(loom))]
use std::sync::{Condvar, Mutex, MutexGuard};

/// A queue that closes.
#[derive(Debug)]
pub(crate) struct Queue<T> {
    state: Mutex<State<T>>,
    /// There is something to take, or nothing will come any more.
    changed: Condvar,
}

#[derive(Debug)]
struct State<T> {
    /// The best first.
    waiting: VecDeque<T>,
    is_closed: bool,
}

impl<T> Queue<T> {
    pub(crate) fn new() -> Self {
        let state = State { waiting: VecDeque::new(), is_closed: false };
        Self { state: Mutex::new(state), changed: Condvar::new() }
    }

    /// No invariant spans two statements under the lock, so a panic elsewhere spoils nothing.
    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes the best, waiting until there is one; `None` once it is closed.
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

    /// Takes back all that nobody took.
    pub(crate) fn take_back(&self) -> VecDeque<T> {
        std::mem::take(&mut self.lock().waiting)
    }

    /// Fills it, best first, after [`Queue::take_back`]. The caller bounds how much that is.
    pub(crate) fn fill(&self, best_first: impl IntoIterator<Item = T>) {
        self.lock().waiting.extend(best_first);
        self.changed.notify_all();
    }

    /// How many wait.
    pub(crate) fn len(&self) -> usize {
        self.lock().waiting.len()
    }

    /// Lets nobody wait any more.
    pub(crate) fn close(&self) {
        self.lock().is_closed = true;
        self.changed.notify_all();
    }
}
